"""What the robots of a batch share in a kernel: integer tables and their columns, channels as plain numbers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, ints
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice.program import QUANTITY_COUNT, Quantity
from taichi_sim.lattice.stages.memory import CHANNEL_WIDTH, PLAN_LENGTH
from taichi_sim.runtime import element, emit

# Columns of the table of links: slots of the two voxels in VOXEL, of the beam in BEAM and of the rest length in REST;
# the components along and across the link's axis; whether both ends are damped alike; numbers of the two voxels.
LINK_MINUS, LINK_PLUS, LINK_BEAM, LINK_REST, LINK_ALONG, LINK_SIDE_1, LINK_SIDE_2 = range(7)
LINK_SYMMETRIC, LINK_FIRST, LINK_SECOND, LINK_COLUMNS = range(7, 11)

# Columns of the table of voxels: slots of the group in CONSTANT/CURRENT (both 9 wide) and of its channels; the surface
# slot and the gauge's slot in STRAIN (-1 without); bits of fixed degrees of freedom; the voxel's own links; the link
# on each side (-1 without); sum of the normals of faces under pressure, and whether there are any; which faces are wet,
# that is, a fluid or sand reaches them, a bit each in the order of ``topology.SIDES``, and then how often its own
# volume the voxel displaces, in units of 1 / VOLUME; its rows in the table of corners.
(GROUP, CHANNELS, SURFACE_SLOT, GAUGE, FIXED, FIRST_LINK, END_LINK, SIDE_LINK) = range(8)
NORMAL, FEELS_PRESSURE, WET, FIRST_CORNER, END_CORNER = 13, 16, 17, 18, 19
VOXEL_COLUMNS = 20
BEHIND_WET, VOLUME = 64, 1024
REST_MINUS, REST_PLUS, REST_AXIS = range(3)

# Reals of a pack of voxels: half the links along each axis, normals, wet faces, which degrees of freedom are held, and
# the start; by axis: 1 with two links, 1 if these or the world hold the voxel on both sides, 1 if one link alone does.
# Last comes how often its own volume the voxel displaces. Wet faces are counted, as -1 where the lower one is alone.
HALF_LINKS, NORMALS, WET_FACES, HELD, START, PAIRED, TENSE, SINGLE, DISPLACED = 0, 3, 6, 9, 15, 18, 21, 24, 27
SHAPE_COLUMNS = 28

# Columns of the table of surface voxels: slots of the voxel in VOXEL and of its group in CONSTANT/CURRENT.
SURFACE_VOXEL, SURFACE_GROUP = range(2)
SURFACE_COLUMNS = 2

# The table of squares has the numbers of the four voxels of each, that of corners the slots of the force in PRESSED.
SQUARE_COLUMNS = 4

CHANNELS_PER_GROUP = QUANTITY_COUNT * CHANNEL_WIDTH


def channels(*quantities: int, count: int = 1) -> tuple[int, ...]:
    """Offsets of channels, of so many consecutive ones from each quantity on, from the first of their group."""
    return tuple((quantity + i) * CHANNEL_WIDTH for quantity in quantities for i in range(count))


SIZING = channels(Quantity.TEMPERATURE) + channels(Quantity.SCALE, count=3)
LOADING = channels(Quantity.ACCELERATION, Quantity.FORCE, count=3) + channels(Quantity.GLOBAL_DAMPING)
MOMENT, ROTATION = channels(Quantity.MOMENT, count=3), channels(Quantity.ROTATION, count=3)
TRANSLATION = channels(Quantity.TRANSLATION, count=3)
PULLING = [channels(Quantity.ACCELERATION + axis, Quantity.FORCE + axis) for axis in range(3)]
RESISTANCE = channels(Quantity.RESISTANCE, count=2)
(PRESSURE,), (STATIC_FRICTION,), (KINETIC_FRICTION,) = map(
    channels, (Quantity.PRESSURE, Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION)
)


class Medium(NamedTuple):
    """What surrounds the robots of a batch.

    Attributes:
        fluid: a fluid at rest.
        relief: ground that is not level, or not alike everywhere.
        water: water on that ground.
        granular: ground that yields.
        balanced: nothing else, but links keep angular momentum as they do where robots float.
    """

    fluid: bool = False
    relief: bool = False
    water: bool = False
    granular: bool = False
    balanced: bool = False

    @property
    def floats(self) -> bool:
        """Whether robots may float."""
        return self.fluid or self.water

    @property
    def balances(self) -> bool:
        """Whether links keep angular momentum; nothing else holds a floating body."""
        return self.floats or self.balanced


class Shared(NamedTuple):
    """What kernels hand to stages in one piece; a kernel fills in what its stages read.

    Attributes:
        plan: where sections lie, how many items there are, what is switched on (see ``memory``).
        link, voxel, rest, square, corner, surface, excluded: the integer tables (see ``tables.Tables``).
        start: start positions [m].
        relief: uneven ground: numbers of all grids, then their cells (see ``ground.cells``).
        time_step, edge, gravity: dt [s], edge h of a voxel [m], acceleration along -z [m/s^2].
        radius: within which voxels are listed as neighbours [m].
        medium: what surrounds the robots, known when the kernel is compiled.
        shape: where voxels lie in lanes: what the table of voxels says of them, as reals by pack (see above).
        packed: whether they do.
        lanes: where such voxels find what they need, see ``packed_lanes.Lanes``.
        grid: where the ground of the robot begins in ``relief`` whose voxels lie in lanes.
        transverse: gives the transverse strains at both ends of links between such voxels.
    """

    plan: Any
    link: Any = None
    voxel: Any = None
    rest: Any = None
    square: Any = None
    corner: Any = None
    surface: Any = None
    excluded: Any = None
    start: Any = None
    time_step: Any = None
    edge: Any = None
    gravity: Any = None
    relief: Any = None
    radius: Any = None
    medium: Medium = Medium()
    shape: Any = None
    packed: bool = False
    lanes: Any = None
    grid: Any = None
    transverse: Any = None


def shared_types(real: Real, medium: Medium, reads: Sequence[str]) -> Shared:
    """Types of what a kernel is given of these fields and the plan, which is all that its stages may read."""
    types = {name: ints(1) for name in ("plan", "link", "voxel", "square", "corner", "surface")}
    types |= {name: ints(2) for name in ("rest", "excluded")}
    types |= {name: real.scalar for name in ("time_step", "edge", "gravity", "radius")}
    types |= {"start": real.scalars(2), "relief": real.scalars(1)}
    read = [name for name in ("plan", *reads) if medium.relief or name != "relief"]
    return Shared(**{name: types[name] for name in read}, medium=medium)


@primitive
def in_variables(shared: Shared) -> Shared:
    """Its numbers and its plan as variables of a kernel: what a kernel is given is read again after every store."""
    numbers = {name: emit(getattr(shared, name)) for name in ("time_step", "edge", "gravity")}
    return shared._replace(plan=plan_in_variables(shared.plan), **numbers)


@primitive
def grid_of(robot: Any, plan: Any) -> Any:
    """Where the ground of a robot begins in ``relief``; a plan ends with that of each robot where it is uneven."""
    return emit(element(plan, robot + PLAN_LENGTH))


@primitive
def plan_in_variables(plan: Any) -> list[Any]:
    """The numbers of a plan as variables of a kernel."""
    return [emit(element(plan, i)) for i in range(PLAN_LENGTH)]
