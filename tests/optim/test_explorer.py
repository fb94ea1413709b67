"""Explorers: what names and values stand for, what is refused, and what a trial tells."""

import pytest
import trimesh

import morpholab as ml
from optim.explorer.exploration import Exploration

VEHICLE = "vehicle"


def controls(*given, **choices):
    return Exploration(*given, choices).controls


ROBOTS = "vehicle", "legged", "rover-best", "soft-quadruped", "rolling", "walker", "freeform", "pouch"


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_kind_suggests_controls(robot):
    exploration = Exploration(robot, {})
    assert exploration.controls
    assert all(control.choices or control.low <= control.first <= control.high for control in exploration.controls)


@pytest.mark.parametrize(
    ("robot", "name", "value"),
    [
        ("legged", "limb_length", 0.3),
        ("legged", "torque", 10.0),
        ("freeform", "frequency", 4.0),
        ("walker", "frequency", 4.0),
        ("walker", "amplitude", 0.14),
        ("rolling", "orientation", 0.0),
        ("rolling", "slope", 0.0),
        ("inching", "orientation", 90.0),
    ],
)
def test_a_slider_begins_where_the_robot_is(robot, name, value):
    firsts = {control.name: control.first for control in Exploration(robot, {}).controls}
    assert firsts[name] == pytest.approx(value)


def test_whole_numbers_are_known_by_what_takes_them():
    (repeats,) = controls("rolling", repeats=(1, 4), geometry="small")
    assert (repeats.first % 1, repeats.step) == (0, 1)
    slope, swing = controls("soft-quadruped", slope=(-10, 10), muscle_amplitude_1=(0, 0.2))
    assert slope.step == 0.2 and swing.step == 0.002
    (looks,) = controls("legged", looks=(2, 101))
    assert looks.first % 1 == 0 and looks.step == 1
    (size, share) = controls(lambda size, share: ml.robot(VEHICLE), size=(1, 4), share=(0.0, 4.0))
    assert size.step == 1 and share.step == 0.04


def test_options_are_those_of_the_kind_that_is_named():
    """Which may make a robot of another kind."""
    found = Exploration("pouch", {"pressure": (0.0, 12000.0), "geometry": ["small-closed", "closed"], "slope": (-5, 5)})
    assert [control.name for control in found.controls] == ["pressure", "geometry", "slope"]
    assert {"geometry", "pressure"} < {control.name for control in Exploration("pouch", {}).controls}


def test_names_are_parameters_options_and_worlds():
    exploration = Exploration("soft-quadruped", {"muscle_amplitude_1": (0.0, 0.1), "terrain": ["flat", "hill:5"]})
    slider, menu = exploration.controls
    assert (slider.first, slider.low, slider.high, slider.step) == (0.1, 0.0, 0.1, 0.001)
    assert menu.choices == ("flat", "hill:5") and menu.first == "flat"
    robot, world = exploration.set_up({"muscle_amplitude_1": 0.03, "terrain": "hill:5"})
    assert world.name == "hill:5" and not robot.parameters
    assert robot.drives[0].amplitude[0] == pytest.approx(0.03)
    exploration = Exploration("rolling", {"geometry": "small", "slope": (-10, 10), "pressure": (8000, 12000)})
    robot, world = exploration.set_up({"slope": 2.5, "pressure": 9000})
    assert robot.geometry == "small" and world.name == "hill:2.5"
    assert robot.gait.pressure == 9000


def test_a_function_takes_what_it_names():
    def make(design, slowness=2.0):
        return ml.robot(VEHICLE, design=int(design))

    design, slowness, environment = controls(make, design=(1, 6561), slowness=(1.0, 4.0), environment=[2, 1])
    assert (design.first, design.step) == (3281, 1) and slowness.first == 2.0 and environment.first == 2
    with pytest.raises(ValueError, match="source: it made 3, which is no robot"):
        Exploration(lambda size: 3, {"size": (1, 2)})
    with pytest.raises(ValueError, match="choices: there are none; give a pair"):
        Exploration(make, {"design": 5})
    with pytest.raises(ValueError, match="design: the function wants it; give a pair, a list or a value"):
        Exploration(make, {"slowness": (1.0, 4.0)})
    (environment,) = controls(lambda: ml.robot(VEHICLE), environment=[3, 4])
    assert environment.first == 3


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"w7": (0, 1)}, "w7: no parameter or option of Braitenberg vehicle; there are l1x, .*, environment"),
        ({"w1": (1, 0)}, "w1: 1 to 0 is not allowed; give the lowest value first"),
        ({"w1": (0, float("inf"))}, "w1: inf is not allowed"),
        ({"environment": []}, "environment: a menu of nothing is not allowed"),
        ({"environment": [9]}, "environment: .*9"),
        ({"wavelength": 3}, "wavelength: no parameter or option"),
        ({"environment": [(1, 2)]}, r"environment: \(1, 2\) is not allowed in a menu; give texts and numbers"),
    ],
)
def test_what_is_not_allowed_is_named(choices, message):
    with pytest.raises(ValueError, match=message):
        Exploration(VEHICLE, choices)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"w1": 2.0}, "w1: 2.0 is not allowed"),
        ({"w1": "a"}, "w1: 'a' is not allowed"),
        ({"w2": 0.0}, "control: 'w2' is unknown"),
        ({"environment": 3}, "environment: 3 is not allowed; choose one of 1, 2"),
    ],
)
def test_values_of_a_front_end_are_checked(values, message):
    exploration = Exploration(VEHICLE, {"w1": (-1.0, 1.0), "environment": [1, 2]})
    with pytest.raises(ValueError, match=message):
        exploration.checked(values)


