"""The floor z = -h/2: normal force and stick-slip friction (Voxelyze's CVX_Voxel::floorForce)."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import law, select, sqrt


@law
def penetration(mean_size, edge, z):
    """Depth [m] of the voxel's lower side below the floor; negative above it."""
    return 0.5 * mean_size - 0.5 * edge - z


@law
def breaks_loose(fx, fy, static_friction, normal):
    """Whether a sticking voxel is pulled harder than static friction holds."""
    limit = static_friction * normal
    return fx * fx + fy * fy > limit * limit


@law
def sliding_friction(vx, vy, kinetic_friction, normal):
    """Coulomb friction [N] against the slip velocity; zero at rest."""
    speed_squared = vx * vx + vy * vy
    moving = speed_squared > 1e-30
    k = select(moving, kinetic_friction * normal / sqrt(larger(speed_squared, 1e-30)), 0.0)
    return 0.0 - k * vx, 0.0 - k * vy


@law
def comes_to_rest(px, py, friction_x, friction_y, ux, uy, inverse_mass):
    """Whether friction's work over this step uses up the horizontal kinetic energy."""
    kinetic = 0.5 * inverse_mass * (px * px + py * py)
    return kinetic + (friction_x * ux + friction_y * uy) <= 0.0
