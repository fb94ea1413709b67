"""What MuJoCo refuses of MJCF is refused, with few exceptions; what is refused beyond it is documented."""

import re
from pathlib import Path

import mujoco
import pytest
from mujoco_reading import Pair, refusal
from random_mjcf import harmed, random_mjcf
from small_mjcf import ball, default, inertial, leg

from taichi_sim.rigid.model.files import read_model
from taichi_sim.rigid.model.mjcf_schema import ATTRIBUTES

ROOT = Path(__file__).parents[3]
SCHEMA = re.compile(r"^( *)(\S+) \([!?*R]\)(.*)$")
OTHER_VERSIONS = {  # attributes that another version has than the one that is installed
    "compiler": {"conflict", "convexhull", "exactmeshinertia"},
    "option": {"apirate", "collision", "mpr_iterations", "mpr_tolerance", "sleep_tolerance"},
    "flag": {"diagexact", "passive", "sensornoise", "sleep"},
    "body": {"simple", "sleep"},
    "geom": {"adhesion", "surfacevel"},
    "touch": {"delay", "interp", "interval", "nsample"},
    **{tag: {"armature", "damping", "delay", "interp", "nsample"} for tag in ("motor", "position", "velocity")},
    "general": {"armature", "damping", "delay", "ffrange", "input", "interp", "nsample", "velrange"},
}


