"""Build bodies from closed surfaces: a voxel wherever its centre is inside.

A centre is inside if the surface winds around it, whichever way: shells that overlap are one body, and a shell inside
another that looks inwards is a hole.
"""

import math
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.file_kinds import check_plain_file
from taichi_sim.base.foreign import said_by
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.files.arrays import body_from_array
from taichi_sim.lattice.materials import Material

if TYPE_CHECKING:
    import trimesh

MOST_VOXELS = 100_000
MOST_MEMORY = 4e9  # [B]
_CELL_BYTES = 5  # a flag of the grid, and two counts of how often the surface winds around a place
_CROSSING_BYTES = 120  # of a column's meeting with a triangle's box, while it is judged
_VOXEL_BYTES = 3_000  # of a voxel, its links and faces in an engine of eight robots in f64, which a CPU runs at once
_LARGE = 5.0  # units of a mesh that is hardly in metres
_COARSE = 0.1  # part of the volume that voxels may lack, or have too much, without a word
_SLIT = 1e-6  # lengths of a mesh; narrower holes are seams that rounding opened
_WIDE = 3.0  # pitches; behind wider holes voxels may be missing
# Columns are moved off the grid by so much of the pitch: none runs along an edge of a mesh made of round numbers.
_SHIFT = np.array([2**0.5, 3**0.5]) * 1e-7
_TIE = 5**0.5 * 1e-7  # heights that are so little above a place are at it, as rounding would decide else


@dataclass(frozen=True)
class Prediction:
    """Predicted size of a voxelised mesh.

    Attributes:
        cells: places of the grid around it.
        voxels: estimated by its volume; inexact for bodies with thin walls.
        memory: memory of grid, body and a simulation of eight robots in f64, as many as a CPU thread runs at once [B].
    """

    cells: int
    voxels: int
    memory: float


@dataclass(frozen=True, eq=False)
class VoxelisedMesh:
    """A mesh filled with voxels.

    Attributes:
        filled: whether each place has a voxel, shape (X, Y, Z).
        origin: centre of the first place of the grid, in the mesh's coordinates times its scale, shape (3,).
        pitch: edge of the voxels, in the mesh's unit times its scale: metres, if a scale was given.
    """

    filled: Bools
    origin: Floats
    pitch: float

    @property
    def centres(self) -> Floats:
        """Centres of all places of the grid, in the unit of :attr:`pitch`, shape (X, Y, Z, 3)."""
        return self.origin + np.moveaxis(np.indices(self.filled.shape), 0, -1) * self.pitch


def predict(mesh: "trimesh.Trimesh", pitch: float) -> Prediction:
    """Predict the size of a mesh's body, without taking memory for it."""
    counts = _counts(mesh, pitch)
    cells = math.prod(counts)
    voxels = min(math.ceil(abs(float(mesh.volume)) / pitch**3 - 1e-6), cells)
    low, high = (mesh.triangles[..., :2].min(axis=1), mesh.triangles[..., :2].max(axis=1))
    meetings = float(np.ceil((high - low) / pitch + 1).prod(axis=1).sum())
    # A body keeps which pairs of surface voxels never collide: a flag each, see ``Topology.excluded``.
    surface = min(voxels, math.ceil(float(mesh.area) / pitch**2))
    memory = cells * _CELL_BYTES + meetings * _CROSSING_BYTES + voxels * _VOXEL_BYTES + float(surface) ** 2 * 1.5
    return Prediction(cells, voxels, memory)


