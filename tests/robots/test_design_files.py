"""Files of designs that are damaged by hand get one line that names what is wrong in them."""

import copy
import json
from pathlib import Path

import pytest

from robots.braitenberg.robot import VehicleRobot
from robots.robot import find_robot_doing, make_robot

V1 = Path(__file__).parents[1] / "data/v1_files"
SQUARE = "give numbers of shape (2, 2)"
HUGE = 10**400


def refusal(path):
    """The line with which a file is refused."""
    with pytest.raises(ValueError, match=r".") as refused:
        make_robot(*find_robot_doing(str(path)), {})
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        ("vehicle", {"controller": [["1.0", 0.0], [0.0, 1.0]]}, SQUARE),
        ("vehicle", {"controller": [[True, 0.0], [0.0, 1.0]]}, SQUARE),
        ("vehicle", {"controller": [[HUGE, 0.0], [0.0, 1.0]]}, SQUARE),
        ("vehicle", {"controller": [1.0, 0.0, 0.0, 1.0]}, "controller: shape (4,) is not allowed; give (2, 2)"),
        ("vehicle", {"controller": [[1.0], [1.0]]}, "controller: shape (2, 1) is not allowed; give (2, 2)"),
        ("vehicle", {"contrller": 1}, "contrller: it is unknown; choose one of format, sensors, controller; did you"),
        ("walker", {"layers": [[[1.5, 2, 3]]]}, "layers: [1.5, 2, 3] is not allowed; give rows of digits"),
        ("walker", {"layer": 1}, "layer: it is unknown; choose one of format, layers; did you mean layers?"),
        (
            "inching",
            {"oriental": 1},
            "oriental: it is unknown; choose one of format, pressure, orientation, repeats, s",
        ),
        ("inching", {"materials": {}}, "materials: it is unknown"),
        ("block", {"reflex": 1}, "reflex: it is unknown"),
    ],
)
def test_what_is_not_allowed_in_a_design_is_named(tmp_path, name, change, told):
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps({**json.loads((V1 / f"{name}.json").read_text()), **change}))
    assert f"{path}: " in (found := refusal(path)) and told in found


@pytest.mark.parametrize("name", ["vehicle", "walker", "inching", "graded", "block"])
def test_designs_as_they_are_saved_are_taken(name):
    assert make_robot(*find_robot_doing(str(V1 / f"{name}.json")), {}).kind


def test_what_is_given_twice_is_named(tmp_path):
    path = tmp_path / "vehicle.json"
    path.write_text((V1 / "vehicle.json").read_text().replace("{", '{"sensors": [],', 1))
    assert refusal(path) == f"{path}: 'sensors' is given twice, which is not allowed; give it once"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"robt": 1}, "robt: it is unknown; choose one of format, kind, robot, values"),
        ({"values": {"w3": 1.0}}, "w3: it is unknown; "),
        ({"values": 3}, "values: 3 is not allowed; give values by name"),
        ({"values": {"l1x": "0.1"}}, "l1x: '0.1' is not allowed; give a finite number"),
        ({"values": {"l1x": True}}, "l1x: True is not allowed; give a finite number"),
    ],
)
def test_values_of_a_design_of_any_kind_are_checked(tmp_path, change, told):
    robot, path = VehicleRobot(), tmp_path / "design.json"
    values = {parameter.name: 0.25 for parameter in robot.parameters}
    record = {"format": "morpholab-robot-design-1", "kind": "vehicle", "robot": robot.describe(), "values": values}
    path.write_text(json.dumps(record))
    assert make_robot(*find_robot_doing(str(path)), {}).kind == "vehicle"
    if isinstance(change.get("values"), dict):
        change = {"values": {**values, **change["values"]}}
    path.write_text(json.dumps({**record, **change}))
    assert refusal(path).startswith(f"{path}: {told}")


def mappings(node, path=()):
    """The paths of all mappings in a record."""
    if isinstance(node, dict):
        yield path
        for name, value in node.items():
            yield from mappings(value, (*path, name))
    elif isinstance(node, list):
        for number, value in enumerate(node):
            yield from mappings(value, (*path, number))


@pytest.mark.parametrize("name", ["freeform", "pouch", "quadruped", "rover", "vehicle", "walker"])
def test_names_at_every_level_of_a_design_of_any_kind_are_checked(tmp_path, name):
    robot, path = make_robot(*find_robot_doing(name), {}), tmp_path / "design.json"
    robot.save(robot.start, path)
    saved = json.loads(path.read_text())
    make_robot(*find_robot_doing(str(path)), {})
    for levels in mappings(saved.get("robot", saved)):
        record = copy.deepcopy(saved)
        level = record.get("robot", record)
        for one in levels:
            level = level[one]
        level["odd"] = 1
        path.write_text(json.dumps(record))
        assert "odd: it is unknown" in refusal(path), levels


def test_files_of_robots_are_named_where_one_is_none(tmp_path):
    """The message said only that a picture of a body, such as a .glb, is none."""
    for name in ("body.glb", "other.json"):
        (tmp_path / name).write_text('{"format": "something"}')
        told = refusal(tmp_path / name).removeprefix(f"{tmp_path / name}: it is no file of a robot or a design; ")
        assert told == (
            "such files end in .csv, .json, .mjcf, .obj, .ply, .py, .stl, .urdf, .vxa, .vxc, .vxd, .vxl.json, .xml"
        )
