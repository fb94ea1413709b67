"""Two-part casting moulds of voxel bodies: a flat parting plane, drafted cavities, a wall all around.

The halves are pulled apart along one axis, so nothing of the body may lie behind a hole seen from the parting plane:
every column of voxels along that axis is one piece that reaches the plane. Walls of the cavity lean by the draft: at a
distance d from the end of the deeper half, the cavity is d tan(draft) wider on each side than the body.

A half is built of cells whose planes lean. Each plane between voxels becomes two, which stand where the walls beside it
are; the cavity fills what lies between two planes if a voxel beside them does. So walls have exactly the draft. Both
halves are equally wide at the parting plane, so that the seam has no step.
"""

import math
from dataclasses import dataclass

import numpy as np

from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import number, positive
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.files.arrays import array_of_body
from taichi_sim.lattice.files.surface import GAP, Surface, cell_surface

AXES = "xyz"
STEEPEST = 45.0  # draft [degrees]


@dataclass(frozen=True, eq=False)
class Mould:
    """A two-part mould, where it lies around the body.

    Attributes:
        lower: the half at the lower end of the axis [m]; a plate where the body ends in the parting plane.
        upper: the other half [m].
        pull: axis along which the halves part, ``"x"``, ``"y"`` or ``"z"``.
        parting: place of the parting plane on it [m].
    """

    lower: Surface
    upper: Surface
    pull: str
    parting: float


def mould_of(body: LatticeBody, draft: float = 2.0, wall: float = 3e-3, pull: str | None = None) -> Mould:
    """Build the mould of a body that nothing deforms.

    Args:
        body: of voxels whose materials have one ``scale``, the same along all axes.
        draft: of the walls along the pull, 0 to 45 [degrees].
        wall: thickness of the mould around its cavity where that is widest, and at its ends [m].
        pull: axis along which the halves part; None: z, or else x, or else y, the first that leaves no undercut.

    Raises:
        ValueError: for values that are not allowed, a draft too wide for so deep a body, and bodies with undercuts:
            it names the first voxel that locks.
    """
    number("draft", draft, 0.0, STEEPEST, "degrees")
    positive("wall", wall)
    if pull is not None and pull not in AXES:
        raise ValueError(f"pull: {pull!r} is not allowed; give x, y or z")
    scales = {scale for n in np.unique(body.material_index) for scale in body.materials[n].scale}
    if len(scales) > 1:
        raise ValueError(f"scale: {', '.join(f'{s:g}' for s in sorted(scales))} differ; give all materials one")
    filled, edge = array_of_body(body) > 0, body.voxel_size * scales.pop()
    axis, plane = _parting(filled, (2, 0, 1) if pull is None else (AXES.index(pull),))
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    turned = filled.transpose(order)
    depth = max(plane, turned.shape[2] - plane)
    lean = math.tan(math.radians(draft))
    if depth * lean >= 0.5 - GAP:
        most = math.degrees(math.atan((0.5 - GAP) / depth))
        raise ValueError(
            f"draft: {draft:g} degrees over {1e3 * depth * edge:g} mm widen the cavity by half a voxel and more; "
            f"give less than {math.floor(100 * most) / 100:g}"
        )
    start, back = body.voxels.min(axis=0) - 0.5, np.argsort(order)

    def placed(half: Surface, way: int) -> Surface:
        vertices = half.vertices * [1, 1, way] + [0, 0, plane]
        return Surface((vertices[:, back] + start) * edge, half.faces[:, ::way])

    lower = placed(_half(turned[:, :, :plane][:, :, ::-1], depth * lean, lean, wall / edge), -1)
    upper = placed(_half(turned[:, :, plane:], depth * lean, lean, wall / edge), 1)
    return Mould(lower, upper, AXES[axis], float((start[axis] + plane) * edge))


def _parting(filled: Bools, axes: tuple[int, ...]) -> tuple[int, int]:
    """The first axis that leaves no undercut, and its parting plane: the one with the shallowest halves.

    Raises:
        ValueError: if there is none; tells what locks along the first axis.
    """
    for axis in axes:
        columns = np.moveaxis(filled, axis, 2)
        planes = [p for p in range(columns.shape[2] + 1) if not _overhung(columns, p).any()]
        if planes:
            middle = columns.shape[2] / 2
            return axis, min(planes, key=lambda p: (abs(p - middle), p))
    columns = np.moveaxis(filled, axes[0], 2)
    fewest = min(range(columns.shape[2] + 1), key=lambda p: int(_overhung(columns, p).sum()))
    place = np.argwhere(_overhung(columns, fewest))[0]
    voxel = np.insert(place[:2], axes[0], place[2])
    tried = " or ".join(AXES[a] for a in axes)
    raise ValueError(
        f"pull: undercut at voxel ({', '.join(map(str, voxel))}), counted from the body's lowest corner: the cavity "
        f"above or below it does not reach a parting plane, so no two-part mould opens along {tried}"
    )


def _overhung(columns: Bools, plane: int) -> Bools:
    """Which voxels have an empty place between themselves and a parting plane, shape (X, Y, Z)."""
    up, down = columns[:, :, plane:], columns[:, :, :plane][:, :, ::-1]
    locks = [half & ~np.logical_and.accumulate(half, axis=2) for half in (up, down)]
    return np.concatenate([locks[1][:, :, ::-1], locks[0]], axis=2)


def _half(filled: Bools, widest: float, lean: float, wall: float) -> Surface:
    """The half of a mould whose columns begin at its parting plane z = 0; all lengths in voxels.

    Args:
        filled: places of the body in it, shape (X, Y, Z).
        widest: how much wider than the body the cavity is on each side at the parting plane.
        lean: of the walls, their draft's tangent.
        wall: thickness.
    """
    height = filled.shape[2]
    cavity = _between(_between(filled, 0), 1)
    block = np.pad(~cavity, ((1, 1), (1, 1), (0, 1)), constant_values=True)
    surface = cell_surface(np.argwhere(block))
    z = surface.places[:, 2]
    heights = np.append(np.arange(height + 1.0), height + wall)
    away = widest - np.minimum(heights, height) * lean + GAP  # how far planes have moved at each height
    outer = widest + GAP + wall
    across = []
    for axis in (0, 1):
        count = filled.shape[axis]
        middles = np.concatenate([[0.0], np.repeat(np.arange(count + 1.0), 2), [count]])
        moves = np.concatenate([[0.0], np.tile([-1.0, 1.0], count + 1), [0.0]])
        ends = np.concatenate([[-outer], np.zeros(2 * count + 2), [outer]])
        across.append(_at(surface.places[:, axis], middles + ends) + _at(surface.places[:, axis], moves) * _at(z, away))
    vertices = np.stack([*across, _at(z, heights)], axis=1)
    return Surface(vertices + surface.shifts * GAP, surface.faces)


def _between(filled: Bools, axis: int) -> Bools:
    """Places and the strips between them along an axis: a strip is filled if a place beside it is."""
    before = np.concatenate([filled, np.zeros_like(np.take(filled, [0], axis))], axis)
    after = np.roll(before, 1, axis)
    strips, shape = before | after, list(filled.shape)
    shape[axis] = 2 * shape[axis] + 1
    found = np.zeros(shape, bool)
    index: list[slice] = [slice(None)] * 3
    index[axis] = slice(0, None, 2)
    found[tuple(index)] = strips
    index[axis] = slice(1, None, 2)
    found[tuple(index)] = filled
    return found


def _at(places: Floats, values: Floats) -> Floats:
    """Values at whole numbers, and half-way between their neighbours at halves."""
    return np.interp(places, np.arange(len(values)), values)