def voxelise(
    mesh: "trimesh.Trimesh | str | PathLike[str]",
    pitch: float,
    *,
    scale: float = 1.0,
    repair: bool = True,
    most_voxels: int = MOST_VOXELS,
    most_memory: float = MOST_MEMORY,
) -> VoxelisedMesh:
    """Fill a closed surface with voxels, one wherever its centre is inside; shells that overlap are one body.

    The grid has the mesh's box in its middle, its edges rounded to whole pitches. Warnings tell of holes that were
    closed, and if the voxels are not all joined by their faces, or their volume is another than that of the closed
    mesh, by more than a tenth.

    Args:
        mesh: a mesh of trimesh, or a file that trimesh reads.
        pitch: edge of the voxels, in the mesh's unit.
        scale: metres per unit of the mesh, 0.001 for millimetres; the result is in metres then.
        repair: close holes of three or four edges, and join equal vertices, of a mesh that is not watertight.
        most_voxels: largest number of voxels that :func:`predict` may give.
        most_memory: largest memory that :func:`predict` may give [B].

    Raises:
        ValueError: for files without a surface, surfaces that are not closed or enclose nothing, and
            bodies above the bounds, before memory is taken.
    """
    _check_scale(scale)
    if not (isinstance(pitch, int | float | np.number) and math.isfinite(pitch) and pitch > 0):
        raise ValueError(f"pitch: {pitch!r} is not allowed; it must be positive")
    named, mesh = _named(mesh), _not_empty(_loaded(mesh))
    if not min(mesh.extents) > 0:
        raise ValueError("mesh: it encloses no volume; give a closed surface around the body")
    _check_size(mesh, pitch, most_voxels, most_memory)
    mesh, holes = _closed(mesh, repair)
    if not abs(float(mesh.volume)) > 1e-12 * math.prod(float(e) for e in mesh.extents):
        raise ValueError("mesh: it encloses no volume; give a closed surface around the body")
    _check_size(mesh, pitch, most_voxels, most_memory)  # of the repaired one
    _warn_of_holes(holes, pitch, scale, named)
    counts = np.array(_counts(mesh, pitch))
    origin = mesh.bounds.mean(axis=0) - (counts - 1) / 2 * pitch
    turns = _turns((np.asarray(mesh.triangles) - origin) / pitch, counts)
    filled = turns != 0
    if not filled.any():
        raise ValueError(f"mesh: no voxel of pitch {pitch:g} has its centre inside; give a smaller pitch")
    pieces = int(ndimage.label(filled)[1])
    if pieces > 1:
        warnings.warn(
            f"mesh: its voxels of pitch {pitch:g} are {pieces} pieces that are not joined; let parts overlap, or give "
            "a smaller pitch",
            stacklevel=2,
        )
    share = float(turns.sum()) * pitch**3 / float(mesh.volume)  # both count twice where shells overlap
    if abs(share - 1) > _COARSE:
        warnings.warn(
            f"mesh: its voxels of pitch {pitch:g} have {100 * share:.0f} % of its volume; give a smaller pitch, or one "
            "of which its lengths are multiples",
            stacklevel=2,
        )
    return VoxelisedMesh(filled, origin * scale, float(pitch) * scale)


def inside(mesh: "trimesh.Trimesh | str | PathLike[str]", within: VoxelisedMesh, *, scale: float = 1.0) -> Bools:
    """Which places of a voxelised mesh lie inside another mesh of the same coordinates, shape (X, Y, Z).

    Args:
        mesh: that marks places, such as those of a material or of a muscle.
        within: the grid.
        scale: metres per unit of the mesh, as of ``within``.

    Raises:
        ValueError: for files without a surface, and surfaces that are not closed.
    """
    _check_scale(scale)
    marked, holes = _closed(_not_empty(_loaded(mesh)), True)
    _warn_of_holes(holes, within.pitch / scale, scale, _named(mesh))
    triangles = (np.asarray(marked.triangles) * scale - within.origin) / within.pitch
    return _turns(triangles, np.array(within.filled.shape)) != 0


