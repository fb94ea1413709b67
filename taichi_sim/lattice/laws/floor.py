"""The floor z = -h/2: normal force and stick-slip friction (Voxelyze's CVX_Voxel::floorForce)."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import law, select, sqrt


@law
def penetration(mean_size, edge, z):
    """Depth [m] of the voxel's lower side below the floor; negative above it."""
    return 0.5 * mean_size - 0.5 * edge - z


@law
def floor_force(fz, vz, depth, stiffness, contact_damping):
    """Add the floor's damped normal force to a vertical force [N]; also return the undamped one."""
    normal = stiffness * depth
    return fz + select(depth >= 0.0, normal - contact_damping * vz, 0.0), normal


@law
def slip_friction(vx, vy, kinetic_friction, normal, depth, sticks):
    """:func:`sliding_friction` of a voxel that touches the floor and does not stick to it."""
    rx, ry = sliding_friction(vx, vy, kinetic_friction, normal)
    slides = (depth >= 0.0) & (sticks < 0.5)
    return select(slides, rx, 0.0), select(slides, ry, 0.0)


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


@law
def stopped(px, py, stuck):
    """Horizontal momentum of a voxel that may stick to the floor."""
    free = stuck < 0.5
    return select(free, px, 0.0), select(free, py, 0.0)
