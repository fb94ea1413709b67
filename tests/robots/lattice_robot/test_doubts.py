"""What is allowed but likely a mistake is told once, when a user gives a robot."""

import dataclasses

import numpy as np
import pytest

import morpholab as ml
from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.lattice_robot.presets import soft_quadruped
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array

RUBBER = Material(1e6, 1000.0, static_friction=0.8, kinetic_friction=0.5, name="rubber")


def robot_of(cells=(2, 1, 1), material=RUBBER, voxel_size=0.01, phase=0.0, amplitude=0.1):
    body = body_from_array(np.ones(cells, int) if isinstance(cells, tuple) else cells, [material], voxel_size)
    return LatticeRobot(body, (Drive("legs", (0,), amplitude=amplitude, phase=phase),), cycles=1, name="worm")


@pytest.mark.parametrize(
    ("robot", "told"),
    [
        (robot_of(voxel_size=10.0), "voxel_size: worm is 20 m long; lengths are metres"),
        (robot_of(voxel_size=1e-4), "voxel_size: worm is 0.2 mm long; lengths are metres"),
        (
            robot_of(np.array([[[1]], [[0]], [[1]]])),
            "body: worm is 2 parts that no links join; voxels are joined where",
        ),
        (robot_of(material=Material(0.1, 1000.0)), "youngs_modulus: material 0 has 0.1 Pa; it is in pascals"),
        (robot_of(material=Material(1e6, 1.07)), "density: material 0 has 1.07 kg/m"),
        (robot_of(material=Material(1e6, 1e5)), "density: material 0 has 100000 kg/m"),
        (
            robot_of(material=dataclasses.replace(RUBBER, scale=(2.0, 1.0, 1.0))),
            "scale: rubber has 2, 1, 1, but voxels start with an edge of 1: they spring to their size at once",
        ),
        (
            robot_of(material=dataclasses.replace(RUBBER, kinetic_friction=0.9)),
            "kinetic_friction: 0.9 of rubber is above its static friction, 0.8; what slides is then held more",
        ),
        (robot_of(amplitude=0.0), "drives: nothing moves worm, which rests; give a drive an amplitude, or"),
        (robot_of(phase=90.0), "phase: 90 of legs is likely in degrees; phases are in cycles, 90 is 0.25"),
        (robot_of(phase=Free(0.0, 360.0)), "phase: 360 of legs is likely in degrees; phases are in cycles"),
    ],
)
def test_likely_mistakes_are_named_with_their_unit(robot, told):
    (doubt,) = robot.doubts()
    assert doubt.startswith(told)
    with (
        pytest.warns(UserWarning, match=told.replace("(", ".")),
        pytest.raises(ValueError, match=r"^nothing: is unknown"),
    ):
        ml.simulate(robot, nothing=0)  # robots are looked at before anything is simulated


def test_sizes_are_doubted_only_where_links_turn_bodies():
    """That is between regions; curves and proportions, whose bounds are wide, hide no other drive."""
    body = body_from_array(np.ones((4, 1, 1), int), [RUBBER], 0.01, regions=np.arange(4).reshape(4, 1, 1) // 2)

    def swelling(size, regions=(0, 1), *more, links="alike"):
        legs = Drive("legs", regions, amplitude=size)
        return LatticeRobot(dataclasses.replace(body, links=links), (legs, *more), cycles=1, name="worm")

    (told,) = swelling(Free(0.0, 0.5)).doubts()
    assert told.startswith("links: worm has neighbours of 0.5 and 1.5 edges, which may push it along on dry ground")
    (told,) = swelling(Free(0.0, 1.3)).doubts()
    assert "neighbours of 0.1 and 2.3 edges" in told
    curve = Drive("back", (1,), amplitude=0.01, knots=(0.0, 1.0))
    assert swelling(0.7, (0,), curve).doubts() and not robot_of(amplitude=0.5).doubts()
    assert not swelling(0.4).doubts() and not swelling(0.5, links="balanced").doubts()


def test_stiff_links_are_doubted_where_muscles_move_much_for_the_weight():
    """A table on four legs of 10 MPa went at 18 of its lengths a second, with balanced links at 0.1."""
    regions = np.arange(4).reshape(4, 1, 1) // 2

    def legs(modulus, edge, amplitude, **more):
        material = dataclasses.replace(RUBBER, youngs_modulus=modulus)
        body = body_from_array(np.ones((4, 1, 1), int), [material], edge, regions=regions)
        drive = Drive("legs", (0, 1), amplitude=amplitude)
        return LatticeRobot(dataclasses.replace(body, **more), (drive,), cycles=1, name="table").doubts()

    (told,) = legs(1e7, 0.01, Free(0.0, 0.25))
    assert told.startswith("links: table is stiff for its weight and size, so muscles may push it along or throw it on")
    assert legs(1e8, 0.01, 0.1) == legs(1e7, 0.001, 0.1) == (told,)
    assert not (legs(1e6, 0.01, 0.25) or legs(1e8, 0.01, 0.01) or legs(1e8, 0.01, 0.1, links="balanced"))


def test_a_search_in_one_call_looks_at_its_robot():
    with pytest.warns(UserWarning, match=r"^phase: 360 of legs"), pytest.raises(ValueError, match=r"^method"):
        ml.maximise(ml.RobotProblem(robot_of(phase=Free(0.0, 360.0))), "nothing", generations=1)


@pytest.mark.kernels
def test_commands_note_the_doubts_of_a_file(morpholab, tmp_path):
    (tmp_path / "worm.py").write_text(
        "import numpy as np\nimport morpholab as ml\n"
        "body = ml.body_from_array(np.array([[[1]], [[0]], [[1]]]), [ml.Material(1e6, 1e3)], 0.01)\n"
        "robot = ml.LatticeRobot(body, (ml.Drive('legs', (0,), amplitude=0.1),), cycles=1, settling=0)\n"
    )
    code, _, error = morpholab("simulate --robot worm.py")
    assert code == 0 and error.count("note: body: robot is 2 parts that no links join") == 1


def test_usual_robots_raise_no_doubts():
    assert soft_quadruped().doubts() == () == robot_of(phase=2.5).doubts()


def test_upright_bodies_one_voxel_wide_may_fall_over():
    """Worms lie, swimmers float, and bodies that are held in their plane cannot."""
    wall = robot_of((5, 1, 3))
    told = "voxels: worm is one voxel wide along y and stands upright, so it may fall over; hold all voxels in its "
    (doubt,) = wall.doubts_in(Terrain())
    assert doubt.startswith(told)
    assert robot_of((1, 4, 3)).doubts_in(Terrain())[0].startswith(told.replace("along y", "along x"))
    assert len(robot_of((1, 1, 3)).doubts_in(Terrain())) == 1
    held = np.tile([False, True, False, True, False, True], (15, 1))
    in_plane = dataclasses.replace(wall, body=dataclasses.replace(wall.body, fixed=held))
    assert in_plane.doubts_in(Terrain()) == robot_of((5, 1, 1)).doubts_in(Terrain()) == ()
    assert robot_of((5, 2, 3)).doubts_in(Terrain()) == wall.doubts_in(Terrain.parse("water")) == ()
