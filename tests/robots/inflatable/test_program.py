"""Programs of levels between 0 and 1: what bladders do, how they meet on and off, and derivatives."""

import itertools

import numpy as np
import pytest
from graded import pulled_back, tabled, unskipped
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from program_values import values_after

from robots.inflatable import ACTUATION, INCHING, ROLLING, InflatableActuation, InflatableDesign
from robots.inflatable.body import BLADDER_REGIONS, FIRST_BLADDER, FOOT_1, FOOT_2, REGION_COUNT, SKIN
from robots.inflatable.gradient import check_alike
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import Counting, full_stroke_steps, play, rest_levels
from robots.world import Terrain, gravity_vector
from taichi_sim.lattice import LatticeProgram, Quantity

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=20, settle_steps=30)
HILL = Terrain(slope=15.0)


def random_design(generator: np.random.Generator, columns: int = 3, core: bool = False) -> InflatableDesign:
    tables = generator.uniform(0.05, 0.95, (8, columns)), generator.uniform(0.05, 0.95, (2, columns))
    pressure = generator.uniform(2e3, 9e3, columns) if core else None
    return InflatableDesign(generator.uniform(2e3, 9e3), generator.uniform(10.0, 80.0), tabled(*tables, 2, pressure))


def moved(design: InflatableDesign, direction: dict[str, np.ndarray], h: float) -> InflatableDesign:
    """The design, h further in a direction."""
    gait = design.schedule
    core = None if gait.core_pressure is None else gait.core_pressure + h * direction["core_pressure"]
    inflation, grip = gait.inflation + h * direction["inflation"], gait.grip + h * direction["grip"]
    return InflatableDesign(
        design.pressure + h * direction["pressure"],
        design.orientation + h * direction["orientation"],
        tabled(inflation, grip, gait.repeats, core),
    )


def random_direction(generator: np.random.Generator, columns: int = 3) -> dict[str, np.ndarray]:
    """In parts of like effect."""
    return {
        "pressure": 1e3 * generator.normal(),
        "orientation": 10.0 * generator.normal(),
        "inflation": 0.1 * generator.normal(size=(8, columns)),
        "grip": 0.1 * generator.normal(size=(2, columns)),
        "core_pressure": 1e3 * generator.normal(size=columns),
    }


def channel(program: LatticeProgram, region: int, quantity: int, robot: int = 0) -> np.ndarray:
    """What a channel is in every step: before its first event what materials say, a scale of 1 or else nothing."""
    steps = np.arange(1, program.lengths[robot] + 1)
    events = program.events[(program.events["region"] == region) & (program.events["quantity"] == quantity)]
    before = 1.0 if quantity < Quantity.SCALE + 3 else 0.0
    values = values_after(program, robot, region, quantity, steps)
    if values is None:
        return np.full(len(steps), before)
    return np.where(steps > events["step"][events["robot"] == robot].min(), values, before)


def history(program: LatticeProgram) -> np.ndarray:
    """Every channel of a robot in every step."""
    quantities = [*range(Quantity.SCALE, Quantity.SCALE + 3), *range(Quantity.STATIC_FRICTION, Quantity.FORCE)]
    return np.array([channel(program, r, q) for r in range(REGION_COUNT) for q in quantities])


def essential(program: LatticeProgram) -> dict[tuple[int, ...], list[tuple[float, ...]]]:
    """Events of every channel without those overruled in their step and those that change nothing."""
    kept: dict[tuple[int, ...], dict[int, tuple[float, float]]] = {}
    for event in program.events[np.argsort(program.events["step"], kind="stable")].tolist():
        robot, step, region, quantity, value, rate = event
        kept.setdefault((robot, region, quantity), {})[step] = value, rate
    found = {}
    for key, events in kept.items():
        found[key] = [(-1, np.nan, 0.0)]
        for step, (value, rate) in events.items():
            if (value, rate) != found[key][-1][1:] or rate != 0:
                found[key].append((step, value, rate))
    return {key: events[1:] for key, events in found.items()}


@st.composite
def full_stroke_gaits(draw):
    """Binary gaits in which some bladder makes a full stroke in every column."""
    count = draw(st.integers(1, 4))
    bits = np.array(draw(st.lists(st.lists(st.booleans(), min_size=count, max_size=count), min_size=10, max_size=10)))
    played = np.concatenate([np.zeros((8, 1), bool), np.tile(bits[:8], 2)], axis=1)
    assume((played[:, 1:] != played[:, :-1]).any(axis=0).all())
    return GaitSchedule(bits)


