"""Drag of a fluid at rest on the outer faces of voxels: quadratic, pressure drag and friction apart.

A body that moves through a fluid at speed u feels 1/2 rho C A u^2 (Hoerner, Fluid-Dynamic Drag, 1965, ch. III). Here
each outer face feels its share: half of the pressure drag, as front and back of a closed body have half of it each, by
the component of the velocity along its normal; and the friction along it. Neither added mass nor wakes are modelled.
Soft robots have been evolved to swim with drag on faces: Corucci et al., Soft Robotics 5(4), 2018.
"""

import numpy as np
from scipy import ndimage

from taichi_sim.autodiff.lanes import absolute
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


def outer_faces(voxels: np.ndarray) -> np.ndarray:
    """How many faces of each voxel along each axis a fluid around the body reaches, shape (V, 3), 0 to 2.

    Faces of closed cavities are dry, and so are those between neighbouring voxels, linked or not.

    Args:
        voxels: places on the lattice, shape (V, 3), whole numbers.

    Raises:
        ValueError: for a body whose bounding box has too many cells.
    """
    low, high = voxels.min(axis=0) - 1, voxels.max(axis=0) + 1
    shape = high - low + 1
    if np.prod(shape.astype(float)) > MOST_CELLS:
        box = " x ".join(str(n) for n in shape.tolist())
        raise ValueError(f"voxels: a box of {box} cells is too large for a fluid; up to {MOST_CELLS:,} are allowed")
    filled = np.zeros(shape, bool)
    filled[tuple((voxels - low).T)] = True
    label, _ = ndimage.label(~filled)
    wet = label == label[0, 0, 0]
    faces = np.zeros((len(voxels), 3), np.int64)
    for axis in range(3):
        for side in (-1, 1):
            beside = voxels - low
            beside[:, axis] += side
            faces[:, axis] += wet[tuple(beside.T)]
    return faces
