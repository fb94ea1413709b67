"""Pressure on a closed surface through the centres of pressurised voxels: it neither pushes nor turns a free body.

The force on every voxel is P dV/dx, V the volume that the surface encloses, as for any pressure on a closed surface
that deforms (Schweizerhof & Ramm, Computers & Structures 18(6), 1984). So the forces add up to nothing, and so do
their torques, whatever the shape; pressure on the faces of each voxel along the voxel's own axes does not do that.

The surface is made of lattice squares, each four pressurised voxels around an edge of the lattice: those of the skin,
where each voxel is linked to the next, and those across cut links in the mouths of a skin that is open, such as the
ends of a flattened tube: as if a film without stiffness closed them. Volumes of several chambers have surfaces of
their own, that share no voxel.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from taichi_sim.autodiff.rotations import cross
from taichi_sim.autodiff.tracing import law
from taichi_sim.lattice.body import LatticeBody

AXES = np.eye(3, dtype=np.int64)
NONE = np.zeros((0, 4), np.int64)
Edge = tuple[int, int]


@law
def pressed_square(x0, y0, z0, x1, y1, z1, x2, y2, z2, x3, y3, z3, p0, p1, p2, p3):
    """Forces [N] on the corners of a square of a closed surface, in order around its outward side.

    Of the volume that the surface encloses, half with either diagonal: a corner feels P/6 (S + T), S the square's
    vector area, T that of the triangle of the corner and its two neighbours. P is the mean of the corners' pressures;
    sums over the surface vanish where all of them have the same.
    """
    ax, ay, az = cross(x2 - x0, y2 - y0, z2 - z0, x3 - x1, y3 - y1, z3 - z1)  # 2 S
    bx, by, bz = cross(x1 - x0, y1 - y0, z1 - z0, x3 - x0, y3 - y0, z3 - z0)  # 2 T of corner 0; of 2: 2 S less this
    cx, cy, cz = cross(x2 - x1, y2 - y1, z2 - z1, x0 - x1, y0 - y1, z0 - z1)  # 2 T of corner 1
    s = (p0 + p1 + p2 + p3) / 48.0
    ux, uy, uz = 2.0 * ax, 2.0 * ay, 2.0 * az
    first, second = (s * (ax + bx), s * (ay + by), s * (az + bz)), (s * (ax + cx), s * (ay + cy), s * (az + cz))
    third, fourth = (s * (ux - bx), s * (uy - by), s * (uz - bz)), (s * (ux - cx), s * (uy - cy), s * (uz - cz))
    return first + second + third + fourth


def enclosed_volume(squares: np.ndarray, positions: Any) -> Any:
    """Volume [m^3] inside a closed surface of squares, shape (Q, 4), for voxel centres [m] of shape (..., V, 3).

    It is negative inside a surface whose outward side looks inwards. Positions may be traced.
    """
    a, b, c, d = np.moveaxis(positions[..., squares, :], -2, 0)
    triangles = ((a, b, c), (a, c, d), (a, b, d), (b, c, d))  # of both diagonals, each with half its weight
    return sum((np.cross(p, q) * r).sum(axis=(-2, -1)) for p, q, r in triangles) / 12.0


def chambers_under_pressure(body: LatticeBody) -> np.ndarray:
    """Labels of the chambers that have pressurised voxels, ascending."""
    return np.unique(np.asarray(body.chambers)[_pressed(body)])


def closed_surface(body: LatticeBody) -> np.ndarray:
    """Corners of the squares around what a body's pressure inflates, in order around the outward side, shape (Q, 4).

    Raises:
        ValueError: if the pressurised voxels do not enclose a volume.
    """
    try:
        return np.concatenate(chamber_surfaces(body) or [NONE])
    except ValueError as error:
        raise ValueError(
            f"pressure_normals: {error}; in a fluid, give a skin that is closed but for cut links"
        ) from None


def chamber_surfaces(body: LatticeBody) -> list[np.ndarray]:
    """The closed surface of each chamber under pressure, ascending: squares as of :func:`closed_surface`.

    Raises:
        ValueError: that names a voxel where a surface is open, and why.
    """
    pressed, labels = _pressed(body), np.asarray(body.chambers)
    skins = [_skin_and_mouths(body, pressed[labels[pressed] == one]) for one in chambers_under_pressure(body)]
    left = np.setdiff1d(pressed, np.concatenate([NONE, *skins]))
    if len(left):
        raise _open_at(body, left[0], "is in no closed surface of pressurised voxels")
    return [_outward(body, squares) for squares in skins]


def _pressed(body: LatticeBody) -> np.ndarray:
    """Numbers of the pressurised voxels."""
    return np.flatnonzero((body.pressure_normals != 0).any(axis=1))  # type: ignore[union-attr]


def _open_at(body: LatticeBody, voxel: int, fault: str) -> ValueError:
    return ValueError(f"voxel {tuple(body.voxels[voxel].tolist())} {fault}")


def _edges(square: Sequence[int]) -> list[Edge]:
    """The sides of a square, each from one corner to the next."""
    return list(zip(square, (*square[1:], square[0]), strict=True))


def _key(edge: Edge) -> Edge:
    return min(edge), max(edge)


def _squares_at_edges(squares: Iterable[Sequence[int]]) -> dict[Edge, list[int]]:
    """Numbers of the squares that have each edge, by its key."""
    found: dict[Edge, list[int]] = defaultdict(list)
    for number, square in enumerate(squares):
        for edge in _edges(square):
            found[_key(edge)].append(number)
    return found


def _skin_and_mouths(body: LatticeBody, pressed: np.ndarray) -> np.ndarray:
    """Lattice squares with all sides linked; and those with cut sides whose linked sides are the rim of the others."""
    place = {tuple(body.voxels[i].tolist()): i for i in pressed.tolist()}
    links = {_key((int(a), int(b))) for a, b in body.topology.links}
    skin, gaps = [], []
    for i in body.topology.order[np.isin(body.topology.order, pressed)].tolist():
        for axis in range(3):
            u, w = AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]
            corners = tuple(place.get(tuple((body.voxels[i] + step).tolist()), -1) for step in (0 * u, u, u + w, w))
            if min(corners) >= 0:
                linked = [_key(edge) in links for edge in _edges(corners)]
                if all(linked):
                    skin.append(corners)
                elif (linked[0] and linked[2]) or (linked[1] and linked[3]):
                    gaps.append(corners)
    sides = _squares_at_edges(skin)
    mouths = [s for s in gaps if all(len(sides[_key(e)]) == 1 for e in _edges(s) if _key(e) in links)]
    return np.array(skin + mouths, np.int64).reshape(-1, 4)


def _outward(body: LatticeBody, squares: np.ndarray) -> np.ndarray:
    """The squares, turned so that neighbours agree and pressure acts along the voxels' normals."""
    sides = _squares_at_edges(squares.tolist())
    for edge, meeting in sides.items():
        if len(meeting) != 2:
            raise _open_at(body, edge[0], f"is where {len(meeting)} squares of the surface meet in an edge, not 2")
    result = squares.copy()
    done = np.zeros(len(squares), bool)
    for first in range(len(squares)):
        if done[first]:
            continue
        done[first] = True
        part, waiting = [first], [first]
        while waiting:
            here = waiting.pop()
            for edge in _edges(result[here].tolist()):
                (other,) = (n for n in sides[_key(edge)] if n != here)
                if edge in _edges(result[other].tolist()):  # neighbours pass along an edge in opposite ways
                    if done[other]:
                        raise _open_at(body, edge[0], "is on a surface with one side only")
                    result[other] = result[other, ::-1]
                if not done[other]:
                    done[other] = True
                    part.append(other)
                    waiting.append(other)
        result[part] = _along_normals(body, result[part])
    return result


def _along_normals(body: LatticeBody, squares: np.ndarray) -> np.ndarray:
    """A connected surface with its outward side where the normals point."""
    corners = body.voxels[squares]
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    along = (area * body.pressure_normals[squares].sum(axis=1)).sum(axis=1)  # type: ignore[index]
    if along.max() > 0 > along.min():
        raise _open_at(body, squares[along.argmin(), 0], "is where the normals point to both sides of the surface")
    return squares if along.max() > 0 else squares[:, ::-1].copy()
