"""Robots from MJCF and URDF files: masses, places, hinges and drives against hand computation and built trees."""

import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from robots.quadruped import LEGS, TEXT, WHEGGED, Quadruped
from taichi_sim.rigid import Capsule, Hinge, Passive, Physics, RigidEngine, Servo, Sphere, State, Weld
from taichi_sim.rigid.model.assembly import depth_of
from taichi_sim.rigid.model.files import load_model, parse_model
from taichi_sim.rigid.tables import parameters_of, points_of

pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def mjcf(body, head="", tail=""):
    ground = '<geom name="ground" type="plane" size="1 1 1"/>'
    return f"<mujoco>{head}<worldbody>{ground}{body}</worldbody>{tail}</mujoco>"


BALL = '<body name="ball" pos="1 2 3"><freejoint/><geom type="sphere" size="0.5" mass="2"/></body>'

ANT = mjcf(
    '<body name="torso" pos="0 0 0.55" childclass="ant"><freejoint name="root"/>'
    '<geom name="torso" size="0.25" pos="0 0 0"/><site name="belly"/>'
    + "".join(
        f'<body name="aux {i}" pos="{0.2 * x} {0.2 * y} 0">'
        f'<geom type="capsule" fromto="0 0 0 {0.2 * x} {0.2 * y} 0"/>'
        f'<joint name="hip {i}" axis="0 0 1" range="-40 40"/>'
        f'<body name="shin {i}" pos="{0.2 * x} {0.2 * y} 0">'
        f'<geom type="capsule" fromto="0 0 0 {0.4 * x} {0.4 * y} -0.2"/><site name="toe {i}"/>'
        f'<joint name="knee {i}" axis="{-y} {x} 0" range="-30 70"/></body></body>'
        for i, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)))
    )
    + "</body>",
    '<compiler angle="degree"/><option timestep="0.01" gravity="0 0 -9.81"/>'
    '<default><default class="ant"><geom type="sphere" size="0.08" density="500" friction="0.7 0.1 0.1"/>'
    '<joint damping="1"/><default class="soft"/></default><position ctrlrange="-0.5 0.5" kp="20" forcerange="-15 15"/>'
    "</default>",
    '<actuator><position name="first" joint="knee 2"/><velocity joint="hip 0" kv="4" ctrlrange="-3 3" gear="2"/>'
    '<motor joint="hip 1" gear="150" ctrlrange="-1 1"/></actuator>'
    '<sensor><touch site="toe 3"/><touch site="belly"/><jointpos joint="hip 0"/></sensor>',
)


def test_an_ant_has_the_masses_and_inertias_of_its_solids():
    tree = parse_model(ANT).tree
    torso = tree.bodies[tree.place_of("torso")]
    mass = 500 * 4 / 3 * np.pi * 0.25**3
    assert np.isclose(torso.mass, mass) and np.allclose(torso.inertia, 0.4 * mass * 0.25**2 * np.eye(3))
    shin = dict(zip([body.name for body in tree.bodies], tree.bodies, strict=True))["shin 0"]
    length, radius = np.sqrt(0.36), 0.08
    tube, caps = 500 * np.pi * radius**2 * length, 500 * 4 / 3 * np.pi * radius**3
    assert np.isclose(shin.mass, tube + caps)
    assert np.allclose(shin.position, [0.4 + 0.2, 0.4 + 0.2, 0.55 - 0.1])
    along = np.array([0.4, 0.4, -0.2]) / length
    small, large = np.sort(np.linalg.eigvalsh(shin.inertia))[[0, -1]]
    assert np.isclose(along @ shin.inertia @ along, small)
    assert np.isclose(small, tube * radius**2 / 2 + caps * 0.4 * radius**2)
    ends = caps * (0.4 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)  # two half balls, each at its own end
    assert np.isclose(large, tube * (radius**2 / 4 + length**2 / 12) + ends)


