"""Contact between voxels of one robot: the force law and the geometry of the list of neighbours.

Source: Voxelyze's collision model (Hiller & Lipson 2014); surface voxels repel as spheres of 0.625 of their edge.
"""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import law, select, sqrt

NEIGHBOUR_RADIUS = 2.5  # voxel edges: the list holds the pairs that are closer than this when it is built
REBUILD_DISTANCE = 0.5  # voxel edges that a surface voxel may move before the list is built again
SPHERE_RADIUS = 0.625  # of the mean rest size


@law
def reach(mean_size_1, mean_size_2):
    """Centre distance [m] at which two voxels begin to touch."""
    return SPHERE_RADIUS * (mean_size_1 + mean_size_2)


@law
def of_both(stiffness_1, stiffness_2, damping_1, damping_2):
    """Stiffness and damping of the contact of two voxels: springs in series, mean damping."""
    return 2.0 * stiffness_1 * stiffness_2 / (stiffness_1 + stiffness_2), 0.5 * (damping_1 + damping_2)


@law
def repulsion(overlap, approach, stiffness_1, stiffness_2, damping_1, damping_2):
    """Force [N] along the line of centres; zero without overlap."""
    stiffness, damping = of_both(stiffness_1, stiffness_2, damping_1, damping_2)
    return select(overlap > 0.0, stiffness * overlap + damping * approach, 0.0)


@law
def force_between(dx, dy, dz, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near):
    """Force on the second of two voxels d apart, with momenta p and q, where they are near; the first feels -F."""
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / larger(distance, 1e-12)
    approach = ((w1 * px - w2 * qx) * dx + (w1 * py - w2 * qy) * dy + (w1 * pz - w2 * qz) * dz) * inverse
    scale = select(near, repulsion(limit - distance, approach, k1, k2, c1, c2) * inverse, 0.0)
    return scale * dx, scale * dy, scale * dz


@law
def pair_force(x1, y1, z1, px, py, pz, x2, y2, z2, qx, qy, qz, size1, size2, w1, w2, k1, k2, c1, c2, near):
    """:func:`force_between` two voxels, from their positions, momenta and mean sizes."""
    limit = reach(size1, size2)
    return force_between(x2 - x1, y2 - y1, z2 - z1, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near)
