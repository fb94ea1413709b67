"""Values in MJCF and URDF files that cannot be meant are refused in one line, and what published files have is read."""

import numpy as np
import pytest

from taichi_sim.rigid import Capsule, Sphere
from taichi_sim.rigid.model.assembly import Cylinder
from taichi_sim.rigid.model.files import load_model, parse_model

pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def ball(geom='size="0.5" mass="2"', inertial="", head="", ground=""):
    """A ball on the ground, as MJCF."""
    return (
        f'<mujoco>{head}<worldbody><geom name="ground" type="plane" size="1 1 1" {ground}/>'
        f'<body name="ball" pos="0 0 2"><freejoint/>{inertial}<geom name="skin" {geom}/></body></worldbody></mujoco>'
    )


def inertial(inertia):
    return f'<inertial pos="0 0 0" mass="1" {inertia}/>'


def driven(joint="", actuator='kp="10"', head=""):
    """A leg on a ball, as MJCF."""
    leg = f'<body name="leg"><joint name="hip" {joint}/><geom size="0.1" mass="1"/></body></body>'
    tail = f'<actuator><position name="servo" joint="hip" ctrlrange="-1 1" {actuator}/></actuator></mujoco>'
    return ball(head=head).replace("</body>", leg).replace("</mujoco>", tail)


def cart(limit='effort="2" velocity="4"', inertia='ixx="1" iyy="1" izz="1"', solid='sphere radius="0.1"', head=""):
    """A wheel on a base, as URDF."""
    link = '<link name="{}"><inertial><mass value="1"/><inertia {}/></inertial>{}</link>'
    base = link.format("base", 'ixx="1" iyy="1" izz="1"', "")
    wheel = link.format("wheel", inertia, f"<collision><geometry><{solid}/></geometry></collision>")
    joint = f'<joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/><limit {limit}/></joint>'
    return f"<robot>{head}{base}{wheel}{joint}</robot>"


def fixed(inside, name="holds", at=""):
    """A cart with a link that is fixed to its base, as URDF."""
    ends = f'<parent link="base"/><child link="tip"/><origin {at}/>'
    return cart(head=f'<link name="tip">{inside}</link><joint name="{name}" type="fixed">{ends}</joint>')