@pytest.mark.kernels
def test_a_trial_is_that_of_the_same_design():
    exploration = Exploration(VEHICLE, {"w1": (-1.0, 1.0), "environment": [1, 2]}, ("closest",))
    tried = exploration.tried({"w1": 0.5, "environment": 2})
    expected = ml.simulate(VEHICLE, {"w1": 0.5}, ml.world(ml.robot(VEHICLE), "2"))
    assert tried.rows == (("smallest distance from the light", "m", float(expected["closest"][0])),)
    assert not tried.failure


@pytest.mark.kernels
def test_the_widget_follows_its_values():
    widget = ml.explore(VEHICLE, w1=(-1.0, 1.0))
    plain = "install jupyterlab_widgets and anywidget where Jupyter runs for sliders of w1"
    assert widget._repr_mimebundle_()[0]["text/plain"] == plain
    first = widget.latest.rows
    widget.keep()
    widget.values = {"w1": -0.5}
    assert widget.latest.rows != first and widget.busy is None and not widget.message
    assert [column["title"] for column in widget.measured] == ["kept 1: w1 1", "now"]
    widget.values = {"w1": 7.0}
    assert widget.message.startswith("w1: 7.0 is not allowed") and widget.latest is None
    widget.drop()
    assert widget.measured == [] and widget.page == ""
    widget.values = {"w1": 1.0}
    assert widget.latest.rows == first and "window.player" in widget.page


@pytest.mark.kernels
def test_the_widget_goes_on_after_errors_and_with_values_that_are_left_out():
    def make(wrong):
        return 1 // (1 - wrong) and ml.robot(VEHICLE)

    widget = ml.explore(make, wrong=[0, 1], w1=(-1.0, 1.0))
    assert widget.latest is not None
    widget.values = {"wrong": 1}
    assert widget.message == "ZeroDivisionError: integer division or modulo by zero" and widget.latest is None
    assert widget.measured == [] and widget.busy is None
    widget.values = {"w1": 0.5}
    assert widget.values == {"wrong": 0, "w1": 0.5} and not widget.message
    widget.keep()
    assert [column["title"] for column in widget.measured] == ["kept 1: wrong 0, w1 0.5", "now"]


class Panic(BaseException):
    """What goes past handlers of failures, as those of Rust do."""


def widget_that_may_raise(error):
    def make(wrong=0):
        if wrong:
            raise error
        return ml.robot(VEHICLE)

    return ml.explore(make, wrong=[0, 1], w1=(-1.0, 1.0))


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("error", "told"), [(SystemExit(3), "SystemExit: 3"), (Panic("a\nb"), "Panic: a b"), (ValueError("a: no"), "a: no")]
)
def test_the_widget_goes_on_after_what_is_no_exception(error, told):
    widget = widget_that_may_raise(error)
    widget.values = {"wrong": 1}
    assert (widget.message, widget.busy, widget.latest, widget.measured) == (told, None, None, [])
    widget.values = {"wrong": 0}
    assert widget.latest is not None and not widget.message


@pytest.mark.kernels
def test_the_widget_is_not_busy_after_an_interrupt():
    widget = widget_that_may_raise(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        widget.values = {"wrong": 1}
    assert widget.busy is None


@pytest.mark.filterwarnings("ignore:mesh. its voxels of pitch 7.5")
def test_a_mesh_needs_its_pitch_as_a_fixed_value_or_a_slider(tmp_path):
    trimesh.creation.box((40, 20, 20)).export(tmp_path / "box.stl")
    legs = f"legs={tmp_path / 'box.stl'}"
    fixed = Exploration(tmp_path / "box.stl", {"region": legs, "pitch": 10, "slope": (-5.0, 5.0)})
    assert [control.name for control in fixed.controls] == ["slope"]
    assert len(fixed.set_up({})[0].body.voxels) == 16
    sliding = Exploration(tmp_path / "box.stl", {"region": legs, "pitch": (5.0, 10.0)})
    assert len(sliding.set_up({"pitch": 5.0})[0].body.voxels) == 128


def test_options_change_what_a_function_makes():
    exploration = Exploration(lambda gait: ml.robot(gait), {"gait": ["rolling", "inching"], "pressure": (8000, 12000)})
    robot, _ = exploration.set_up({"gait": "inching", "pressure": 9000})
    assert robot.gait.pressure == 9000 and robot.gait.orientation == 90
