"""The reverse pass of the laws against Taichi's own reverse mode, and its rules against calculus."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim import runtime
from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.lanes import Real, absolute, larger, smaller
from taichi_sim.autodiff.tracing import law, primitive, pull_back, select, sqrt
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import contact, enclosure, floor, fluid, group, motion
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.stages import momentum, voxel
from taichi_sim.lattice.stages.link import whole_link
from taichi_sim.lattice.stages.undo import in_parts
from taichi_sim.runtime import ti

EDGE, DT = 0.01, 1e-4


@law
def everything(x, y, z):
    """One of each operation."""
    a = 2.0 * x + y * 3.0 - z / 2.0 + (1.0 - x) + 4.0 / y - 0.5
    b = sqrt(x * x + y * y) * absolute(z) / larger(smaller(y, 9.0), 0.1)
    c = select((x > z) & (y >= 0.0) | (z < -5.0), a * b, a - b)
    return c + 0.0 * x, a, b * c


numbers = st.floats(0.2, 3.0, allow_subnormal=False)


@given(numbers, numbers, numbers, st.tuples(*[st.floats(-2, 2, allow_subnormal=False)] * 3))
def test_rules_on_plain_numbers(x, y, z, seeds):
    """A law is differentiable on plain numbers too; complex steps give the truth to rounding."""
    found = pull_back(everything, (x, y, -z), (), seeds)

    def value(point: np.ndarray) -> complex:
        a, b, c = point
        s = 2 * a + b * 3 - c / 2 + (1 - a) + 4 / b - 0.5
        t = np.sqrt(a * a + b * b) * -c / b
        u = s * t if point.real[0] > point.real[2] and point.real[1] >= 0 else s - t
        return seeds[0] * u + seeds[1] * s + seeds[2] * t * u

    for i in range(3):
        point = np.array([x, y, -z], complex)
        point[i] += 1e-30j
        assert found[i] == pytest.approx(value(point).imag / 1e-30, rel=1e-11, abs=1e-11)


def test_a_result_that_nothing_depends_on_and_an_input_without_use():
    """Seeds may be missing; unused inputs get zeros."""
    assert pull_back(everything, (1.0, 2.0, -3.0), (), (None, 1.0, None)) == (1.0, 2.0, -0.5)
    assert pull_back(law(lambda x, y: 3.0 * x), (2.0, 5.0), (), (1.0,)) == (3.0, 0.0)


# Each law with inputs, constants behind them, and how many results it has.
POSE = (0.0, 0.0, 0.0, 0.99, 0.05, -0.08, 0.09)
NEXT = (0.0103, 0.0004, -0.0003, 0.985, 0.1, -0.1, 0.08)
FAR = (0.0103, 0.004, -0.003, 0.98, 0.1, -0.1, 0.1)
MEMORY = (2e-4, 3e-4, -1e-4, 0.05, 0.01, -0.02)
BEAM = (0.0101, 1 / 0.0101, 40.0, 5.0, 3000.0, 50.0, 40.0, 0.03, 4e-3, 0.01, 1.02)
SPHERES = (0.0101, 0.0103, 300.0, 280.0, 900.0, 800.0, 0.5, 0.4)
PUSHED = (2e-5, -3e-5, 1e-5, 0.01, 0.02, -0.03, 300.0, 1e-3, -2e-4, 0.0101, 900.0, 0.5, 0.4)
# Of a voxel on a cell of uneven ground: its push, its place, size, contact, and how deep it has pressed the ground.
LANDED = (*PUSHED[:8], 0.003, 0.002, -2e-4, 0.0101, 900.0, 0.5, 0.4, 1e-5)
LYING, SIDES = (*LANDED, *POSE[3:]), (1.0, 2.0, 1.0, -1.0, 0.0, -1.0)  # on sand: as it is turned, and its outer faces
BURIED = (0.2, 0.0101, 0.0152, 0.7)  # friction, size, depth, and the share of the leading side that is an outer face
CELL = (0.0, 0.0, 1e-4, 3e-4, -2e-4, 1e-4, 2e-4, 1.0, 0.1, -0.1, 0.05, 0.02, 200.0)
WET = (*POSE[3:], 2e-4, -3e-4, 1e-4, 0.002, 300.0, 0.01, 0.011, 0.009, 500.0, 20.0, 0.0101)


@primitive
def slowed(*given):
    """The law of added mass, whose result is one number, as a tuple."""
    return (fluid.slowed_step(*given),)


@primitive
def held_by_sand(friction, size, depth, outer, limit):
    """The law of ploughing, whose result is one number, as a tuple."""
    return (uneven.granular_hold(friction, size, depth, limit, outer),)


@primitive
def ahead_on_sand(*given):
    """The law of leading sides, whose result is one number, as a tuple."""
    return (uneven.leading_share(*given),)


def by_parts(function, place: int = 0, bearing: int = 0, cell: int = 0, sand: bool = False):
    """A function of the parts that a voxel's momentum depends on, as one of all their numbers."""
    given = momentum.Pushed(3, 3, 2, place, bearing, int(sand), 4 * sand)
    fixed = momentum.Fixed(2, 2, cell, 7 * sand)

    @primitive
    def flat(*numbers):
        return function(in_parts(given, numbers[: sum(given)]), in_parts(fixed, numbers[sum(given) :]))

    return flat


