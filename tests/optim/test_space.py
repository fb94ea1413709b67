import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optim.space import Space, Variable

SPACE = Space(
    (
        Variable("orientation", 0.0, 90.0, step=9.0),
        Variable("f", 0, 8, "integer", step=0.9),
        Variable("heading", -180.0, 180.0, "angle"),
        Variable("on", 0, 1, "binary"),
        Variable("tiny", 0.1, 0.1 + 1e-9),
    )
)
anywhere = st.lists(st.floats(-1e6, 1e6), min_size=SPACE.size, max_size=SPACE.size).map(np.array)
inside = st.tuples(*(st.floats(v.low, v.high) for v in SPACE.variables)).map(np.array)


@given(anywhere)
def test_reflection_ends_inside_the_bounds(point):
    assert SPACE.contains(SPACE.reflect(point)).all()


@given(inside)
def test_reflection_leaves_points_inside_as_they_are(point):
    assert np.array_equal(SPACE.reflect(point), point)


@given(st.floats(0.0, 90.0), st.integers(-3, 3))
def test_reflection_is_that_of_two_facing_mirrors(angle, turns):
    def reflect(x):
        return SPACE.reflect([x, 0, 0, 0, 0.1])[0]

    assert reflect(-angle) == pytest.approx(angle, abs=1e-9)
    assert reflect(90 + angle) == pytest.approx(90 - angle, abs=1e-9)
    assert reflect(angle + 180 * turns) == pytest.approx(angle, abs=1e-9)


@given(st.floats(-180.0, 180.0, exclude_max=True), st.integers(-3, 3))
def test_angles_wrap_round(angle, turns):
    wrapped = SPACE.reflect([0, 0, angle + 360 * turns, 0, 0.1])[2]
    assert (wrapped - angle + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)


@given(anywhere)
def test_the_nearest_point_within_the_bounds(point):
    bound = SPACE.bound(point)
    assert SPACE.contains(bound).all() and np.array_equal(SPACE.bound(bound), bound)
    others = ~SPACE.angles
    assert np.array_equal(bound[others], np.clip(point, SPACE.low, SPACE.high)[others])
    assert np.array_equal(bound[SPACE.angles], SPACE.reflect(point)[SPACE.angles])


@given(inside, inside)
def test_offsets_lead_from_one_point_to_another_the_short_way(a, b):
    offset = SPACE.offset(b, a)
    assert abs(offset).max() <= 1 and abs(offset[SPACE.angles]).max() <= 0.5
    there = SPACE.bound(a + offset * SPACE.span)
    assert SPACE.offset(there, b) == pytest.approx(0, abs=1e-6)


def test_only_binaries_are_relaxed():
    relaxed = SPACE.relaxed()
    kinds = {v.name: v.kind for v in SPACE.variables}
    assert "binary" in kinds.values() and "integer" in kinds.values()
    assert [v.kind for v in relaxed.variables] == [
        "continuous" if kind == "binary" else kind for kind in kinds.values()
    ]
    assert relaxed.names == SPACE.names and np.array_equal(relaxed.low, SPACE.low) and relaxed.relaxed() == relaxed


@given(anywhere)
def test_integers_are_still_whole_after_rounding_and_reflection(point):
    assert np.array_equal(SPACE.validate(SPACE.reflect(SPACE.round(point))), SPACE.reflect(SPACE.round(point)))


@given(inside)
def test_rounding_goes_to_the_nearest_whole_number_and_leaves_the_rest(point):
    rounded = SPACE.round(point)
    integers = [1, 3]
    assert np.all(np.abs(rounded[integers] - point[integers]) <= 0.5)
    assert np.array_equal(np.delete(rounded, integers), np.delete(point, integers))


@given(inside)
def test_names_and_back(point):
    point = SPACE.round(point)
    values = SPACE.to_dict(point)
    assert [type(value) for value in values.values()] == [float, int, float, int, float]
    assert np.array_equal(SPACE.from_dict(values), point)


def test_samples_are_uniform_and_inside():
    points = SPACE.validate(SPACE.sample(np.random.default_rng(1), 9000))
    assert points[:, 0].mean() == pytest.approx(45, abs=1)
    counts = np.bincount(points[:, 1].astype(int))
    assert len(counts) == 9 and counts.min() > 850 and counts.max() < 1150  # the bounds as often as the rest


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([91, 0, 0, 0, 0.1], "orientation: 91 is not allowed; give a number from 0 to 90"),
        ([np.nan, 0, 0, 0, 0.1], "orientation: nan is not allowed; give a number from 0 to 90"),
        ([0, 0.5, 0, 0, 0.1], "f: 0.5 is not allowed; give a whole number from 0 to 8"),
        ([0, 0, 0], r"points: shape \(3,\) is not allowed; the last axis must be 5 variables"),
    ],
)
def test_points_outside_are_named(point, message):
    with pytest.raises(ValueError, match=message):
        SPACE.validate(point)


def test_names_must_be_known_and_complete():
    values = SPACE.to_dict([0, 0, 0, 0, 0.1])
    with pytest.raises(ValueError, match="values: g not free to change; the variables are orientation, f,"):
        SPACE.from_dict({**values, "g": 1})
    del values["f"]
    with pytest.raises(ValueError, match="values: f missing"):
        SPACE.from_dict(values)


@pytest.mark.parametrize(
    "arguments",
    [
        ("x", 1, 1),
        ("x", 0, np.inf),
        ("x", np.nan, 1),
        ("x", 0.5, 2, "integer"),
        ("x", 0, 2, "binary"),
        ("x", 0, 1, "real"),
    ],
)
def test_variables_without_sense_are_refused(arguments):
    with pytest.raises(ValueError, match="x"):
        Variable(*arguments)


def test_steps_and_names_without_sense_are_refused():
    with pytest.raises(ValueError, match="x: step -1"):
        Variable("x", 0, 1, step=-1)
    with pytest.raises(ValueError, match="x given more than once"):
        Space((Variable("x", 0, 1), Variable("x", 0, 2)))
    with pytest.raises(ValueError, match="at least one"):
        Space(())


def test_messages_name_the_first_of_very_many_variables():
    few, many = (Space(tuple(Variable(f"x{n}", 0, 1) for n in range(size))) for size in (100, 1000))
    assert few.listed == ", ".join(few.names)
    with pytest.raises(ValueError, match=r"z not free to change; the variables are x0, x1, .*, x7 and 992 more$"):
        many.check_names("start", {"z": 1.0})
    with pytest.raises(
        ValueError, match=r"^start: x100, .*, x107 and 892 more not free to change; the variables are x0, "
    ):
        few.check_names("start", dict.fromkeys(many.names, 0.5))
    with pytest.raises(ValueError, match=r"^values: x0, x1, .*, x7 and 992 more missing$"):
        many.from_dict({})


def test_parameters_that_name_no_step_get_a_usual_one():
    assert Space.of_parameters(SPACE.variables).step == pytest.approx([9.0, 0.9, 36.0, 0.5, 1e-10])


def test_variables_may_come_one_by_one_and_nobody_changes_bounds():
    space = Space(variable for variable in SPACE.variables)
    assert space == SPACE and hash(space) == hash(SPACE)
    with pytest.raises(ValueError, match="read-only"):
        space.low[0] = 7.0
