"""Contact between voxels of one robot: the force law and the watch list's geometry.

Source: Voxelyze's collision model (Hiller & Lipson 2014); surface voxels repel as spheres of 0.625 of their edge.
"""

from taichi_sim.runtime import ti

WATCH_RADIUS = 2.5  # voxel edges: pairs closer than this when the list is built are watched
REBUILD_DISTANCE = 0.5  # voxel edges a surface voxel may move before the list is built again
SPHERE_RADIUS = 0.625  # of the mean rest size


@ti.func
def reach(mean_size_1, mean_size_2):
    """Centre distance [m] at which two voxels begin to touch."""
    return SPHERE_RADIUS * (mean_size_1 + mean_size_2)


@ti.func
def repulsion(overlap, approach, stiffness_1, stiffness_2, damping_1, damping_2):
    """Force [N] along the line of centres: springs in series, mean damping; zero without overlap."""
    stiffness = 2.0 * stiffness_1 * stiffness_2 / (stiffness_1 + stiffness_2)
    damping = 0.5 * (damping_1 + damping_2)
    return ti.select(overlap > 0.0, stiffness * overlap + damping * approach, 0.0)