@pytest.mark.long
@given(
    full_stroke_gaits(),
    st.floats(0, 15e3),
    st.floats(0, 90),
    st.sampled_from(
        [ACTUATION, QUICK, InflatableActuation(weight="physical"), InflatableActuation(inflation_rate=0.013)]
    ),
)
def test_gaits_without_idle_columns_have_one_program_to_the_bit(schedule, pressure, orientation, actuation):
    design = InflatableDesign(pressure, orientation, schedule)
    skipping = build_program([design], HILL, actuation)
    waiting = build_program([unskipped(design)], HILL, actuation)
    assert waiting.lengths.tolist() == skipping.lengths.tolist()
    assert waiting.snapshots.tolist() == skipping.snapshots.tolist()
    assert essential(waiting) == essential(skipping)


def test_the_published_gaits_have_no_idle_columns():
    designs = [INCHING, ROLLING, InflatableDesign(5e3, 30.0, INCHING.schedule)]
    waiting = build_program([unskipped(d) for d in designs], HILL)
    skipping = build_program(designs, HILL)
    assert essential(waiting) == essential(skipping)
    assert waiting.lengths.tolist() == skipping.lengths.tolist()


def test_idle_columns_end_after_one_step_unless_the_schedule_waits():
    bits = np.zeros((10, 4), bool)
    bits[0, 1:3] = True  # columns 1 and 3 move nothing
    design = InflatableDesign(0.0, 0.0, GaitSchedule(bits, 1))
    moving, idle = 7668 + 4001, 1 + 4001
    program = build_program([design, unskipped(design)], Terrain())
    assert np.diff(program.snapshots).ravel().tolist() == [
        2 * moving + 2 * idle + 1,
        2 * moving + 2 * (7669 + 4001) + 1,
    ]


def test_empty_and_full_are_where_published_strokes_end():
    assert rest_levels(ACTUATION) == (0.19970000000000016, 2.5001000000001676)
    assert full_stroke_steps(ACTUATION) == 7668


def held(inflation: list[float], grip: float = 0.0, repeats: int = 1, **others) -> InflatableDesign:
    """All bladders the same in every column."""
    table = np.tile(inflation, (8, 1))
    return InflatableDesign(6e3, 90.0, tabled(table, np.full((2, len(inflation)), grip), repeats, **others))


@settings(max_examples=50)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=5), st.sampled_from([0.05, 0.0031]))
def test_bladders_go_to_their_level_at_their_rate_and_arrive_exactly(inflation, rate):
    """Against the rule itself, step by step: the level is the target's, held within n rates of where it began."""
    actuation = InflatableActuation(inflation_rate=rate, hold_steps=0, settle_steps=7, ramp_steps=1)
    empty, full = rest_levels(actuation)
    program = build_program([held(inflation)], Terrain(), actuation)
    thickness = channel(program, FIRST_BLADDER, Quantity.SCALE + 2)
    timing = play(held(inflation).schedule.project(), actuation)[0]
    level, step = actuation.deflated, 1
    for u, column in zip(inflation, timing, strict=True):
        steps = (column.motion_steps if column.motion.moving.any() else full_stroke_steps(actuation) + 1) + 7
        n = np.arange(1, steps + 1)
        target = empty + u * (full - empty)
        path = np.clip(target, level - n * rate, level + n * rate)
        if target < level <= actuation.deflated:
            path[:] = level
        assert thickness[step : step + steps] == pytest.approx(path, abs=1e-5 * rate)
        level, step = path[-1], step + steps
    assert step == len(thickness)


def test_half_a_bladder_has_half_the_growth_and_half_the_weight_and_half_a_grip_half_the_friction():
    program = build_program([held([0.5], grip=0.5)], HILL)
    last = program.lengths[0] - 1
    settle = last - ACTUATION.settle_steps
    empty, full = rest_levels(ACTUATION)
    thickness = (empty + full) / 2
    scale = [channel(program, FIRST_BLADDER, Quantity.SCALE + axis)[last] for axis in range(3)]
    assert scale == pytest.approx([1 + (thickness - 0.2) / 20, 1 + (thickness - 0.2) / (1.7 + 8.3 / 2), thickness])
    begin = ACTUATION.initial_steps(6e3)
    weight = channel(program, FIRST_BLADDER, Quantity.ACCELERATION + 2)
    pull = gravity_vector(15.0, 90.0)[2]
    assert weight[[0, begin - 1, begin, begin + 3000, last]] == pytest.approx([pull, pull, 0.0, 0.0, 0.5 * pull])
    for foot in (FOOT_1, FOOT_2):
        friction = channel(program, foot, Quantity.KINETIC_FRICTION)
        assert friction[[begin, settle, settle + 1]] == pytest.approx([(2.0 + 1e-4) / 2, (2.0 + 1e-4) / 2, 2.0])


