"""The reader of MJCF beside MuJoCo's own: the same numbers of the same texts, and robots that move alike."""

import runpy
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from articulated_files import CRAWLER
from mujoco_motion import Pose, pendulum, plain
from mujoco_reading import Pair, close, refusal
from random_mjcf import random_mjcf
from random_urdf import random_urdf
from small_mjcf import ball, classed, default, leg

from taichi_sim.rigid.model.files import read_model

HERE = Path(__file__)
ROOT = HERE.parents[3]
PLACES = ("tests/fuzz/corpus/rigid/*", "examples/**/*.xml", "docs/**/*.xml")


def texts():
    own = runpy.run_path(str(HERE.with_name("test_rigid_files.py")))
    found = {"ant": own["ANT"], "whegged": own["whegged_text"](), "crawler": CRAWLER, "ball": own["mjcf"](own["BALL"])}
    found |= {"pendulum": own["mjcf"](own["PENDULUM"].replace("box", "sphere"))}
    found |= {f"chain {seq}": own["mjcf"](own["CHAIN"], f'<compiler eulerseq="{seq}"/>') for seq in ("zyx", "xYz")}
    for path in sorted(path for place in PLACES for path in ROOT.glob(place)):
        if "<mujoco" in path.read_text(errors="replace") and is_read(path.read_text(errors="replace")):
            found[path.name] = path.read_text(errors="replace")
    return found


def is_read(text):
    try:
        read_model(text)
    except ValueError:
        return False
    return True


TEXTS = texts()


@pytest.mark.parametrize("name", TEXTS)
def test_the_files_of_the_tests_are_read_as_mujoco_reads_them(name):
    Pair(TEXTS[name]).same()


GYMNASIUM = {  # why others than its ant are refused
    "half_cheetah": "settotalmass are not allowed",
    "hopper": "joints are not allowed",
    "humanoid": "<tendon> is not allowed",
    "humanoidstandup": "<tendon> is not allowed",
    "inverted_double_pendulum": "give one plane",
    "inverted_pendulum": "slide",
    "point": "joints are not allowed",
    "pusher": "bodies are not allowed",
    "pusher_v5": "bodies are not allowed",
    "reacher": "bodies are not allowed",
    "swimmer": "give one plane",
    "walker2d": "joints are not allowed",
    "walker2d_v5": "joints are not allowed",
}


def test_the_files_of_gymnasium_are_read_alike_or_refused():
    for path in Path(gymnasium.__path__[0], "envs/mujoco/assets").glob("*.xml"):
        if path.stem == "ant":
            Pair(path.read_text()).same()
        else:
            with pytest.raises(ValueError, match=GYMNASIUM[path.stem]):
                read_model(path.read_text())


def compare(seeds):
    """Compare random files; return how many both read."""
    read = 0
    for seed in seeds:
        text = random_mjcf(seed)
        if refusal(text) is not None:
            with pytest.raises(ValueError, match="not allowed"):
                read_model(text)
            continue
        try:
            Pair(text).same()
        except (AssertionError, ValueError) as error:
            raise AssertionError(f"random_mjcf({seed}): {error}") from error
        read += 1
    return read


def test_random_files_are_read_as_mujoco_reads_them():
    assert compare(range(60)) > 50


@pytest.mark.slow
def test_hundreds_of_random_files_are_read_as_mujoco_reads_them():
    assert compare(range(1000, 2500)) > 1350


def compare_urdf(seeds):
    for seed in seeds:
        pair = Pair(random_urdf(seed))
        pair.same_bodies()
        pair.same_hinges()


def test_random_urdf_files_have_mujocos_bodies_and_hinges():
    compare_urdf(range(40))


@pytest.mark.slow
def test_hundreds_of_random_urdf_files_have_mujocos_bodies_and_hinges():
    compare_urdf(range(1000, 1500))


def compare_motion(seeds):
    for seed in seeds:
        text = plain(random_mjcf(seed, exact=True))
        if refusal(text) is not None:
            continue
        pose = Pose(Pair(text), np.random.default_rng(seed))
        close(*pose.inertias(), f"mass matrix of random_mjcf({seed})")
        mine, theirs = pose.energies()
        close(mine, theirs, f"energies of random_mjcf({seed})", max(1.0, *np.abs(mine)))


def test_random_robots_have_mujocos_mass_matrix_and_energies():
    """At random poses and velocities, to 1e-9: of what both read, so that masses, axes and places are all right."""
    compare_motion(range(30))


@pytest.mark.slow
def test_hundreds_of_random_robots_have_mujocos_mass_matrix_and_energies():
    compare_motion(range(1000, 1300))


