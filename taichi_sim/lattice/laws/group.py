"""What the channels of a group of voxels make of it: rest sizes, external force, damping, rest lengths of links."""

from taichi_sim.autodiff.tracing import law


@law
def channel_value(base, rate, age):
    """Value of a channel so many steps after the event that set it."""
    return base + rate * age


@law
def grown_scales(expansion, temperature, scale_x, scale_y, scale_z):
    """Rest sizes in voxel edges of a material that its temperature swells."""
    warmth = 1.0 + expansion * temperature
    return scale_x * warmth, scale_y * warmth, scale_z * warmth


@law
def group_state(
    expansion,
    temperature,
    scale_x,
    scale_y,
    scale_z,
    mass,
    ax,
    ay,
    az,
    fx,
    fy,
    fz,
    zeta,
    drag,
    spin_drag,
    edge,
    gravity,
):
    """Rest sizes [m] and their mean, external force on a voxel [N], damping coefficients of translation and rotation.

    The external force is that of an acceleration a and a force F; ``zeta`` is the damping ratio against the world,
    ``drag`` and ``spin_drag`` are the critical coefficients of translation and rotation.
    """
    sx, sy, sz = grown_scales(expansion, temperature, scale_x, scale_y, scale_z)
    # Exactly h for unit scales: a voxel that starts on the floor must touch it, or it would not stick.
    mean = edge * ((sx + sy + sz) / 3.0)
    push = mass * ax + fx, mass * ay + fy, mass * (az - gravity) + fz
    return edge * sx, edge * sy, edge * sz, mean, push[0], push[1], push[2], zeta * drag, zeta * spin_drag


@law
def rest_length(minus, plus):
    """Rest length L0 = (r- + r+)/2 [m] of a link between voxels of these sizes, and its inverse."""
    length = 0.5 * (minus + plus)
    return length, 1.0 / length