@pytest.mark.long
@given(st.integers(0, 2000), st.sampled_from([True, False]))
def test_the_program_is_continuous_where_arrivals_change_their_step(seed, core):
    """Up to 1e-9 away on either side of the levels from which a bladder needs whole steps."""
    generator = np.random.default_rng(seed)
    empty, full = rest_levels(QUICK)
    whole = (QUICK.inflation_rate * generator.integers(1, 40, (8, 2)) + QUICK.deflated - empty) / (full - empty)
    pressure = np.array([3e3, 8e3]) if core else None

    def run(h: float) -> np.ndarray:
        gait = tabled(whole + h, np.full((2, 2), 0.3), 2, pressure)
        return history(build_program([InflatableDesign(5e3, 30.0, gait)], HILL, QUICK))

    assert np.abs(run(1e-9) - run(-1e-9)).max() < 1e-9 * 20 * (full - empty) / QUICK.inflation_rate


@pytest.mark.long
@pytest.mark.parametrize(
    ("core", "weight", "ramp_steps"),
    [  # every value once; the other ways to combine them are validations
        pytest.param(
            *each, marks=() if each in ((False, "published", None), (True, "physical", 100)) else pytest.mark.slow
        )
        for each in itertools.product((False, True), ("published", "physical"), (None, 100))
    ],
)
@given(st.integers(0, 10_000))
@settings(max_examples=4)
def test_derivatives_agree_with_differences(core, weight, ramp_steps, seed):
    """Of every event's value and rate, through cotangents on all of them."""
    generator = np.random.default_rng(seed)
    actuation = InflatableActuation(inflation_rate=0.05, settle_steps=30, weight=weight, ramp_steps=ramp_steps)
    designs = [random_design(generator, core=core) for _ in range(2)]
    directions = [random_direction(generator) for _ in designs]
    build = lambda h: build_program(  # noqa: E731
        [moved(d, v, h) for d, v in zip(designs, directions, strict=True)], HILL, actuation
    )
    h = 1e-4
    program, moves = build(0.0), [build(n * h).events for n in (1, -1, 2, -2)]
    labels = ["robot", "region", "quantity"] + ["step"] * (ramp_steps is not None)
    assume(all(np.array_equal(events[n], moves[0][n]) for events in moves for n in labels))
    for field, other in (("value", "rate"), ("rate", "value")):
        one, minus_one, two, minus_two = (events[field] for events in moves)
        change = (8 * (one - minus_one) - (two - minus_two)) / (12 * h)
        for event in generator.choice(np.flatnonzero(np.abs(change) > 1e-6), 6):
            cotangents = {field: np.arange(len(change)) == event, other: np.zeros(len(change))}
            found = pulled_back(program, designs, HILL, actuation, cotangents["value"], cotangents["rate"])
            along = sum(
                np.sum(slope * direction[part])
                for slopes, direction in zip(found, directions, strict=True)
                for part, slope in slopes.items()
            )
            assert along == pytest.approx(change[event], rel=1e-8, abs=1e-8)