MOMENTS = "is not allowed; give ones of which none exceeds the sum of the others, or a compiler with balanceinertia"
REFUSED = {
    "an unknown unit of angles": (
        ball(head='<compiler angle="foo"/>'),
        "angle of compiler: 'foo' is unknown; choose one of degree, radian",
    ),
    "a gear whose square is no number": (
        driven(actuator='gear="1e200"'),
        "position servo: gear 1e+200 is not allowed; give at most 1e+100",
    ),
    "a bound of masses beyond numbers": (
        ball(head='<compiler boundmass="1e300"/>'),
        "compiler: a bound of 1e+300 is not allowed; give at most 1e+100",
    ),
    "a plural": (ball(head='<compiler angle="radians"/>'), "angle of compiler: 'radians' is unknown"),
    "an unknown rule of inertias": (
        ball(head='<compiler inertiafromgeom="yes"/>'),
        "inertiafromgeom of compiler: 'yes' is unknown; choose one of auto, true, false",
    ),
    "an unknown rule of limits": (
        driven('range="-1 1"', head='<compiler autolimits="1"/>'),
        "autolimits of compiler: '1' is unknown; choose one of true, false",
    ),
    "an unknown limit": (driven('range="-1 1" limited="yes"'), "limited of joint hip: 'yes' is unknown"),
    "an unknown limit of force": (driven(actuator='forcelimited="no"'), "forcelimited of position servo: 'no' is"),
    "friction below 0": (ball('size="0.5" friction="-1 0.1 0.1"'), "geom skin: friction -1 is not allowed; give at"),
    "friction of the ground below 0": (ball(ground='friction="-0.5"'), "geom ground: friction -0.5 is not allowed"),
    "friction below 0 that is not used": (ball('size="0.5" condim="1" friction="-1"'), "geom skin: friction -1 is"),
    "no friction": (ball('size="0.5" friction=""'), "geom skin: friction '' is not allowed; give finite numbers"),
    "a density below 0": (ball('size="0.5" density="-2"'), "geom skin: density -2 is not allowed; give at least 0"),
    "a mass below 0 beside others": (
        ball().replace("</body>", '<geom name="hole" size="0.1" mass="-1"/></body>'),
        "geom hole: mass -1 is not allowed; give at least 0",
    ),
    "a gain below 0": (driven(actuator='kp="-1"'), "position servo: kp -1 is not allowed; give at least 0"),
    "a drag below 0": (driven(actuator='kp="1" kv="-1"'), "position servo: kv -1 is not allowed; give at least 0"),
    "damping below 0": (driven('damping="-1"'), "joint hip: damping -1 is not allowed; give at least 0"),
    "a mass beyond all": (
        ball('size="0.5" mass="1e308"'),
        "geom skin: mass 1e+308 is not allowed; give at most 1e+100",
    ),
    "a density beyond all": (
        ball('size="1e5" density="1e307"'),
        "geom skin: mass 2e+100 is not allowed; give at most 1e+100 kg",
    ),
    "moments beyond all": (
        ball(inertial=inertial('diaginertia="1e308 1e308 1e308"')),
        "inertial of body ball: moments of inertia beyond 1e+150 kg m^2 are not allowed; give less mass",
    ),
    "a moment of 0 of what moves": (
        ball(inertial=inertial('diaginertia="0 1 1"')),
        "inertia of ball: a moment of 0 is not allowed; give moments above 0",
    ),
    "damping below 0 of a joint without a drive": (
        driven('damping="-1"')
        .replace('joint="hip"', 'joint="knee"')
        .replace(
            "</body></body>", '<body name="shin"><joint name="knee"/><geom size="0.1" mass="1"/></body></body></body>'
        ),
        "joint hip: damping -1 is not allowed; give at least 0",
    ),
    "damping below 0 of a link": (
        cart().replace("<limit", '<dynamics damping="-1"/><limit'),
        "joint axle: damping -1 is not allowed; give at least 0",
    ),
    "friction below 0 of a link": (
        cart().replace("<limit", '<dynamics friction="-1"/><limit'),
        "joint axle: friction -1 is not allowed; give at least 0",
    ),
    "an unknown rule of controls": (driven(actuator='ctrllimited="no"'), "ctrllimited of position servo: 'no' is"),
    "an unknown sequence": (
        ball(head='<compiler eulerseq="abc"/>'),
        "compiler: eulerseq 'abc' is not allowed; give three of x, y, z, X, Y and Z",
    ),
    "an unknown number of dimensions": (
        ball('size="0.5" condim="2"'),
        "geom skin: condim 2 is not allowed; give 1, 3, 4 or 6",
    ),
    "no time": (
        ball(head='<option timestep="0"/>'),
        "timestep of option: 0.0 is not allowed; give a positive finite number",
    ),
    "a number with a line in it": (
        ball('size="0.5" mass="1_0"'),
        "geom skin: mass '1_0' is not allowed; give 1 finite",
    ),
    "Arabic digits": (
        ball('size="0.5" mass="\u0661"'),
        "geom skin: mass '\u0661' is not allowed; give 1 finite number",
    ),
    "wide digits": (cart(limit='effort="\uff12"'), "limit: effort '\uff12' is not allowed; give 1 finite number"),
    "a hexadecimal number": (ball('size="0.5" mass="0x1"'), "geom skin: mass '0x1' is not allowed"),
    "an infinite number": (ball('size="0.5" mass="inf"'), "geom skin: mass 'inf' is not allowed"),
    "a number beyond all": (ball('size="0.5" mass="1e999"'), "geom skin: mass '1e999' is not allowed"),
    "a space that is none": (ball('size="0.5" pos="0\u00a00 0"'), "geom skin: pos '0\\xa00 0' is not allowed; give 3"),
    "a long list": (ball(f'size="{"1 " * 200}x"'), f"geom skin: size '{'1 ' * 49}1... is not allowed; give finite"),
    "moments that no mass has": (
        ball(inertial=inertial('diaginertia="1 4 2"')),
        f"inertial of body ball: an inertia of moments 1, 2, 4 {MOMENTS}",
    ),
    "moments that no mass has, turned": (
        ball(inertial=inertial('fullinertia="1.5 1.5 1 1 0 0"')),
        f"inertial of body ball: an inertia of moments 0.5, 1, 2.5 {MOMENTS}",
    ),
    "a moment below 0": (ball(inertial=inertial('diaginertia="-1 1 1"')), "inertial of body ball: an inertia of"),
    "an unknown balance": (
        ball(head='<compiler balanceinertia="yes"/>'),
        "balanceinertia of compiler: 'yes' is unknown; choose one of false, true",
    ),
    "moments of a link": (
        cart(inertia='ixx="1" iyy="1" izz="3"'),
        f"link wheel: an inertia of moments 1, 1, 3 {MOMENTS}",
    ),
    "effort below 0": (cart('effort="-2" velocity="4"'), "joint axle: effort -2 is not allowed; give at least 0"),
    "a velocity below 0": (cart('effort="2" velocity="-4"'), "joint axle: velocity -4 is not allowed; give at least 0"),
    "a velocity below 0 of no effort": (cart('effort="0" velocity="-4"'), "joint axle: velocity -4 is not allowed"),
    "a mass below 0 of a link that is fixed": (
        fixed('<inertial><mass value="-1.5"/><inertia/></inertial>'),
        "link tip: mass -1.5 is not allowed; give at least 0",
    ),
    "moments of a link without a mass": (
        fixed('<inertial><mass value="0"/><inertia ixx="0.5" iyy="0.5" izz="0.5"/></inertial>'),
        "link tip: moments of inertia without a mass are not allowed; give a mass, or moments of 0",
    ),
    "two links of a name": (
        cart(head='<link name="wheel"/>'),
        "link wheel: the name is given twice; give each link a name of its own",
    ),
    "two joints of a name": (
        fixed("", "axle"),
        "joint axle: the name is given twice; give each joint a name of its own",
    ),
    "a link without a name": (cart(head="<link/>"), "link: name is missing; give each link a name of its own"),
    "a joint without a name": (fixed("", ""), "joint: name is missing; give each joint a name of its own"),
    "two turns of a joint": (
        fixed("", at='rpy="0 0 1" quat_xyzw="0 0 0 1"'),
        "origin of joint holds: rpy and quat_xyzw are not allowed together; give one turn",
    ),
    "no turn of a joint": (
        fixed("", at='quat_xyzw="0 0 0 0"'),
        "origin of joint holds: quat_xyzw of length 0 is not allowed; give a unit quaternion",
    ),
    "a ball like a galaxy": (
        ball('size="1e200"'),
        "geom skin: radius: 1e+200 is not allowed; give a positive number, at most 1e+06",
    ),
    "a ball of more than a million metres": (ball('size="1.1e6"'), "geom skin: radius: 1100000.0 is not allowed"),
    "a box like a galaxy": (ball('type="box" size="1 1e150 1"'), "geom skin: size: 2e+150 is not allowed"),
    "a capsule like a galaxy": (ball('type="capsule" size="1 1e150"'), "geom skin: length: 2e+150 is not allowed"),
    "a picture like a galaxy": (
        ball('type="cylinder" size="1e200 1" contype="0" conaffinity="0"'),
        "geom skin: radius: 1e+200 is not allowed",
    ),
    "a link like a galaxy": (
        cart(solid='cylinder radius="0.1" length="1e150"'),
        "collision of link wheel: length: 1e+150 is not allowed; give a positive number, at most 1e+06",
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_values_that_cannot_be_meant_are_refused_in_a_line_that_names_the_file(why, tmp_path):
    text, message = REFUSED[why]
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(ValueError) as error:
        load_model(tmp_path / "robot.xml")
    told = str(error.value)
    assert told.startswith(f"{tmp_path / 'robot.xml'}: {message}") and "\n" not in told and len(told) < 400


@pytest.mark.parametrize("make", [Sphere, lambda size: Capsule(size, 1.0), lambda size: Cylinder(size, 1.0)])
@pytest.mark.parametrize("size", [0.0, -1.0, 1.1e6, 1e200, True, "1"])
def test_solids_have_sizes_whose_powers_are_numbers(make, size):
    with pytest.raises(ValueError, match=r"^radius: .* is not allowed; give a positive number, at most 1e\+06$"):
        make(size)
    assert 0 < make(1e6).volume < np.inf


def test_what_touches_nothing_but_has_mass_is_found_by_water():
    """Not what is a picture, nor what cannot be placed: a turned box, a flat cylinder."""
    solids = (
        '<geom size="0.1" contype="0" conaffinity="0"/>'
        '<geom size="0.2" mass="0" contype="0" conaffinity="0" group="6"/>'
        '<geom type="box" size="0.1 0.2 0.3" euler="30 20 10" contype="0" conaffinity="0"/>'
        '<geom type="cylinder" size="0.2 0.1" contype="0" conaffinity="0"/>'
    )
    text = f'<mujoco><worldbody><body name="fish"><freejoint/>{solids}</body></worldbody></mujoco>'
    (body,) = parse_model(text).tree.bodies
    assert [type(solid) for solid in body.immersed] == [Sphere] and not body.shapes
    assert body.immersed[0].radius == 0.1 and len(parse_model(text).tree.portions()) == 1


def test_numbers_are_read_as_c_and_xml_write_them():
    for text, mass in (("+2", 2), ("2.", 2), (".5", 0.5), ("2e0", 2), ("2.5E-1", 0.25), (" \t2\n", 2), ("20e-1", 2)):
        assert parse_model(ball(f'size="0.5" mass="{text}"')).tree.bodies[0].mass == mass


def test_a_long_list_of_numbers_that_ends_badly_takes_no_longer_than_it_is():
    """Half a million digits and as many numbers: a syntax that tries all ways of cutting them would never end."""
    for text in ("1" * 500_000 + "_", "1.5e3 " * 500_000 + "_", "1 " * 500_000 + "e"):
        with pytest.raises(ValueError, match=r"^geom skin: size '1.*\.\.\. is not allowed; give finite numbers$"):
            parse_model(ball(f'size="{text}"'))


def test_the_digits_of_a_file_may_break_what_moments_have_by_a_hair():
    """A sheet of 1.234 and 2.345 kg m^2, written in three digits: 1.23 + 2.34 < 3.58."""
    assert np.allclose(parse_model(cart(inertia='ixx="1.23" iyy="2.34" izz="3.58"')).tree.bodies[1].inertia[2, 2], 3.58)
    sheet = parse_model(ball(inertial=inertial('fullinertia="1.5 1.5 3 0.7 0 0"'))).tree.bodies[0]
    assert np.allclose(sheet.inertia, [[1.5, 0.7, 0], [0.7, 1.5, 0], [0, 0, 3]])


@pytest.mark.parametrize(
    ("moments", "expected"), [("1 1 3", 5 / 3), ("1 2 5", 8 / 3), ("1 1 2.001", 4.001 / 3), ("1 2 3", None)]
)
def test_a_file_may_have_its_impossible_inertias_balanced(moments, expected):
    """To the mean of the moments, as MuJoCo 4.0 does; possible ones stay."""
    x, y, z = moments.split()
    balanced = '<compiler balanceinertia="true"/>'
    wanted = np.diag([1.0, 2, 3]) if expected is None else expected * np.eye(3)
    found = parse_model(ball(inertial=inertial(f'diaginertia="{moments}"'), head=balanced)).tree.bodies[0]
    assert np.allclose(found.inertia, wanted)
    inertia = f'ixx="{x}" iyy="{y}" izz="{z}"'
    assert np.allclose(
        parse_model(cart(inertia=inertia, head=f"<mujoco>{balanced}</mujoco>")).tree.bodies[1].inertia, wanted
    )


def test_no_effort_is_no_drive():
    """Files say so of joints that nothing drives; Drake makes no actuator of them, either."""
    for limit in ('effort="0" velocity="4"', 'velocity="4"', 'lower="-1"'):
        model = parse_model(cart(limit))
        assert model.tree.hinges[0].motor is None and model.commands == ()


def test_elements_of_joints_and_links_that_do_nothing_are_named():
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    inside = '<calibration rising="0.3"/><safety_controller k_velocity="1" soft_lower_limit="-0.2"/>'
    ball = "<collision><geometry><sphere radius='0.1'/></geometry></collision>"
    text = f"""<robot name="arm"><link name="base">{inertial}{ball}</link><link name="arm">{inertial}<sensor/></link>
      <joint name="axle" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="0"/>{inside}</joint></robot>"""
    assert parse_model(text).ignored == ("<calibration>", "<safety_controller>", "<sensor>")
    assert parse_model(text.replace(inside, "").replace("<sensor/>", "")).ignored == ()


def test_a_free_urdf_robot_that_touches_nothing_is_told_of():
    """It fell without end, with a status of ok; the warning had named <visual> only."""
    looks = cart().replace("collision>", "visual>")
    with pytest.warns(UserWarning, match="<visual>; that nothing of the robot touches the ground, as it has no <coll"):
        parse_model(looks)
    assert parse_model(looks, fixed=True).ignored == ("<visual>",) and parse_model(cart()).ignored == ()


def test_attributes_and_elements_that_urdf_has_not_are_named():
    """A misspelt velocity was no limit of velocity, and a misspelt turn no turn, without a word."""
    limit = 'effort="2" velocty="4" drake:acceleration="3"'
    text = cart(limit, solid='sphere radius="0.1" scale="2"').replace("<robot", '<robot xmlns:drake="http://drake.org"')
    text = text.replace("<collision>", '<collision><orign xyz="0 0 1"/><origin RPY="0 0 1"/>')
    assert parse_model(text).ignored == (
        "<orign>",
        "RPY of <origin>",
        "acceleration of <limit>",
        "scale of <sphere>",
        "velocty of <limit>",
    )
    assert parse_model(cart().replace("<collision>", '<collision name="skin"><origin rpy="0 0 1"/>')).ignored == ()


def test_a_urdf_robot_may_be_turned_by_quaternions():
    """They came with version 1.2, and were taken for no turn."""
    inertial = '<inertial><origin xyz="0 0 -0.2"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    by_quaternion, by_angles = (
        tree.bodies[tree.place_of("tip")].position
        for at in ('quat_xyzw="2 0 0 2"', f'rpy="{np.pi / 2} 0 0"')
        if (tree := parse_model(fixed(inertial, at=f'xyz="0 0 1" {at}')).tree)
    )
    assert by_quaternion == pytest.approx(by_angles) and by_angles[1] == pytest.approx(0.2)


def test_a_base_that_stands_still_may_have_moments_without_a_mass():
    """As in files of PyBullet, where bases of no mass do not move."""
    massless = cart().replace('mass value="1"', 'mass value="0"', 1)
    assert parse_model(massless, fixed=True).tree.masses.tolist() == [0, 1]
    with pytest.raises(ValueError, match=r"^link base: moments of inertia without a mass are not allowed; give a mass"):
        parse_model(massless)