def test_an_ant_has_its_hinges_drives_and_senses():
    model = parse_model(ANT, speed=8.0, fastest=12.0)
    tree, hinges = model.tree, {hinge.child: hinge for hinge in model.tree.hinges}
    assert not tree.fixed and len(tree.bodies) == 9 and len(hinges) == 8
    knee = hinges["shin 2"]
    assert np.allclose(knee.anchor, [-0.4, -0.4, 0.55]) and np.allclose(knee.axis, np.array([1, -1, 0]) / np.sqrt(2))
    assert np.allclose(knee.stops, np.radians([-30, 70]))
    assert model.commands == ("first", "hip 0", "hip 1") and knee.command == 0 and tree.motors == 3
    # kp / (kv + damping) = 20 of what lacks in a second; controls of +-0.5 are angles, commands of +-1
    assert (knee.motor.torque, knee.motor.by_angle, knee.motor.by_command, knee.motor.offset) == (15, -20, 10, 0)
    wheel = hinges["aux 0"].motor  # gear 2: half the rate; 2 x the default forcerange, which all kinds share
    assert (wheel.torque, wheel.by_angle, wheel.by_command, wheel.offset) == (30, 0, 1.5, 0)
    assert (hinges["aux 1"].motor.torque, hinges["aux 1"].motor.by_command) == (150, 12)
    assert hinges["aux 3"].motor is None
    assert list(model.senses.touch) == ["shin 3", "torso"]
    assert model.world == Physics(0.01, -9.81, friction=1.0)  # the larger one counts, and that of the ground is 1


@pytest.mark.parametrize(
    ("drives", "names"),
    [
        ('<position joint="hip 0"/><position name="hip 0" joint="hip 1"/>', ("hip 0'", "hip 0")),
        ('<position name="hip 1" joint="hip 0"/><position joint="hip 1"/>', ("hip 1", "hip 1'")),
        ('<position name="first" joint="hip 0"/><position joint="hip 1"/>', ("first", "hip 1")),
    ],
)
def test_drives_have_names_of_their_own(drives, names):
    """A drive without a name has its joint's, which may be that of another drive; parameters were named twice."""
    head, _, tail = ANT.partition("<actuator>")
    assert parse_model(f"{head}<actuator>{drives}</actuator>{tail.partition('</actuator>')[2]}").commands == names


@pytest.mark.kernels
def test_an_ant_stands_on_its_feet():
    model = parse_model(ANT)
    engine = RigidEngine(model.tree, model.world, model.senses, precision="f32", threads=1)
    done = engine.run(300, commands=np.zeros((1, 1, 3)))
    assert done.status[0] == "ok" and 0.2 < done.position[0, 2] < 0.6


