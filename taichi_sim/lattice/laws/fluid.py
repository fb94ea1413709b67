"""Drag of a fluid at rest on the outer faces of voxels: quadratic, pressure drag and friction apart; and shallow water.

A body that moves through a fluid at speed u feels 1/2 rho C A u^2 (Hoerner, Fluid-Dynamic Drag, 1965, ch. III). Here
each outer face feels its share: half of the pressure drag, as front and back of a closed body have half of it each, by
the component of the velocity along its normal; and the friction along it. Wakes are not modelled, nor is added mass in
a fluid all around. Water on the ground adds buoyancy and added mass, both in proportion to what is below its surface,
which stays level: no waves, no slamming, no swimming that lives on added mass alone where bodies turn.
Soft robots have been evolved to swim with drag on faces: Corucci et al., Soft Robotics 5(4), 2018.
"""

from collections.abc import Iterator

import numpy as np
from scipy import ndimage

from taichi_sim.autodiff.lanes import absolute, larger, smaller
from taichi_sim.autodiff.rotations import rotate, rotate_back
from taichi_sim.autodiff.tracing import law, sqrt

MOST_CELLS = 50_000_000  # of the box around a body


@law
def drag(qw, qx, qy, qz, px, py, pz, inverse_mass, size_x, size_y, size_z, normal, tangential, nx, ny, nz):
    """Force [N] on a voxel of momentum p, world frame.

    ``normal`` and ``tangential`` are half the fluid's density times the coefficients of pressure drag and friction
    [kg/m^3]; n counts the voxel's outer faces along each of its own axes.
    """
    ux, uy, uz = rotate_back(qw, qx, qy, qz, px * inverse_mass, py * inverse_mass, pz * inverse_mass)
    speed = sqrt(ux * ux + uy * uy + uz * uz + 1e-30)
    ax = size_y * size_z * nx
    ay = size_z * size_x * ny
    az = size_x * size_y * nz
    half, along = 0.5 * normal, tangential * speed
    fx = 0.0 - (half * ax * absolute(ux) + along * (ay + az)) * ux
    fy = 0.0 - (half * ay * absolute(uy) + along * (az + ax)) * uy
    fz = 0.0 - (half * az * absolute(uz) + along * (ax + ay)) * uz
    return rotate(qw, qx, qy, qz, fx, fy, fz)


@law
def submerged(z, mean_size, edge, level):
    """Share of a voxel that is below a surface at ``level`` over the floor z = -edge/2, 0 to 1."""
    share = (level - 0.5 * edge - z) / mean_size + 0.5
    return smaller(larger(share, 0.0 * share), 1.0 + 0.0 * share)


@law
def water_force(
    qw, qx, qy, qz, px, py, pz, z, inverse_mass, size_x, size_y, size_z, normal, tangential, mean_size, nx, ny, nz,
    displaced, edge, level, weight,
):  # fmt: skip
    """Force [N] of water on a voxel: drag and buoyancy, of the share that is below the surface.

    ``displaced`` is how many times its own volume a voxel displaces, with its share of the body's closed cavities;
    ``weight`` is that of water [N/m^3].
    """
    fx, fy, fz = drag(qw, qx, qy, qz, px, py, pz, inverse_mass, size_x, size_y, size_z, normal, tangential, nx, ny, nz)
    share = submerged(z, mean_size, edge, level)
    lift = weight * displaced * size_x * size_y * size_z
    return share * fx, share * fy, share * (fz + lift)


@law
def slowed_step(z, inverse_mass, size_x, size_y, size_z, mean_size, displaced, edge, level, carried, time_step):
    """Effective time step of a voxel's momentum in water that moves along with it, dt m / (m + m_added).

    ``carried`` is the mass that is carried along per displaced volume [kg/m^3].
    """
    added = carried * displaced * size_x * size_y * size_z * submerged(z, mean_size, edge, level)
    return time_step / (1.0 + added * inverse_mass)


def outer_faces(voxels: np.ndarray) -> np.ndarray:
    """How many faces of each voxel along each axis a fluid or sand around the body reaches, shape (V, 3), 0 to 2.

    Faces of closed cavities are dry, and so are those between neighbouring voxels, linked or not.

    Args:
        voxels: places on the lattice, shape (V, 3), whole numbers.

    Raises:
        ValueError: for a body whose bounding box has too many cells.
    """
    return outer_sides(voxels).reshape(-1, 3, 2).sum(axis=2)


def outer_sides(voxels: np.ndarray) -> np.ndarray:
    """:func:`outer_faces` one by one: 1 for each side that is one, else 0, shape (V, 6), as in ``topology.SIDES``."""
    _, wet, places = _around(voxels)
    return np.column_stack([wet[beside] for _, beside in _neighbours(places)]).astype(np.int64)


def displaced_volumes(voxels: np.ndarray) -> np.ndarray:
    """How many times its own volume each voxel displaces, shape (V,): with its share of the cavities that it closes.

    Every closed cavity is shared equally by the faces around it.

    Raises:
        ValueError: for a body whose bounding box has too many cells.
    """
    label, wet, places = _around(voxels)
    cavity = np.where(wet, 0, label)
    cells = np.bincount(cavity.ravel())
    found = np.ones(len(voxels))
    faces = np.zeros_like(cells)
    for _, beside in _neighbours(places):
        np.add.at(faces, cavity[beside], 1)
    share = np.divide(cells, faces, out=np.zeros(len(cells)), where=faces > 0)
    share[0] = 0.0  # the body itself, and all around
    for _, beside in _neighbours(places):
        found += share[cavity[beside]]
    return found


def _around(voxels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box around a body: empty parts by number, 0 for the body; cells a fluid reaches; places of voxels, (V, 3)."""
    low, high = voxels.min(axis=0) - 1, voxels.max(axis=0) + 1
    shape = high - low + 1
    if np.prod(shape.astype(float)) > MOST_CELLS:
        box = " x ".join(str(n) for n in shape.tolist())
        raise ValueError(f"voxels: a box of {box} cells is too large for a fluid or sand; at most {MOST_CELLS:,}")
    places = voxels - low
    filled = np.zeros(shape, bool)
    filled[tuple(places.T)] = True
    label, _ = ndimage.label(~filled)
    return label, label == label[0, 0, 0], places


def _neighbours(places: np.ndarray) -> Iterator[tuple[int, tuple[np.ndarray, ...]]]:
    """Axis and cells on each side of places."""
    for axis in range(3):
        for side in (-1, 1):
            beside = places.copy()
            beside[:, axis] += side
            yield axis, tuple(beside.T)