def schema():
    """MuJoCo's schema: attributes of elements by their path."""
    found, path = {}, []
    for line in mujoco.mj_printSchema(flg_html=False, flg_pad=True).splitlines():
        if match := SCHEMA.match(line):
            path = [*path[: len(match[1]) // 3], match[2]]
            found["/".join(path)] = set(match[3].split())
        elif line.strip():
            found["/".join(path)] |= set(line.split())
    return found


def path_of(tag):
    """Where an element that is read stands in MuJoCo's schema."""
    if tag in ("mujoco", "flag", "compiler", "option", "default", "actuator", "sensor", "contact"):
        return {"mujoco": tag, "flag": "mujoco/option/flag"}.get(tag, f"mujoco/{tag}")
    if tag in ("touch", "exclude"):
        return f"mujoco/{'sensor' if tag == 'touch' else 'contact'}/{tag}"
    if tag in ("motor", "position", "velocity", "general"):
        return f"mujoco/actuator/{tag}"
    return "mujoco/(world)body" + (f"/{tag}" if tag != "body" else "")


def test_the_attributes_are_those_of_mujocos_schema():
    theirs = schema() | {"mujoco/(world)body/worldbody": set()}
    for tag, names in ATTRIBUTES.items():
        expected = theirs[path_of(tag)]
        assert set(names) - expected == OTHER_VERSIONS.get(tag, set()), tag
        assert expected <= set(names), tag


BOTH_REFUSE = {
    "limits that are missing": leg('limited="true"'),
    "limits without autolimits": leg('range="-1 1"', head='<compiler autolimits="false"/>'),
    "a sequence of four": ball(head='<compiler eulerseq="xyzx"/>'),
    "two contact dimensions": ball('size=".5" condim="2"'),
    "five contact dimensions": ball('size=".5" condim="5"'),
    "a broken number of dimensions": ball('size=".5" condim="3.0"'),
    "a broken type of contact": ball('size=".5" contype="1.5"'),
    "a type of contact of many bits": ball('size=".5" contype="4294967295"'),
    "four coefficients of friction": ball('size=".5" friction="1 1 1 1"'),
    "four sizes": ball('size="1 1 1 1"'),
    "a size below 0": ball('size="-1"'),
    "a picture of no size": ball('size="0" contype="0" conaffinity="0"', '<geom size="1"/>'),
    "a picture of no size in the world": ball().replace(
        "<worldbody>", '<worldbody><geom size="0" contype="0" conaffinity="0"/>'
    ),
    "a sphere from here to there": ball('size=".1" fromto="0 0 0 1 0 0"'),
    "a capsule from here to here": ball('type="capsule" size=".1" fromto="0 0 0 0 0 0"'),
    "a capsule from here to there elsewhere": ball('type="capsule" size=".1" fromto="0 0 0 1 0 0" pos="0 0 1"'),
    "no quaternion": ball(attributes='quat="0 0 0 0"'),
    "no axis of a turn": ball(attributes='axisangle="0 0 0 1"'),
    "no axis": ball(attributes='zaxis="0 0 0"'),
    "parallel axes": ball(attributes='xyaxes="1 0 0 1 0 0"'),
    "two turns": ball(attributes='euler="1 0 0" axisangle="0 0 1 3"'),
    "a turn beside a quaternion": ball(attributes='euler="1 0 0" quat="1 0 0 0"'),
    "two turns in a class": default('<geom euler="1 0 0" zaxis="0 0 1"/>'),
    "an inertial without a place": inertial('mass="1" diaginertia="1 1 1"', ""),
    "an inertial without a mass": inertial('diaginertia="1 1 1"'),
    "an inertial without an inertia": inertial('mass="1"'),
    "an inertial with two inertias": inertial('mass="1" diaginertia="1 1 1" fullinertia="1 1 1 0 0 0"'),
    "a full inertia that is turned": inertial('mass="1" quat="1 0 0 0" fullinertia="1 1 1 0 0 0"'),
    "a mass below 0": inertial('mass="-1" diaginertia="1 1 1"'),
    "two inertials": ball(inside='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' * 2),
    "an unused inertial with a broken number": ball(
        inside='<inertial pos="0 0 0" mass="1 1" diaginertia="1 1 1"/>', head='<compiler inertiafromgeom="true"/>'
    ),
    "two joints of a name": ball(inside='<body><joint name="a"/><geom size="1"/></body>' * 2),
    "two solids of a name": ball(inside='<geom name="skin" size="1"/>'),
    "two sites of a name": ball(inside='<site name="s"/>' * 2),
    "two bodies of a name": ball(inside='<body name="ball"/>'),
    "a body that is the world": ball().replace('name="ball"', 'name="world"'),
    "two actuators of a name": leg(actuator='<motor name="a" joint="hip" ctrlrange="-1 1"/>' * 2),
    "an actuator of nothing": leg(actuator='<motor name="a" ctrlrange="-1 1"/>'),
    "an unknown ctrllimited": leg(actuator='<motor joint="hip" ctrlrange="-1 1" ctrllimited="yes"/>'),
    "a control range without autolimits": leg(
        actuator='<motor joint="hip" ctrlrange="-1 1"/>', head='<compiler autolimits="false"/>'
    ),
    "a force range without autolimits": leg(
        actuator='<motor joint="hip" ctrlrange="-1 1" ctrllimited="true" forcerange="-1 1"/>',
        head='<compiler autolimits="false"/>',
    ),
    "a force limit without a range": leg(actuator='<motor joint="hip" ctrlrange="-1 1" forcelimited="true"/>'),
    "a drag below 0": leg(actuator='<position joint="hip" ctrlrange="-1 1" kv="-1"/>'),
    "a drag and its ratio": leg(actuator='<position joint="hip" ctrlrange="-1 1" kv="1" dampratio="1"/>'),
    "a range and a share of it": leg('range="-1 1"', '<position joint="hip" ctrlrange="-1 1" inheritrange="1"/>'),
    "a share of no range": leg(actuator='<position joint="hip" inheritrange="1"/>'),
    "seven gears": leg(actuator='<motor joint="hip" ctrlrange="-1 1" gear="1 1 1 1 1 1 1"/>'),
    "an unknown attribute": ball('size="1" siez="2"'),
    "an unknown attribute of a joint": leg('dampng="1"'),
    "an unknown attribute of an actuator": leg(actuator='<motor joint="hip" ctrlrange="-1 1" kp="1"/>'),
    "an unknown attribute of options": ball(head='<option timstep="0.1"/>'),
    "an unknown attribute of a compiler": ball(head='<compiler anlge="radian"/>'),
    "an unknown attribute of the file": ball().replace("<mujoco>", '<mujoco foo="1">'),
    "a world that is somewhere": ball().replace("<worldbody>", '<worldbody pos="1 0 0">'),
    "a world with a name": ball().replace("<worldbody>", '<worldbody name="w">'),
    "an unknown element of a body": ball(inside="<foo/>"),
    "an unknown section": ball(tail="<foo/>"),
    "an unknown sensor": ball(tail="<sensor><foo/></sensor>"),
    "an unknown class": ball('size="1" class="x"'),
    "an unknown class of children": ball(attributes='childclass="x"'),
    "a first class of another name": ball(head='<default class="x"/>'),
    "two classes of a name": default('<default class="a"/><default class="a"/>'),
    "a class without a name": default("<default/>"),
    "a wrong solid in a class": default('<default class="a"><geom type="foo"/></default>'),
    "two solids in a class": default('<geom size="1"/><geom mass="1"/>'),
    "an unknown element in a class": default("<foo/>"),
    "a name in a class": default('<joint name="a"/>'),
    "gravity in two numbers": ball(head='<option gravity="0 1"/>'),
    "two time steps": ball(head='<option timestep="1 2"/>'),
    "an unknown flag": ball(head='<option><flag gravity="false"/></option>'),
    "flags twice": ball(head="<option><flag/><flag/></option>"),
    "global coordinates": ball(head='<compiler coordinate="global"/>'),
    "unknown coordinates": ball(head='<compiler coordinate="foo"/>'),
    "a free leg": ball(inside='<body><freejoint/><geom size="1"/></body>'),
    "a free joint and a hinge": ball(joint="<freejoint/><joint/>"),
    "no mass": ball('size="1" mass="0"'),
    "no mass of a group": ball('size="1" group="3"', head='<compiler inertiagrouprange="0 2"/>'),
    "an unknown joint": leg('type="foo"'),
    "a sensor of an unknown site": ball(tail='<sensor><touch site="x"/></sensor>'),
    "a plane of no size": ball().replace('size="1 1 1"', 'size="0 0 0"'),
    "a plane without a size": ball().replace('size="1 1 1"', ""),
    "a plane that moves": ball(inside='<geom type="plane" size="1 1 1" contype="0" conaffinity="0"/>'),
    "a capsule of one size": ball('type="capsule" size=".1"'),
    "no number": ball('size="nan"'),
    "no axis of a hinge": leg('axis="0 0 1e-13"'),
    "an unknown body to exclude": ball(tail='<contact><exclude body1="x" body2="ball"/></contact>'),
    "impossible moments": inertial('mass="1" fullinertia="1.5 1.5 1 1 0 0"'),
    "two numbers of gravcomp": ball(attributes='gravcomp="1 2"'),
}


@pytest.mark.parametrize("why", BOTH_REFUSE)
def test_what_mujoco_refuses_is_refused_in_one_line(why):
    assert refusal(BOTH_REFUSE[why]) is not None
    with pytest.raises(ValueError) as error:
        read_model(BOTH_REFUSE[why])
    assert "\n" not in str(error.value) and re.search(
        "not allowed|unknown|missing|no class|no body|twice", str(error.value)
    )


# What MuJoCo refuses and the lab reads, and why.
EXCEPTIONS = {
    "moments that break what moments have by a hair: published files have two or three digits": inertial(
        'mass="1" diaginertia="1 1 2.001"'
    ),
    "moments below 1e-15, which is a bound of MuJoCo's": inertial('mass="1e-16" diaginertia="1e-17 1e-17 1e-17"'),
    "options that are ignored": ball(head='<option integrator="foo"/>'),
    "sections that are ignored": ball(tail="<visual><foo/></visual>"),
    "sensors that are ignored": ball(tail='<sensor><gyro site="nowhere"/></sensor>'),
    "cameras and lights": ball(inside='<light foo="1"/>'),
    "pairs of contact, which are ignored": ball(tail='<contact><pair geom1="nothing"/></contact>'),
    "attributes of other versions": ball(head='<compiler convexhull="true"/>'),
    "materials, which are ignored": ball('size="1" material="none"'),
}


@pytest.mark.parametrize("why", EXCEPTIONS)
def test_exceptions_are_refused_by_mujoco_and_read_here(why):
    assert refusal(EXCEPTIONS[why]) is not None
    read_model(EXCEPTIONS[why])


# What MuJoCo reads and the lab does not, and how docs/robot-files.md says so.
NOT_SUPPORTED = {
    "several robots": (ball().replace("</worldbody>", "<body/></worldbody>"), "several robots"),
    "several joints": (ball(joint='<joint axis="1 0 0"/><joint/>'), "several joints a body"),
    "a frame": (ball().replace("<body", "<frame><body").replace("</worldbody>", "</frame></worldbody>"), "`frame`"),
    "mocap": (ball(joint="", attributes='mocap="true"'), "`mocap`"),
    "a slide": (leg('type="slide"'), "`slide`"),
    "a ball joint": (leg('type="ball"'), "`ball`"),
    "a spring by its time": (leg('springdamper="1 1"'), "`springdamper` without an actuator"),
    "damping below 0": (leg('damping="-1"'), "damping, stiffness, friction or armature below 0"),
    "armature below 0": (leg('armature="-1"'), "damping, stiffness, friction or armature below 0"),
    "friction of a joint below 0": (leg('frictionloss="-1"'), "damping, stiffness, friction or armature below 0"),
    "damping of a free base below 0": (
        ball(joint='<joint type="free" damping="-1"/>'),
        "damping, stiffness, friction or armature below 0",
    ),
    "limits in the wrong order": (leg('range="1 -1"'), "limits that are not in order"),
    "an ellipsoid": (ball('type="ellipsoid" size="1 1 1"'), "ellipsoids"),
    "a turned box": (ball('type="box" size="1 1 1" euler="1 2 3"'), "other boxes"),
    "a wide cylinder": (ball('type="cylinder" size="1 .5"'), "cylinders that are wider than long"),
    "a wall": (ball().replace("<worldbody>", '<worldbody><geom size="1"/>'), "solids in the world other than"),
    "a hill": (ball().replace('type="plane"', 'type="plane" pos="0 0 1"'), "other than the plane z = 0"),
    "friction below 0": (ball('size="1" friction="-1"'), "friction below 0"),
    "a large ball": (ball('size="2e6" mass="1"'), "Sizes go up to 1e6 m"),
    "a large mass": (ball('size="1" mass="1e200"'), "masses to 1e100 kg"),
    "a total mass": (ball(head='<compiler settotalmass="3"/>'), "`settotalmass`"),
    "a shell": (ball('size="1" shellinertia="true"'), "`shellinertia`"),
    "an unknown axis": (ball(head='<compiler eulerseq="abc"/>'), "`eulerseq`"),
    "a muscle's gain": (leg(actuator='<general joint="hip" ctrlrange="-1 1" gaintype="user"/>'), "other actuators"),
    "a bias that pushes": (
        leg(actuator='<general joint="hip" ctrlrange="-1 1" biastype="affine" biasprm="0 2 0"/>'),
        "biases that grow with angle or rate",
    ),
    "an integrator": (
        leg(actuator='<general joint="hip" ctrlrange="-1 1" dyntype="integrator"/>'),
        "`dyntype` other than filters",
    ),
    "an integrator of a class": (
        leg(
            actuator='<position joint="hip" ctrlrange="-1 1"/>',
            head='<default><general dyntype="integrator"/></default>',
        ),
        "`dyntype` other than filters",
    ),
    "a muscle": (leg(actuator='<muscle joint="hip" lengthrange="0 1"/>'), "other actuators"),
    "two actuators": (leg(actuator='<motor joint="hip" ctrlrange="-1 1"/>' * 2), "several on a hinge"),
    "an actuator of a body's own frame": (
        leg(actuator='<motor jointinparent="hip" ctrlrange="-1 1"/>'),
        "actuators of anything but a `joint`",
    ),
    "no range": (leg(actuator='<motor joint="hip"/>'), "no range"),
    "a lopsided force": (
        leg(actuator='<position joint="hip" ctrlrange="-1 2" forcerange="0 1"/>'),
        "lopsided",
    ),
    "a lopsided force of a joint": (
        leg('actuatorfrcrange="0 1"', '<position joint="hip" ctrlrange="-1 2"/>'),
        "lopsided",
    ),
    "a gain below 0": (leg(actuator='<position joint="hip" kp="-1" ctrlrange="-1 1"/>'), "gains below 0"),
    "no gear": (leg(actuator='<motor joint="hip" gear="0" ctrlrange="-1 1"/>'), "a gear of 0"),
    "defaults of muscles": (
        leg(actuator='<position joint="hip" ctrlrange="-1 1"/>', head="<default><muscle/></default>"),
        "defaults of other actuators",
    ),
    "a share of the range of a hinge without limits": (
        leg('range="-1 1" limited="false"', '<position joint="hip" inheritrange="1"/>'),
        "`inheritrange` of a hinge without limits",
    ),
    "gravity aslant": (ball(head='<option gravity="0 1 -9"/>'), "gravity that is not along z"),
    "no time": (ball(head='<option timestep="0"/>'), "time steps that are not positive"),
    "a tendon": (ball(tail="<tendon/>"), "`tendon`"),
    "an equality": (ball(tail="<equality/>"), "`equality`"),
    "an extension": (ball(tail="<extension/>"), "`extension`"),
    "two sensors": (
        ball(inside='<site name="a"/>', tail='<sensor><touch site="a"/><touch site="a"/></sensor>'),
        "two on a body",
    ),
    "a sensor of a massless body": (
        ball(inside='<body><site name="a"/></body>', tail='<sensor><touch site="a"/></sensor>'),
        "on bodies that join their carriers",
    ),
    "an infinite mass": (ball('size="1" mass="inf"'), "infinite, hexadecimal or empty numbers"),
    "a hexadecimal size": (ball('size="0x1"'), "infinite, hexadecimal or empty numbers"),
    "an empty friction": (ball('size="1" friction=""'), "infinite, hexadecimal or empty numbers"),
}


@pytest.mark.parametrize("why", NOT_SUPPORTED)
def test_what_is_refused_beyond_mujoco_is_documented(why):
    text, told = NOT_SUPPORTED[why]
    assert refusal(text) is None
    with pytest.raises(ValueError) as error:
        read_model(text)
    assert "\n" not in str(error.value)
    assert told in " ".join((ROOT / "docs/robot-files.md").read_text().split())


def compare_harmed(seeds):
    """Harm random files; return how many MuJoCo refuses."""
    refused = 0
    for seed in seeds:
        text, (tag, name) = harmed(random_mjcf(seed % 100), seed)
        told = refusal(text)
        refused += told is not None
        try:
            if told is None:
                Pair(text).same()
                continue
            read_model(text)
        except ValueError as error:
            assert "\n" not in str(error), f"harmed text {seed}: {error}"
        except AssertionError as error:
            raise AssertionError(f"harmed text {seed}: {error}") from error
        else:
            assert name in OTHER_VERSIONS.get(tag, ()), f"harmed text {seed}, {name} of {tag}: MuJoCo says {told}"
    return refused


def test_harmed_files_are_refused_as_mujoco_refuses_them_or_read_alike():
    assert compare_harmed(range(200)) > 100


@pytest.mark.slow
def test_hundreds_of_harmed_files_are_refused_as_mujoco_refuses_them_or_read_alike():
    assert compare_harmed(range(1000, 3500)) > 1250