@pytest.mark.kernels
def test_random_robots_are_accelerated_as_in_mujoco():
    """From rest at random poses, by gravity and by a torque on each hinge: to 1e-8 of the largest acceleration."""
    tried = 0
    for seed in range(100, 140):
        text = plain(random_mjcf(seed, exact=True))
        if refusal(text) is None and len((pair := Pair(text)).tree.hinges) in (2, 3):
            mine, theirs = Pose(pair, np.random.default_rng(seed)).accelerations(range(len(pair.tree.hinges)))
            close(mine, theirs, f"accelerations of random_mjcf({seed})", most=1e-8)
            tried += 1
    assert tried >= 5


@pytest.mark.kernels
def test_a_robot_falls_freely_as_in_mujoco():
    mine, theirs = pendulum(ball(), 1e-3, 300)
    close(mine, theirs, "height", 1.0)


@pytest.mark.kernels
def test_a_pendulum_swings_as_in_mujoco():
    """A second of large swings: both are semi-implicit, so of one hinge every step is the same."""
    mine, theirs = pendulum(SWINGING.format(""), 1e-3, 1000)
    close(mine, theirs, "angle", 1.0)


@pytest.mark.kernels
def test_a_double_pendulum_swings_as_in_mujoco_to_first_order():
    """Both are of first order in the time step, and come to the same; half of a step leaves half of the distance."""
    inertial = '<inertial pos="0 0 -.3" mass=".7" diaginertia=".02 .03 .01"/>'
    text = SWINGING.format(f'<body name="b" pos="0 0 -.5"><joint name="q" axis="0 1 0"/>{inertial}</body>')
    apart = [np.abs(np.subtract(*pendulum(text, 1 / steps, steps))).max() for steps in (500, 1000, 2000, 4000)]
    assert apart[-1] < 2e-3
    assert np.allclose(np.divide(apart[:-1], apart[1:]), 2, rtol=0.1)


SWINGING = """<mujoco><worldbody><body name="a" pos="0 0 5"><joint name="p" axis="0 1 0" ref="0"/>
  <inertial pos="0.4 0 -.3" mass="1.3" diaginertia=".05 .06 .02"/>{}</body></worldbody></mujoco>"""


# Each was read otherwise, or passed over in silence.
DIFFERENCES = {
    "a sequence of both cases": ball(attributes='euler="10 20 30"', head='<compiler eulerseq="xYz"/>'),
    "a sequence of an axis twice": ball(attributes='euler="10 20 30"', head='<compiler eulerseq="XXz"/>'),
    "fewer sizes than the class has": classed('<geom type="capsule" size=".1 .3"/>', 'size=".2"'),
    "a quaternion over angles of the class": classed(
        '<geom euler="90 0 0" mass="1"/>', 'type="capsule" size=".1 .3" quat="1 0 1 0"'
    ),
    "a turn over another of the class": classed(
        '<geom axisangle="1 0 0 90" type="capsule"/>', 'size=".1 .3" euler="0 90 0"'
    ),
    "a box from here to there": ball('type="box" size=".1 .2 .3" fromto="0 0 0 0 0 1" contype="0" conaffinity="0"'),
    "a range of 0 0": leg('range="0 0"'),
    "a free joint of a class": default('<joint type="free"/>', joint="<joint/>"),
    "damping of a free joint": ball(joint='<joint type="free" damping="1"/>'),
    "defaults of other actuators": leg(
        actuator='<position joint="hip"/>',
        head='<default><motor ctrlrange="-1 1" gear="3" forcerange="-4 4"/></default>',
    ),
    "a gain of another actuator": leg(
        actuator='<velocity joint="hip" ctrlrange="-1 1"/>', head='<default><position kp="7" kv="2"/></default>'
    ),
    "a drag of another actuator": leg(
        actuator='<position joint="hip" kp="2" ctrlrange="-1 1"/>', head='<default><velocity kv="7"/></default>'
    ),
    "a gain of general actuators": leg(
        actuator='<position joint="hip" ctrlrange="-1 1"/>',
        head='<default><general gainprm="9 8" biastype="affine" biasprm="0 -9 -3"/></default>',
    ),
    "a constant bias of general actuators": leg(
        actuator='<position joint="hip" kp="5" gear="2" ctrlrange="-1 1"/>',
        head='<default><general gainprm="9" biasprm="2 -3 -1"/></default>',
    ),
    "a share of a range": leg('range="-10 30"', '<position joint="hip" inheritrange=".5" gear="2"/>'),
    "a force of a joint": leg('actuatorfrcrange="-3 3"', '<motor joint="hip" ctrlrange="-5 5"/>'),
    "a force range of 0 0": leg(actuator='<motor joint="hip" ctrlrange="-5 5" forcerange="0 0"/>'),
    "a control range of 0 0": leg('range="-1 1"', '<position joint="hip" ctrlrange="0 0"/>'),
    "condim of one of two": ball('size=".5" friction="2" condim="1"'),
    "a priority": ball('size=".5" friction=".2" priority="1"'),
    "friction of a base that never moves": ball(
        'size=".5" friction="5"', '<body name="leg"><joint name="hip"/><geom size=".1"/></body>', joint=""
    ),
    "a base that touches nothing of the world": ball(tail='<contact><exclude body1="ball" body2="world"/></contact>'),
    "no contact": ball(head='<option><flag contact="disable"/></option>'),
    "no gravity": ball(head='<option><flag gravity="disable"/></option>'),
    "no limits": leg('range="-1 1"', head='<option><flag limit="disable"/></option>'),
    "solids of a group have no mass": ball(
        'size=".1" group="3"', '<geom size=".2" pos="1 0 0"/>', head='<compiler inertiagrouprange="0 2"/>'
    ),
    "solids of a far group have no mass": ball('size=".1" group="7"', '<geom size=".2" pos="1 0 0"/>'),
    "solids without mass leave the inertial": ball(
        'size=".1" mass="0"',
        '<inertial pos="1 0 0" mass="3" diaginertia="1 1 1"/>',
        head='<compiler inertiafromgeom="true"/>',
    ),
    "a least mass": ball(head='<compiler boundmass="5"/>'),
    "a least mass of what has none": ball(
        inside='<body name="x" pos="0 0 1" euler="10 20 30"/>', head='<compiler boundmass=".5"/>'
    ),
    "a least moment": ball(
        'type="capsule" size=".1 .5" mass="1" euler="20 30 40"', head='<compiler boundinertia=".05"/>'
    ),
    "least moments make an inertia possible": ball(
        inside='<inertial pos="0 0 0" mass="3" diaginertia="1 2 5"/>', head='<compiler boundinertia="3"/>'
    ),
    "a point on a body": ball(
        inside='<body name="x" pos="0 0 1"><inertial pos="0 0 0" mass="1" diaginertia="0 0 0"/></body>'
    ),
}