def body_from_mesh(
    mesh: "trimesh.Trimesh | str | PathLike[str]",
    pitch: float,
    material: Material,
    *,
    scale: float = 1.0,
    repair: bool = True,
    most_voxels: int = MOST_VOXELS,
    most_memory: float = MOST_MEMORY,
) -> LatticeBody:
    """Build the body of a mesh from one material.

    For several materials, give the places of :func:`voxelise` to ``body_from_array``.

    Args:
        mesh: a mesh of trimesh, or a file that trimesh reads.
        pitch: edge of the voxels, in the mesh's unit.
        material: material of all voxels.
        scale: metres per unit of the mesh, 0.001 for millimetres.
        repair: close holes of three or four edges, and join equal vertices, of a mesh that is not watertight.
        most_voxels: largest number of voxels that :func:`predict` may give.
        most_memory: largest memory that :func:`predict` may give [B].

    Raises:
        ValueError: as :func:`voxelise`, and for a scale that is not positive.
    """
    found = voxelise(mesh, pitch, scale=scale, repair=repair, most_voxels=most_voxels, most_memory=most_memory)
    return body_from_array(found.filled, material, found.pitch)


def _check_scale(scale: object) -> None:
    if not (isinstance(scale, int | float | np.number) and math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale: {scale!r} is not allowed; it must be positive")


def _not_empty(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise ValueError("mesh: it is empty; give a closed surface of triangles")
    return mesh


def _loaded(mesh: Any) -> "trimesh.Trimesh":
    import trimesh  # slow to import

    if isinstance(mesh, str | PathLike):
        try:
            check_plain_file(mesh)
            mesh = trimesh.load_mesh(mesh)
            mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        except Exception as error:  # readers of a dozen formats fail in as many ways
            raise ValueError(f"mesh: {mesh} cannot be read: {said_by(error)}") from None
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if not isinstance(mesh, trimesh.Trimesh):
        raise ValueError(f"mesh: {type(mesh).__name__} is not allowed; give a surface of triangles or its file")
    if len(mesh.faces) and not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise ValueError(f"mesh: a triangle names a vertex that is not among its {len(mesh.vertices)}")
    return mesh


def _check_size(mesh: "trimesh.Trimesh", pitch: float, most_voxels: int, most_memory: float) -> None:
    found = predict(mesh, pitch)
    if found.voxels > most_voxels or found.memory > most_memory:
        hint = ""
        if (longest := float(max(mesh.extents))) > _LARGE and pitch < 1:
            hint = (
                f"; if the mesh, {longest:g} long, is in millimetres, so is the pitch: give {1e3 * pitch:g} for "
                f"{pitch:g} m, and scale 0.001"
            )
        raise ValueError(
            f"pitch: {pitch:g} is too fine, about {found.voxels:,} voxels and {found.memory / 1e9:,.1f} GB; at most "
            f"{most_voxels:,} and {most_memory / 1e9:,.1f} GB are allowed, give a larger one{hint}"
        )


def _closed(mesh: "trimesh.Trimesh", repair: bool) -> "tuple[trimesh.Trimesh, Floats]":
    """Return a closed mesh, repaired if ``repair`` allows, and widths of holes; raise ValueError if it is not closed.

    A hole is as wide as a square of its area.
    """
    from trimesh import repair as mend

    none = np.empty(0)
    if _is_balanced(mesh):
        return mesh, none
    if mesh.is_watertight:  # triangles that look in and out by turns, whose shells wind around nothing
        mesh = mesh.copy()
        mend.fix_normals(mesh)
        return mesh, none

    if repair:
        mesh = mesh.copy()
        mesh.merge_vertices()
        mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
        mesh.remove_unreferenced_vertices()
        count = len(mesh.faces)
        mend.fill_holes(mesh)
        widths = _widths(mesh, count)
        mend.fix_normals(mesh)
        if _is_balanced(mesh):
            return mesh, widths
    edges = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    tried = " and could not be repaired" if repair else ""
    raise ValueError(
        f"mesh: it is not watertight{tried}: {(edges != 2).sum()} of {len(edges)} edges do not join two triangles; "
        "close it"
    )


def _widths(mesh: "trimesh.Trimesh", first: int) -> Floats:
    """Widths of holes that the triangles from number ``first`` on close: of squares of their areas, shape (H,)."""
    from trimesh.graph import connected_component_labels

    areas, pairs = mesh.area_faces[first:], mesh.face_adjacency - first
    patches = connected_component_labels(pairs[(pairs >= 0).all(axis=1)], node_count=len(areas)) if len(areas) else []
    widths = np.sqrt(np.bincount(np.asarray(patches, int), areas))
    return np.asarray(widths[widths > _SLIT * mesh.scale])


def _named(mesh: object) -> str:
    """Words for whose holes they are: of a file's, if it is one."""
    return f" of {Path(mesh).name}" if isinstance(mesh, str | PathLike) else ""


def _warn_of_holes(widths: Floats, pitch: float, scale: float, named: str) -> None:
    """Warn that holes were closed, and strongly of wide ones, as what is missing behind them is a guess.

    Widths and pitch are in the mesh's unit.
    """
    if not len(widths):
        return
    widest = float(widths.max())
    count = f"1 hole{named}," if len(widths) == 1 else f"{len(widths)} holes{named}, the largest"
    told = f"mesh: closed {count} {1e3 * scale * widest:.4g} mm wide"
    if widest > _WIDE * pitch:
        told += f", {widest / pitch:.2g} pitches: the body may lack volume there; view it, or close it where it is made"
    warnings.warn(told, stacklevel=3)


def _is_balanced(mesh: "trimesh.Trimesh") -> bool:
    """Whether triangles pass each edge as often one way as the other: then how often a mesh winds is a whole number.

    It is so of shells that touch, too, where an edge has four triangles.
    """
    ways = np.where(mesh.edges[:, 0] < mesh.edges[:, 1], 1, -1)
    _, edge = np.unique(mesh.edges_sorted, axis=0, return_inverse=True)
    return bool(len(ways)) and not np.bincount(edge.reshape(-1), ways).any()


def _counts(mesh: "trimesh.Trimesh", pitch: float) -> list[int]:
    """Number of grid places along each axis: the length in pitches, rounded; halves go up.

    No place is lost so: the next centres on either side would lie outside of the mesh's box.
    """
    return [max(1, math.floor(float(extent) / pitch + 0.5 + 1e-6)) for extent in mesh.extents]


def _turns(triangles: Floats, counts: Ints) -> Ints:
    """How often a surface winds around each place; ``triangles``, shape (N, 3, 3), are in units of the grid's places.

    A column of places is a line along z. Where it meets a triangle, all places above are wound around once more, if it
    looks down, or once less.
    """
    changes = np.zeros((*counts[:2], counts[2] + 1), np.int16)
    limits = counts[:2] - 1
    for corner in triangles:
        flat = corner[:, :2] - _SHIFT
        low = np.maximum(np.ceil(flat.min(axis=0)), 0).astype(int)
        high = np.minimum(np.floor(flat.max(axis=0)), limits).astype(int)
        (ax, ay), (bx, by), (cx, cy) = flat
        double = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if (high < low).any() or double == 0:
            continue
        x = np.arange(low[0], high[0] + 1)[:, None]
        y = np.arange(low[1], high[1] + 1)[None, :]
        first = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / double  # barycentric coordinates
        second = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / double
        third = 1.0 - first - second
        inside = (first >= 0) & (second >= 0) & (third >= 0)
        height = first * corner[0, 2] + second * corner[1, 2] + third * corner[2, 2]
        i, j = np.nonzero(inside)
        above = np.clip(np.ceil(height[i, j] - _TIE), 0, counts[2]).astype(int)
        changes[i + low[0], j + low[1], above] += -1 if double > 0 else 1  # a column meets a triangle once
    return np.asarray(np.cumsum(changes, axis=2, dtype=np.int16)[:, :, :-1])