def summed(program: LatticeProgram, quantity: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum over all bladders and steps of a quantity, and its derivatives by the events' values and rates."""
    total, (values, rates) = 0.0, np.zeros((2, len(program.events)))
    for region in BLADDER_REGIONS:
        total += channel(program, region, quantity).sum()
        mine = np.flatnonzero((program.events["region"] == region) & (program.events["quantity"] == quantity))
        mine = mine[np.argsort(program.events["step"][mine], kind="stable")]
        lasting = np.diff([*program.events["step"][mine], program.lengths[0]])
        values[mine], rates[mine] = lasting, lasting * (lasting - 1) / 2
    return total, values, rates


@pytest.mark.parametrize("quantity", [*range(3), *range(Quantity.ACCELERATION, Quantity.ACCELERATION + 3)])
def test_derivatives_of_on_and_off_look_inwards(quantity):
    """Where bladders fill up in whole steps: of sums over time, to the share of one step."""
    bits = np.eye(8, 3, dtype=bool) | np.eye(8, 3, -3, dtype=bool)
    table, h = bits.astype(float), 1e-6
    actuation = InflatableActuation(inflation_rate=3e-3, hold_steps=5, settle_steps=100)

    def build():
        designs = [InflatableDesign(6e3, 30.0, tabled(table, np.zeros((2, 3)), 2))]
        return designs, build_program(designs, HILL, actuation)

    designs, program = build()
    total, values, rates = summed(program, quantity)
    gradient = pulled_back(program, designs, HILL, actuation, values, rates)[0]["inflation"]
    for bladder, t in np.argwhere(bits):
        table[bladder, t] = 1 - h
        change = (total - summed(build()[1], quantity)[0]) / h
        table[bladder, t] = 1
        assert gradient[bladder, t] == pytest.approx(change, rel=5e-3, abs=10.0)


def test_the_pull_back_has_the_shapes_of_the_design_and_adds_up_over_events():
    generator = np.random.default_rng(0)
    designs = [random_design(generator, 4, core=True)]
    program = build_program(designs, HILL, QUICK)
    values, rates = generator.normal(size=(2, len(program.events)))
    none = np.zeros(len(values))
    whole, first, second = (
        pulled_back(program, designs, HILL, QUICK, *given)[0]
        for given in ((values, rates), (values, none), (none, rates))
    )
    shapes = {"pressure": (), "orientation": (), "inflation": (8, 4), "grip": (2, 4), "core_pressure": (4,)}
    for part, shape in shapes.items():
        assert whole[part].shape == shape
        assert whole[part] == pytest.approx(first[part] + second[part], rel=1e-9, abs=1e-9)


def test_a_constant_core_pressure_is_the_pressure_of_the_design():
    generator = np.random.default_rng(1)
    plain = random_design(generator)
    gait = plain.schedule
    told = tabled(gait.inflation, gait.grip, 2, np.full(3, plain.pressure))
    with_core = InflatableDesign(plain.pressure, plain.orientation, told)
    one, two = (history(build_program([d], HILL, QUICK)) for d in (plain, with_core))
    assert one == pytest.approx(two, abs=1e-9)


def test_the_core_pressure_changes_linearly_during_motion_and_bladders_lengthen_with_it():
    design = held([1.0, 0.5], repeats=2, core_pressure=[12e3, 0.0])
    program = build_program([design], Terrain(), InflatableActuation(ramp_steps=6000))
    pressure = channel(program, SKIN, Quantity.PRESSURE)
    begin, column = 8000, 7668 + 4001
    assert pressure[[3000, 6000, begin - 1]] == pytest.approx([3e3, 6e3, 6e3])
    settled = begin + 7668 + np.arange(4001)
    assert (pressure[settled] == 12e3).all() and pressure[begin + 3833] == pytest.approx(9e3)
    ends = begin + column - 1, begin + column + 7669 + 4000
    assert pressure[list(ends)].tolist() == [12e3, 0.0]
    length = channel(program, BLADDER_REGIONS[0], Quantity.SCALE + 1)
    empty, full = rest_levels(ACTUATION)
    assert length[ends[0]] == pytest.approx(1 + (full - 0.2) / 10.0)
    assert length[ends[1]] == pytest.approx(1 + ((empty + full) / 2 - 0.2) / 1.7)


def test_a_ramp_of_given_steps_makes_all_programs_equally_long():
    gait = held([0.3, 0.8]).schedule
    designs = [InflatableDesign(p, 0.0, gait) for p in (0.0, 6e3, 15e3)]
    program = build_program(designs, Terrain(), InflatableActuation(ramp_steps=3000))
    assert len(set(program.lengths.tolist())) == 1 and (program.snapshots[:, 0] == 5000).all()
    ramp = channel(program, SKIN, Quantity.PRESSURE, robot=1)
    assert ramp[[0, 1500, 2999, 3000, 5000]] == pytest.approx([0.0, 3e3, 6e3 * 2999 / 3000, 6e3, 6e3])


def test_columns_without_a_stroke_last_as_long_as_one():
    quiet = build_program([held([0.4, 0.4])], Terrain(), ACTUATION)
    assert np.diff(quiet.snapshots[0]) == 2 * (7669 + 4001)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: check_alike([held([0.1]), held([0.1, 0.2])]), "designs: a mix"),
        (lambda: check_alike([held([0.1]), held([0.1], core_pressure=[0.0])]), "designs: a mix"),
        (lambda: InflatableActuation(ramp_steps=0), "ramp_steps: 0 is not allowed"),
        (lambda: Counting(warm_up=-1), "warm_up: -1 is not allowed"),
        (
            lambda: build_program([held([0.1])], HILL, QUICK, counting=Counting(10**6)),
            "warm_up: 1000000 is not allowed",
        ),
    ],
)
def test_bad_arguments_are_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}.*$"):
        build()