@pytest.mark.parametrize("what", DIFFERENCES)
def test_what_was_read_otherwise_is_read_as_mujoco_reads_it(what):
    Pair(DIFFERENCES[what]).same()


def test_what_has_no_name_is_called_as_nothing_else_is():
    named = '<body name="body 0"><joint name="joint 1"/><geom size=".1"/><body><joint/><geom size=".1"/></body></body>'
    tree = read_model(ball(inside=named).replace('name="ball"', "")).tree
    assert [body.name for body in tree.bodies] == ["body 0'", "body 0", "body 2"]
    text = ball(inside='<body><joint/><geom size=".1"/></body>', tail='<actuator><motor joint="joint 0"/></actuator>')
    with pytest.raises(ValueError, match="motor: there is no hinge 'joint 0'"):
        read_model(text.replace("<motor", '<motor ctrlrange="-1 1"'))


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (ball('size=".5" margin="0.01"'), "margin of geoms"),
        (leg('margin="0.01"'), "margin of joints"),
        (ball('size=".5" solref="0.01 1"'), "how soft contacts and stops are"),
        (ball('size=".5" condim="4"'), "friction of turning and rolling (condim)"),
        (ball(attributes='gravcomp="1"'), "gravcomp of bodies"),
        (leg('springdamper="1 1"', '<motor joint="hip" ctrlrange="-1 1"/>'), "springdamper of joints"),
        (leg(actuator='<position joint="hip" ctrlrange="-1 1" timeconst="1"/>'), "timeconst of drives"),
        (leg(actuator='<general joint="hip" ctrlrange="-1 1" dyntype="filter"/>'), "dyntype of drives"),
        (ball(head='<option><flag clampctrl="disable"/></option>'), "flag clampctrl"),
        (
            leg(actuator='<position joint="hip" ctrlrange="-40 40" gear="2"/>'),
            "that position drives may be told 20 rad, as ctrlrange is in radians",
        ),
    ],
)
def test_what_passed_in_silence_is_named(text, note):
    assert note in read_model(text).ignored and refusal(text) is None


@pytest.mark.parametrize("limit, torque", [("", None), ('forcerange="-1 1"', 1.0)])
def test_the_force_of_a_drive_has_a_limit_if_the_file_says_so(limit, torque):
    text = leg('damping="300"', f'<position joint="hip" kp="50" ctrlrange="-.1 .1" {limit}/>')
    (hinge,) = read_model(text).tree.hinges
    assert hinge.motor.torque == torque and hinge.passive.damping == 300
    (ideal,) = read_model(text, speed=10.0).tree.hinges  # which holds a rate, with that of its spring over its range
    assert ideal.motor.torque == (torque or 10.0) and ideal.motor.by_angle == -50 / 300