ON_SAND = by_parts(momentum.moved_on_relief, 3, 4, len(CELL), sand=True)
LAWS = {
    "straight link": (whole_link, (*POSE, *NEXT, *MEMORY, *BEAM), (EDGE, beams.SMALL, False, False), 18),
    "large link": (whole_link, (*POSE, *FAR, *MEMORY, *BEAM), (EDGE, beams.LARGE, False, True), 18),
    "small link in a mixed block": (whole_link, (*POSE, *NEXT, *MEMORY, *BEAM), (EDGE, beams.SMALL, False, True), 18),
    "link that switches": (whole_link, (*POSE, *FAR, *MEMORY, *BEAM), (EDGE, beams.SMALL, False, True), 18),
    "straight link in a fluid": (whole_link, (*POSE, *NEXT, *MEMORY, *BEAM), (EDGE, beams.SMALL, True, False), 18),
    "large link in a fluid": (whole_link, (*POSE, *FAR, *MEMORY, *BEAM), (EDGE, beams.LARGE, True, True), 18),
    "pushing in the air": (by_parts(momentum.moved_in_the_air), (*PUSHED[:8],), (DT, EDGE, 0.0, 0.0), 3),
    "pushing on the floor": (by_parts(momentum.moved_on_the_floor, 1, 4), PUSHED, (DT, EDGE, 0.0, 0.0), 3),
    "pushing of a voxel that sticks": (by_parts(momentum.moved_on_the_floor, 1, 4), PUSHED, (DT, EDGE, 1.0, 1.0), 3),
    "turning": (voxel.turned, (1e-4, 2e-4, -1e-4, 1e-3, -2e-3, 1e-3, 2e7, 1e-6), (DT,), 3),
    "placing": (motion.placed, (*NEXT, 0.1, -0.2, 0.3, 1e-4, 2e-4, -1e-4, 300.0, 2e7), (DT,), 7),
    "pressure": (
        motion.face_force,
        (*POSE[3:], 0.1, -0.05, 0.2, 0.01, 0.011, 0.009, 500.0),
        (1.0, 0.5, 1.0, 0.0, 0.0, 1.0),
        3,
    ),
    "held rotation": (motion.held_rotation, (*NEXT[3:], 0.1, 0.2, 0.3), (1.0, 0.0, 0.0), 4),
    "drag": (fluid.drag, (*POSE[3:], 2e-4, -3e-4, 1e-4, 300.0, 0.01, 0.011, 0.009, 500.0, 20.0), (1.0, 2.0, 0.0), 3),
    "pushing on uneven ground": (
        by_parts(momentum.moved_on_relief, 3, 4, len(CELL)),
        LANDED[:-1],
        (DT, EDGE, 0.0, 0.0, *CELL),
        3,
    ),
    "pushing on sand": (ON_SAND, LYING, (DT, EDGE, 0.0, 0.0, *CELL, 3e5, *SIDES), 4),
    "pushing on sand that bears": (ON_SAND, LYING, (DT, EDGE, 0.0, 0.0, *CELL, 3e9, *SIDES), 4),
    "sticking to sand": (ON_SAND, LYING, (DT, EDGE, 1.0, 1.0, *CELL, 3e5, *SIDES), 4),
    "ploughing by what is all below": (held_by_sand, BURIED, (3e5,), 1),
    "ahead on sand": (ahead_on_sand, (3e-5, -2e-5, *POSE[3:], 0.05, -0.03, 0.998), SIDES, 1),
    "slipping on sand": (uneven.slid, (1e-5, 2e-5, 0.0, 3e-5, -2e-5, 1e-5), (3e5,), 3),
    "coming to rest on sand": (uneven.slid, (1e-5, 2e-5, 0.0, 3e-5, -2e-5, 1e-4), (3e5,), 3),
    "water": (fluid.water_force, WET, (1.0, 2.0, 0.0, 1.5, EDGE, 0.006, 9800.0), 3),
    "water above": (fluid.water_force, WET, (1.0, 2.0, 0.0, 1.5, EDGE, 0.1, 9800.0), 3),
    "added mass": (slowed, (WET[7], *WET[8:12], WET[14]), (1.5, EDGE, 0.006, 500.0, DT), 1),
    "square under pressure": (
        enclosure.pressed_square,
        (*POSE[:3], *NEXT[:3], 0.011, 0.009, 0.001, -5e-4, 0.0102, 2e-4, 500.0, 600.0, 400.0, 450.0),
        (),
        12,
    ),
    "contact": (
        contact.pair_force,
        (*POSE[:3], 1e-5, 2e-5, -1e-5, 0.009, 0.001, 0.002, -2e-5, 1e-5, 0.0, *SPHERES),
        (True,),
        3,
    ),
    "group": (
        group.group_state,
        (1e-3, 20.0, 1.1, 0.9, 1.0, 3e-3, 0.1, 0.2, -9.0, 1e-3, 2e-3, 0.0, 0.01, 0.5, 2e-6),
        (EDGE, 9.8),
        9,
    ),
    "rest length": (group.rest_length, (0.01, 0.012), (), 2),
    "sliding": (floor.sliding_friction, (0.02, -0.01, 0.4, 0.3), (), 2),
    "poisson": (motion.poisson_strains, (0.1, 0.05, -0.02, 0.3), (1.0, 0.0, 1.0), 3),
    "beam constants": (materials.beam_row, (3e5, 3000.0, 0.3, 1.0, 2e5, 2500.0, 0.2, 0.8), (EDGE, DT, False), 9),
    "voxel constants": (materials.voxel_row, (3e5, 3000.0, 0.9, 1e-3, 0.3), (EDGE,), 9),
    "a half turn": (rotations.to_rotation_vector, (0.1, 0.7, -0.5, 0.5), (), 3),
}