def test_what_is_ignored_is_named_in_one_warning():
    with pytest.warns(UserWarning, match=r"^model: ignored are ") as caught:
        model = parse_model(ANT)
    assert len(caught) == 1 and "\n" not in str(caught[0].message)
    assert set(model.ignored) == {
        "<jointpos> sensors",
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parse_model(mjcf(BALL))


# the same robot, described here and there


def whegged_text():
    """The whegged quadruped with the inertias of its solids, as MJCF."""
    limit, rate = TEXT.joint_limit, TEXT.wheel_rate
    legs = ""
    for leg, (x, y) in enumerate(LEGS):
        legs += (
            f'<body name="thigh {leg}" pos="{0.3 * x} {0.3 * y} 0">'
            f'<joint name="hip {leg}" pos="{-0.15 * x} {-0.15 * y} 0" axis="{y} {-x} 0" range="{-limit} {limit}"/>'
            f'<geom type="capsule" size="0.05 0.15" zaxis="{x} {y} 0" mass="1"/>'
            f'<body name="shin {leg}" pos="{0.15 * x} {0.15 * y} -0.175">'
            '<geom type="capsule" size="0.05 0.15" mass="1"/>'
            f'<body name="wheel {leg}" pos="0 0 -0.175"><joint name="axle {leg}" axis="1 0 0"/>'
            '<geom size="0.1" mass="1"/></body></body></body>'
        )
    hips = "".join(
        f'<position joint="hip {n}" kp="10" kv="10" ctrlrange="{-limit} {limit}" forcerange="-10 10"/>'
        for n in range(4)
    )
    axles = "".join(
        f'<velocity joint="axle {n}" kv="10" ctrlrange="{-rate} {rate}" forcerange="-10 10"/>' for n in range(4)
    )
    main = '<body name="main" pos="0 0 0.35"><joint type="free"/><geom type="box" size="0.15 0.15 0.05" mass="1"/>'
    return mjcf(f"{main}{legs}</body>", '<compiler angle="radian"/>', f"<actuator>{hips}{axles}</actuator>")


def same_trees(first, second):
    assert [type(joint) for _, joint in first.ordered] == [type(joint) for _, joint in second.ordered]
    assert [body.name for body, _ in first.ordered] == [body.name for body, _ in second.ordered]
    assert np.allclose(parameters_of(first), parameters_of(second), rtol=1e-12, atol=1e-15)
    assert np.allclose(np.sort(points_of(first), 0), np.sort(points_of(second), 0), rtol=0, atol=1e-12)


@pytest.mark.kernels
def test_the_whegged_quadruped_as_mjcf_is_the_one_that_is_built():
    built, model = WHEGGED.tree(TEXT), parse_model(whegged_text(), speed=10.0, fastest=10.0)
    same_trees(model.tree, built)
    assert [hinge.command for hinge in model.tree.hinges] == [hinge.command for hinge in built.hinges]
    commands = np.random.default_rng(0).uniform(-1, 1, (3, 10, 8))
    engines = [RigidEngine(tree, Physics(0.05, -1.0), precision="f64", threads=1) for tree in (built, model.tree)]
    ends = [engine.run(100, commands=commands, hold=10).position for engine in engines]
    assert np.allclose(*ends, rtol=0, atol=1e-9)


ARM = """<robot name="arm">
  <link name="base_link"/>
  <link name="trunk">
    <inertial><origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><mass value="3"/>
      <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial>
    <collision><origin xyz="0 0 0.05" rpy="1.5707963267948966 0 0"/>
      <geometry><box size="0.4 0.1 0.2"/></geometry></collision>
    <visual><geometry><mesh filename="trunk.stl"/></geometry></visual>
  </link>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.01"/></inertial></link>
  <link name="marker"><collision><origin xyz="0 0 -0.4"/><geometry><sphere radius="0.06"/></geometry></collision></link>
  <link name="wheel"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
    <collision><geometry><cylinder radius="0.1" length="0.5"/></geometry></collision></link>
  <link name="sensor"><inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001"/></inertial></link>
  <joint name="root" type="fixed"><origin xyz="0 0 1"/><parent link="base_link"/><child link="trunk"/></joint>
  <joint name="shoulder" type="revolute"><origin xyz="0 0.2 0" rpy="1.5707963267948966 0 0"/>
    <parent link="trunk"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="0.5" effort="7" velocity="2"/></joint>
  <joint name="tip" type="fixed"><parent link="upper"/><child link="marker"/></joint>
  <joint name="axle" type="continuous"><origin xyz="0 0 -0.5"/><parent link="upper"/><child link="wheel"/>
    <axis xyz="1 0 0"/><limit effort="2" velocity="6"/></joint>
  <joint name="clip" type="fixed"><origin xyz="0.1 0 0"/><parent link="trunk"/><child link="sensor"/></joint>
</robot>"""


def test_a_urdf_robot_has_its_links_joints_and_limits():
    model = parse_model(ARM, speed=5.0)
    tree = model.tree
    bodies = {body.name: body for body in tree.bodies}
    assert list(bodies) == ["base_link", "upper", "sensor", "wheel"] and not tree.fixed  # what has no mass joins others
    trunk = bodies["base_link"]
    assert trunk.mass == 3 and np.allclose(trunk.position, [0.1, 0, 1])
    assert np.allclose(trunk.inertia, [[0.2, -0.01, 0], [-0.01, 0.1, 0], [0, 0, 0.25]])
    assert np.allclose(trunk.shapes[0].size, [0.4, 0.2, 0.1]) and np.allclose(trunk.shapes[0].centre, [-0.1, 0, 0.05])
    shoulder, axle = tree.hinges
    assert (
        np.allclose(shoulder.anchor, [0, 0.2, 1])
        and np.allclose(shoulder.axis, [0, 0, 1])
        and shoulder.stops == (-1, 0.5)
    )
    assert (shoulder.motor.torque, shoulder.motor.by_angle, shoulder.motor.fastest) == (7, -5, 2)
    assert np.isclose(shoulder.motor.by_command, 5 * 0.75) and np.isclose(shoulder.motor.offset, 5 * -0.25)
    assert np.allclose(axle.anchor, [0, 0.7, 1]) and axle.stops is None  # the frame of the arm is turned
    assert (axle.motor.torque, axle.motor.by_command, model.commands) == (2, 6, ("shoulder", "axle"))
    marker, wheel = bodies["upper"].shapes[0], bodies["wheel"].shapes[0]
    assert isinstance(marker, Sphere) and np.allclose(marker.centre, [0, 0.4, 0])
    assert isinstance(wheel, Capsule) and np.isclose(wheel.length, 0.3) and np.allclose(np.abs(wheel.axis), [0, 1, 0])
    assert isinstance(next(joint for joint in tree.joints if joint.child == "sensor"), Weld)
    assert model.ignored == ("<visual>", "edges of cylinders, which touch the ground as capsules of their length")


def test_rotors_dampers_and_springs_are_those_of_the_file():
    told = '<joint name="hip 1" armature="0.02" stiffness="2" springref="30"'
    hinges = {hinge.child: hinge for hinge in parse_model(ANT.replace('<joint name="hip 1"', told)).tree.hinges}
    assert hinges["aux 1"].passive == Passive(0.02, 1.0, 2.0, np.radians(30))
    assert hinges["shin 2"].passive == Passive(damping=1.0)
    without = ANT.replace("<mujoco>", '<mujoco><option><flag spring="disable" damper="disable"/></option>')
    assert {hinge.passive for hinge in parse_model(without).tree.hinges} == {Passive()}


def test_drives_have_the_torques_of_the_file():
    """Those of MuJoCo: kp (ctrl - length) - kv velocity, gear times as long and as strong at the hinge."""
    hinges = {hinge.child: hinge.motor for hinge in parse_model(ANT).tree.hinges}
    assert hinges["shin 2"] == Servo(10.0, -20.0, 0.0, 0.0, 15.0)
    assert hinges["aux 0"].torque == 30 and hinges["aux 0"].by_angle == 0
    assert hinges["aux 0"].by_command == 1.5 * hinges["aux 0"].by_rate > 0
    assert hinges["aux 1"].by_command == 150 and hinges["aux 1"].by_rate == 0 and hinges["aux 3"] is None


def test_what_a_file_does_not_say_has_the_defaults_of_mujoco():
    usual = Physics(0.002, -9.81, friction=1.0)
    assert parse_model(ARM).world == parse_model(mjcf(BALL)).world == usual


def test_a_time_step_may_take_the_place_of_the_files():
    assert parse_model(ANT, time_step=0.001).world == Physics(0.001, -9.81, friction=1.0)
    knee = next(hinge for hinge in parse_model(ANT, time_step=0.2, speed=9.0).tree.hinges if hinge.child == "shin 2")
    assert knee.motor.by_angle == -5  # all that lacks, in a step
    shoulder = parse_model(ARM, time_step=0.2).tree.hinges[0]
    assert parse_model(ARM, time_step=0.2).world.time_step == 0.2 and shoulder.motor.by_angle == -5


def test_a_urdf_robot_may_be_fixed_and_read_from_a_file(tmp_path):
    (tmp_path / "arm.urdf").write_text('<?xml version="1.0"?>\n' + ARM)
    assert load_model(tmp_path / "arm.urdf", fixed=True).tree.fixed


WALKER = """<robot name="walker">
  <link name="base"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
    <collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision></link>
  <link name="leg"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 -0.23"/><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="leg"/><axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="0.5" effort="0" velocity="1"/></joint></robot>"""


def test_a_urdf_robot_is_raised_out_of_the_ground():
    """Its base is at the origin, its foot 0.25 m below; what does not reach the ground stays."""
    tree = parse_model(WALKER).tree
    assert [body.position[2] for body in tree.bodies] == pytest.approx([0.25, 0.15])
    assert tree.hinges[0].anchor == pytest.approx([0, 0, 0.25])
    bent = parse_model(WALKER, angles={"hip": 0.4}).tree
    assert bent.bodies[0].position[2] == pytest.approx(0.23 * np.cos(0.4) + 0.02)
    assert parse_model(ARM).tree.bodies[0].position[2] == 1


def test_a_fixed_urdf_robot_is_raised_until_what_moves_is_above_the_ground():
    """What does not move may lie in the ground, and what turns about a vertical axis only, as a column does."""
    for text, fixed, height in ((WALKER, True, 0.25), (STAND, False, 0.4)):
        with pytest.warns(UserWarning, match=rf"the height of its base, which is fixed {height} m higher"):
            tree = parse_model(text, fixed=fixed).tree
        assert tree.fixed and depth_of(tree) == pytest.approx(0, abs=1e-12)
    assert parse_model(WALKER, fixed=True).tree.hinges[0].anchor == pytest.approx([0, 0, 0.25])
    for still in (STAND.replace('axis xyz="0 1 0"', 'axis xyz="0 0 -2"'), STAND.replace("revolute", "fixed")):
        assert not any("height" in each for each in parse_model(still).ignored)
        assert parse_model(still).tree.bodies[0].position[2] == pytest.approx(0 if "revolute" in still else -0.2)


@pytest.mark.kernels
def test_a_leg_on_a_stand_goes_where_it_is_told():
    """The ground threw it to its stop, at 3 rad."""
    model = parse_model(STAND)
    done = RigidEngine(model.tree, model.world, threads=1).run(500, commands=np.full((1, 1, 1), 0.5 / 3), hold=500)
    assert done.angles[0, 0] == pytest.approx(0.5, abs=1e-2)


@pytest.mark.kernels
def test_a_urdf_robot_is_not_thrown_out_of_the_ground():
    model = parse_model(WALKER)
    done = RigidEngine(model.tree, model.world, threads=1).run(100, record_every=1)
    assert done.frames.position[:, 0, 2].max() <= 0.25 + 1e-9


STAND = """<robot name="leg"><link name="world"/><link name="leg">
  <inertial><origin xyz="0 0 -0.2"/><mass value="0.5"/><inertia ixx="7e-3" iyy="7e-3" izz="1e-4"/></inertial>
  <collision><origin xyz="0 0 -0.2"/><geometry><capsule radius="0.02" length="0.36"/></geometry></collision></link>
  <joint name="h" type="revolute"><parent link="world"/><child link="leg"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="5" velocity="10"/></joint></robot>"""
HUNG = """<body name="leg" pos="0 0 {}"><joint name="h" axis="{}" range="-170 170"/>
  <geom type="capsule" fromto="0 0 -0.02 0 0 -0.38" size="0.02" mass="0.5"/></body>"""


def test_files_whose_fixed_robot_starts_deep_in_the_ground_are_refused(tmp_path):
    """A hinge in the world let the ground throw its leg to a stop, without a word."""
    path = tmp_path / "leg.xml"
    path.write_text(mjcf(HUNG.format(0.3, "0 1 0")))
    with pytest.raises(ValueError, match=r"its start 100 mm deep in the ground, .* starts at least 0\.1 m higher"):
        load_model(path)
    with pytest.warns(UserWarning, match="that it starts 100 mm deep in the ground, which throws it out"):
        parse_model(path.read_text())
    for height, axis in ((0.4, "0 1 0"), (0.3, "0 0 1")):  # what turns about a vertical axis is not moved by the ground
        path.write_text(mjcf(HUNG.format(height, axis)))
        assert not load_model(path).ignored


def test_a_start_in_the_ground_is_told():
    sunk = mjcf(BALL.replace('pos="1 2 3"', 'pos="1 2 0.45"'))
    with pytest.warns(UserWarning, match="that it starts 50 mm deep in the ground, which throws it out"):
        assert parse_model(sunk).tree.bodies[0].position[2] == 0.45
    assert not parse_model(mjcf(BALL.replace('pos="1 2 3"', 'pos="1 2 0.5"'))).ignored


def test_files_whose_robot_starts_deep_in_the_ground_are_refused(tmp_path):
    """It was thrown out; from as high as the message says it is allowed, and a little deep it is told of."""
    path = tmp_path / "ball.xml"

    def at(height):
        path.write_text(mjcf(BALL.replace('pos="1 2 3"', f'pos="1 2 {height}"')))
        return load_model(path)

    told = r"ball\.xml: model: its start 50 mm deep in the ground, .* starts at least 0\.05 m higher"
    with pytest.raises(ValueError, match=told), warnings.catch_warnings(action="error"):  # nothing is told twice
        at(0.45)
    with pytest.raises(ValueError, match=r"5\.1 mm deep"):
        at(0.4949)
    with pytest.warns(UserWarning, match="that it starts 4.9 mm deep"):
        at(0.4951)
    assert not at(0.5).ignored
    small = BALL.replace('size="0.5"', 'size="0.02"')
    path.write_text(mjcf(small.replace('pos="1 2 3"', 'pos="1 2 0.0181"')))
    with pytest.warns(UserWarning, match="that it starts 1.9 mm deep"):
        load_model(path)
    path.write_text(mjcf(small.replace('pos="1 2 3"', 'pos="1 2 0.0179"')))
    with pytest.raises(ValueError, match=r"2\.1 mm deep"):
        load_model(path)


@pytest.mark.parametrize(("kind", "bodies"), [("fixed", 4), ("continuous", 5)])
def test_a_urdf_robot_on_a_link_named_world_is_fixed(kind, bodies):
    held = ARM.replace("base_link", "world").replace('name="root" type="fixed"', f'name="root" type="{kind}"')
    tree = parse_model(held).tree
    assert tree.fixed and tree.bodies[0].name == "world" and len(tree.bodies) == bodies
    heavy = '<link name="world"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    assert not parse_model(held.replace('<link name="world"/>', heavy)).tree.fixed


PENDULUM = """<body name="bob" pos="0 0 2"><joint name="pivot" axis="0 -1 0" range="20 120" ref="0"/>
  <geom type="box" size="0.1 0.2 0.05" pos="0 0 -0.5" mass="2"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="1"/>
</body>"""


def test_a_hinge_whose_range_excludes_its_zero_rests_in_the_middle():
    sphere = mjcf(PENDULUM.replace("box", "sphere"))
    with pytest.warns(UserWarning, match="hinges whose range excludes it: they rest in its middle"):
        tree = parse_model(sphere).tree
    told = parse_model(sphere, angles={"pivot": np.radians(70)}).tree
    assert np.allclose(tree.hinges[0].stops, np.radians([-50, 50]))
    assert np.allclose(tree.bodies[1].position, told.bodies[1].position)
    bent = ARM.replace('lower="-1"', 'lower="0.2"')
    with pytest.warns(UserWarning, match="they rest in its middle"):
        arm = parse_model(bent).tree
    (shoulder,) = [hinge for hinge in arm.hinges if hinge.stops is not None]
    assert shoulder.stops == pytest.approx((-0.15, 0.15))


def test_the_ant_of_gymnasium_is_read_as_it_is():
    with pytest.warns(UserWarning, match="they rest in its middle"):
        model = load_model(Path(gymnasium.__path__[0], "envs/mujoco/assets/ant.xml"))
    assert len(model.commands) == 8 and len(model.tree.hinges) == 8
    assert all(low < 0 < high for low, high in (hinge.stops for hinge in model.tree.hinges))


def test_a_body_hinged_to_the_world_hangs_on_a_fixed_base_and_may_rest_at_any_angle():
    with pytest.raises(ValueError, match="stops of bob"):
        parse_model(mjcf(PENDULUM), angles={"pivot": 2.2})
    tree = parse_model(mjcf(PENDULUM.replace("box", "sphere")), angles={"pivot": np.pi / 2}).tree
    assert tree.fixed and [body.name for body in tree.bodies] == ["world", "bob"]
    assert np.allclose(tree.hinges[0].stops, np.radians([20 - 90, 120 - 90])) and np.allclose(
        tree.hinges[0].anchor, [0, 0, 2]
    )
    bob = tree.bodies[1]
    assert bob.mass == 3 and np.allclose(bob.position, [(2 * 0.5 + 1 * 0.2) / 3, 0, 2])  # it points along +x


def test_two_solids_of_a_body_have_their_inertia_about_their_common_centre():
    bob = parse_model(mjcf(PENDULUM.replace("20 120", "-20 120"))).tree.bodies[1]
    assert bob.mass == 3 and np.allclose(bob.position, [0, 0, 2 - (2 * 0.5 + 0.2) / 3])
    rod = Capsule(0.02, 0.4).inertia(1.0)
    expected = 2 / 12 * np.diag([0.4**2 + 0.1**2, 0.2**2 + 0.1**2, 0.2**2 + 0.4**2]) + rod
    expected += np.diag([1, 1, 0]) * (2 * 1 / 3) * 0.3**2  # of both masses about their common centre
    assert np.allclose(bob.inertia, expected)


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        ('quat="0.5 0.5 0.5 0.5"', [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        ('axisangle="0 0 2 90"', [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ('euler="90 90 0"', [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        ('xyaxes="0 1 0 -1 0 0"', [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ('zaxis="1 0 0"', [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    ],
)
def test_turns_are_read_in_all_ways_of_giving_them(turn, expected):
    body = (
        f'<body pos="0 0 1" {turn}><freejoint/>'
        '<inertial pos="0.1 0.2 0.3" mass="1" fullinertia="0.3 0.4 0.5 0.01 0.02 0.03"/></body>'
    )
    found = parse_model(mjcf(body)).tree.bodies[0]
    rotation, inertia = np.array(expected), np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    assert np.allclose(found.position, [0, 0, 1] + rotation @ [0.1, 0.2, 0.3])
    assert np.allclose(found.inertia, rotation @ inertia @ rotation.T)


CHAIN = """<body name="a" pos="0.1 0.2 50" euler="10 20 30"><freejoint/>
  <geom type="capsule" fromto="0 0 0 .1 .2 .3" size="0.03"/>
  <geom type="cylinder" size="0.05 0.2" pos=".1 0 .2" euler="40 -20 10" density="300"/>
  <body name="b" pos=".2 .1 -.1" axisangle="1 2 3 50"><joint axis="1 1 0" pos=".02 .03 .04"/>
    <geom type="sphere" size=".1" pos=".1 .1 .1"/><geom type="capsule" size="0.02 0.2" zaxis="1 2 -1" mass=".5"/>
    <body name="c" quat=".5 .1 .2 .3"><joint axis="0 1 3"/>
      <inertial pos=".1 .2 .3" quat=".9 .1 .2 .3" mass="2" diaginertia=".1 .12 .2"/></body>
    <body name="d" xyaxes="1 2 0 -1 1 1"><joint type="hinge" axis="0 0 2"/>
      <geom type="sphere" size=".1 .2 .3" pos=".1 0 0" contype="0" conaffinity="0" mass="1"/></body></body></body>"""


@pytest.mark.kernels
@pytest.mark.parametrize("integration", ["momentum", "velocity"])
def test_a_chain_that_is_thrown_moves_as_in_mujoco(integration):
    """To first order in the time step: numbers of its Runge-Kutta integrator with steps of 0.1 ms, after 1 s."""
    tree = parse_model(mjcf(CHAIN, '<compiler eulerseq="zyx"/>')).tree
    expected = [0.46080671, 0.58970554, 49.81613182, 2.30081259, -2.48561735, -0.98396627]
    errors = []
    for steps in (500, 2000):
        engine = RigidEngine(tree, Physics(1 / steps, -1.0, integration=integration), precision="f64", threads=1)
        rest, thrown = engine.rest(), np.array([[0.5, -1.0, 2.0, 0.3, 0.2, 0.1]])
        done = engine.run(
            steps, start=State(rest.position, rest.orientation, rest.angles, thrown, np.array([[1.0, -2, 0.7]]))
        )
        errors.append(np.abs(np.array([*done.position[0], *done.angles[0]]) - expected))
    assert errors[1].max() < 0.01 and np.all(errors[1] < errors[0] / 3)


def with_joint(joint):
    leg = f'<body name="leg" pos="0 0 -1">{joint}<geom size="0.1" mass="1"/></body></body>'
    return mjcf(BALL.replace("</body>", leg))


LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
JOINT = '<joint name="j" type="{}"><parent link="a"/><child link="b"/></joint>'
BAD = {
    "no XML": ("<mujoco>", "model: this is no XML"),
    "another file": ("<html/>", "model: <html> is unknown"),
    "a document type": ('<!DOCTYPE r [<!ENTITY e "x">]><mujoco>&e;</mujoco>', "model: a document type is not allowed"),
    "tendons": ("<mujoco><tendon/></mujoco>", "model: <tendon> is not allowed"),
    "two robots": (mjcf(BALL + BALL), "worldbody: 2 bodies are not allowed"),
    "no robot": (mjcf(""), "worldbody: 0 bodies are not allowed"),
    "a slope": (
        mjcf(BALL).replace('type="plane"', 'type="plane" euler="10 0 0"'),
        "geom ground: not allowed; give one plane",
    ),
    "an obstacle": (
        mjcf('<geom name="wall" type="box" size="1 1 1"/>' + BALL),
        "geom wall: the world has a plane only",
    ),
    "a slide": (with_joint('<joint name="s" type="slide"/>'), "joint s: type 'slide' is not allowed here"),
    "two joints": (with_joint('<joint axis="1 0 0"/><joint axis="0 1 0"/>'), "body leg: 2 joints are not allowed"),
    "a free leg": (with_joint("<freejoint/>"), "body leg: a free joint is not allowed on it"),
    "a spring by its time": (
        with_joint('<joint name="k" springdamper="1 1"/>'),
        "joint k: springdamper is not allowed without an actuator; give stiffness and damping",
    ),
    "a spring by its time, of a class": (
        with_joint('<joint name="k"/>').replace("<mujoco>", '<mujoco><default><joint springdamper="1 1"/></default>'),
        "joint k: springdamper is not allowed without an actuator",
    ),
    "an axis of no length": (with_joint('<joint name="k" axis="0 0 0"/>'), "joint k: axis '0 0 0' is not allowed"),
    "stops that exclude the rest": (
        with_joint('<joint range="20 10"/>'),
        "joint: range '20 10' is not allowed; give two limits, the lower first",
    ),
    "an unknown class": (with_joint('<joint name="k" class="x"/>'), "joint k: there is no class 'x'; there are main"),
    "a mesh": (mjcf(BALL.replace("sphere", "mesh")), "geom: type 'mesh' is not allowed; give sphere, capsule, box"),
    "a turned box": (
        mjcf(BALL.replace('type="sphere" size="0.5"', 'name="b" type="box" size="1 1 1" euler="0 0 30"')),
        "geom b: a box that is turned where its hinges rest is not allowed",
    ),
    "a size that is no number": (mjcf(BALL.replace("0.5", "half")), "geom: size 'half' is not allowed"),
    "a capsule without length": (mjcf(BALL.replace("sphere", "capsule")), "geom: 1 sizes are not allowed; give 2"),
    "no mass": (mjcf(BALL.replace('mass="2"', 'mass="0"')), "mass of ball: 0 is not allowed"),
    "sideways gravity": (mjcf(BALL, '<option gravity="1 0 -9"/>'), "option: gravity '1 0 -9' is not allowed"),
    "a drive of nothing": (mjcf(BALL, tail='<actuator><motor ctrlrange="-1 1"/></actuator>'), "motor: not allowed"),
    "a drive of a stranger": (
        mjcf(BALL, tail='<actuator><velocity name="v" joint="k"/></actuator>'),
        "velocity v: there is no hinge 'k'",
    ),
    "a muscle": (
        with_joint('<joint name="k"/>').replace("</mujoco>", '<actuator><muscle joint="k"/></actuator></mujoco>'),
        "muscle: not allowed; give general, motor, position, velocity",
    ),
    "a drive without a range": (
        with_joint('<joint name="k"/>').replace("</mujoco>", '<actuator><motor joint="k"/></actuator></mujoco>'),
        "motor: ctrlrange is missing",
    ),
    "a URDF joint that slides": (
        f"<robot>{LINK.format('a')}{LINK.format('b')}{JOINT.format('prismatic')}</robot>",
        "joint j: type 'prismatic' is not allowed",
    ),
    "a URDF joint of a stranger": (
        f"<robot>{LINK.format('a')}{JOINT.format('fixed')}</robot>",
        "joint j: there is no link 'b'",
    ),
    "two URDF robots": (f"<robot>{LINK.format('a')}{LINK.format('b')}</robot>", "robot: 2 links without a parent"),
    "a URDF hinge without limits": (
        f"<robot>{LINK.format('a')}{LINK.format('b')}{JOINT.format('revolute')}</robot>",
        "joint j: limit is missing",
    ),
    "a URDF drive of negative speed": (
        ARM.replace('velocity="2"', 'velocity="-2"'),
        "joint shoulder: velocity -2 is not allowed; give at least 0",
    ),
    "a URDF mesh": (
        f"<robot>{LINK.format('a')}</robot>".replace(
            "</link>", '<collision><geometry><mesh filename="x"/></geometry></collision></link>'
        ),
        "collision of link a: mesh is not allowed",
    ),
}


@pytest.mark.parametrize("bad", BAD)
def test_what_the_engine_has_not_is_one_line(bad):
    text, message = BAD[bad]
    with pytest.raises(ValueError) as error:
        parse_model(text)
    assert str(error.value).startswith(message) and "\n" not in str(error.value)


def test_files_and_settings_that_are_not_allowed_are_one_line(tmp_path):
    for attempt, message in (
        (lambda: load_model(tmp_path / "none.xml"), "none.xml: cannot be read"),
        (lambda: parse_model(ANT, angles={"hip 9": 1.0}), "angles: there is no hinge 'hip 9'; there are hip 0"),
        (lambda: parse_model(ARM, angles={"tip": 1.0}), "angles: there is no hinge 'tip'"),
        (lambda: parse_model(ANT, speed=0.0), "speed: 0.0 is not allowed"),
        (lambda: parse_model(ANT, fixed=True), "fixed: True is not allowed of MJCF"),
        (lambda: parse_model(ARM, time_step=0.0), "time_step: 0.0 is not allowed"),
    ):
        with pytest.raises(ValueError, match=message) as error:
            attempt()
        assert "\n" not in str(error.value)


def test_a_hinge_is_described_alike_at_any_rest():
    """The position that becomes the rest changes where bodies lie, and nothing of what they are or can do."""
    bent = parse_model(whegged_text(), angles={"hip 1": 0.4, "axle 1": 0.3}).tree
    straight = Quadruped("whegged").tree(TEXT)
    hip, straight_hip = (next(hinge for hinge in tree.hinges if hinge.child == "thigh 1") for tree in (bent, straight))
    assert isinstance(hip, Hinge) and np.allclose(hip.axis, straight_hip.axis)
    assert np.allclose(hip.stops, np.subtract(straight_hip.stops, 0.4))
    assert np.isclose(hip.motor.offset, -0.4 * -hip.motor.by_angle)
    places = [{body.name: np.array(body.position) for body in tree.bodies} for tree in (bent, straight)]
    for parent, child in (("thigh 1", "shin 1"), ("shin 1", "wheel 1")):
        assert np.isclose(*(np.linalg.norm(each[child] - each[parent]) for each in places))
    raised = [each["wheel 1"] - straight_hip.anchor for each in places]
    assert np.allclose(raised[0][:2] @ [1, 0], 0) and np.isclose(*(np.linalg.norm(each) for each in raised))
    assert np.isclose(raised[0] @ raised[1], np.cos(0.4) * (raised[1] @ raised[1])) and raised[0][2] > raised[1][2]