def our_kernel(function, inputs: int, constants: int, flags: list[bool], results: int, real: Real):
    """The reverse pass that the law writes itself; flags are known when it is compiled."""
    reals = ti.types.ndarray(dtype=real.type, ndim=1)

    @ti.kernel
    def ours(x: reals, c: reals, seeds: reals, found: reals):
        for once in range(1):
            if once == 0:
                given_x = ti.static(tuple([x[i] for i in range(inputs)]))
                given_c = ti.static(tuple([c[i] for i in range(constants)] + flags))
                given_s = ti.static(tuple([seeds[i] for i in range(results)]))
                cotangents = ti.static(pull_back(function, given_x, given_c, given_s))
                for i in ti.static(range(inputs)):
                    found[i] = cotangents[i]

    return ours


def taichis(function, inputs, constants, flags, seeds) -> np.ndarray:
    """What Taichi's reverse mode makes of the law."""
    x = ti.field(ti.f64, len(inputs), needs_grad=True)
    c = ti.field(ti.f64, max(len(constants), 1))
    s = ti.field(ti.f64, len(seeds))
    cost = ti.field(ti.f64, (), needs_grad=True)
    count, behind, results = len(inputs), len(constants), len(seeds)

    @ti.kernel
    def weighted():
        for _ in range(1):
            given = ti.static([x[i] for i in range(count)] + [c[i] for i in range(behind)] + flags)
            values = function(*given)
            total = 0.0
            for i in ti.static(range(results)):
                total += s[i] * values[i]
            cost[None] += total

    for field, values in ((x, inputs), (c, constants), (s, seeds)):
        for i, value in enumerate(values):
            field[i] = value
    cost.grad[None] = 1.0
    weighted.grad()
    return x.grad.to_numpy()


@pytest.mark.kernels
@pytest.mark.parametrize("name", LAWS)
def test_against_taichis_reverse_mode(name, monkeypatch):
    """Every law, with random cotangents, of scalars and of lanes."""
    function, inputs, given, results = LAWS[name]
    constants, flags = [c for c in given if not isinstance(c, bool)], [c for c in given if isinstance(c, bool)]
    runtime.start("cpu", "f64", 1)
    # The size that Taichi finds by itself can be too small; what is written beyond it has made loops endless.
    monkeypatch.setattr(ti.lang.impl.current_cfg(), "ad_stack_size", 64)
    seeds = np.random.default_rng(0).normal(size=results)
    expected = taichis(function, inputs, constants, flags, seeds)
    for real in (Real("f64", 1), Real("f64", 8)):
        ours = our_kernel(function, len(inputs), len(constants), flags, results, real)
        columns = [real.array((max(len(v), 1),)) for v in (inputs, constants, seeds, inputs)]
        for column, values in zip(columns, (inputs, constants, seeds), strict=False):
            column[: len(values)] = np.asarray(values)[:, None]
        ours(*(real.reals(column) for column in columns))
        for lane in columns[3].T:
            assert lane == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())
