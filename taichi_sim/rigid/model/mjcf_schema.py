"""What MJCF allows: the elements and attributes of the sections that are read, and what of them the engine ignores.

Source: MuJoCo's schema (``mj_printSchema``), versions 2.3 to 4.0. A test compares it with that of the MuJoCo installed.
Sections that are not read, such as <asset> and <visual>, are not checked.
"""

from collections.abc import Iterable
from xml.etree.ElementTree import Element

from taichi_sim.base.checks import choice
from taichi_sim.rigid.model.xml_values import integer, keyword, named, numbers, single


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split())


READ = ("compiler", "option", "default", "worldbody", "actuator", "sensor", "contact")
WRONG = ("equality", "tendon", "deformable", "extension", "include")  # the robot moves otherwise with them
IGNORED = ("asset", "custom", "keyframe", "size", "statistic", "visual")
IN_BODIES = ("body", "joint", "freejoint", "geom", "inertial", "site", "camera", "light")

OTHER_TURNS = ("axisangle", "euler", "xyaxes", "zaxis")  # beside quat
TURNS = ("quat", *OTHER_TURNS)
_SOFT_STOPS = ("solreflimit", "solimplimit", "solreffriction", "solimpfriction")
_SOFT_CONTACTS = ("solref", "solimp", "solmix")
TRANSMISSIONS = _words("cranklength cranksite jointinparent refsite site slidersite tendon")
_ACTUATOR = _words(
    "name class group user joint ctrlrange ctrllimited forcerange forcelimited gear lengthrange damping armature "
    "delay interp nsample"
)
_DISABLED = _words(  # flags that are usually on
    "constraint equality frictionloss limit contact spring damper passive gravity clampctrl warmstart "
    "filterparent actuation refsafe sensor midphase nativeccd eulerdamp autoreset island multiccd"
)
_ENABLED = _words("override energy fwdinv invdiscrete sensornoise sleep diagexact")  # flags that are usually off
_NO_MOTION = _words(  # flags that change how something is computed, or what the engine has not
    "equality warmstart filterparent refsafe sensor midphase nativeccd eulerdamp autoreset island "
    "multiccd energy fwdinv invdiscrete sensornoise sleep diagexact"
)
ATTRIBUTES = {
    "mujoco": ("model",),
    "compiler": _words(
        "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict convexhull coordinate "
        "discardvisual eulerseq exactmeshinertia fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir "
        "saveinertial settotalmass strippath texturedir usethread"
    ),
    "option": _words(
        "timestep gravity actuatorgroupdisable apirate ccd_iterations ccd_tolerance collision cone density "
        "impratio integrator iterations jacobian ls_iterations ls_tolerance magnetic mpr_iterations mpr_tolerance "
        "noslip_iterations noslip_tolerance o_friction o_margin o_solimp o_solref sdf_initpoints sdf_iterations "
        "sleep_tolerance solver tolerance viscosity wind"
    ),
    "flag": _DISABLED + _ENABLED,
    "default": ("class",),
    **dict.fromkeys(("worldbody", "actuator", "sensor", "contact"), ()),
    "body": ("name", "childclass", "pos", *TURNS, "mocap", "gravcomp", "sleep", "simple", "user"),
    "inertial": ("pos", *TURNS, "mass", "diaginertia", "fullinertia"),
    "joint": _words(
        "name class type group pos axis limited range ref actuatorfrclimited actuatorfrcrange actuatorgravcomp "
        "armature damping frictionloss margin springdamper springref stiffness user"
    )
    + _SOFT_STOPS,
    "freejoint": ("name", "group", "align"),
    "geom": _words(
        "name class type contype conaffinity condim group priority size friction mass density pos fromto adhesion "
        "fitscale fluidcoef fluidshape gap hfield margin material mesh rgba shellinertia surfacevel user"
    )
    + TURNS
    + _SOFT_CONTACTS,
    "site": ("name", "class", "type", "group", "pos", *TURNS, "fromto", "material", "rgba", "size", "user"),
    "motor": _ACTUATOR + TRANSMISSIONS,
    "position": (*_ACTUATOR, *TRANSMISSIONS, "kp", "kv", "dampratio", "timeconst", "inheritrange"),
    "velocity": (*_ACTUATOR, *TRANSMISSIONS, "kv"),
    "general": (*_ACTUATOR, *TRANSMISSIONS)
    + _words(
        "body actdim actearly actlimited actrange biasprm biastype dynprm dyntype ffrange gainprm gaintype input "
        "velrange"
    ),
    "touch": _words("name site cutoff noise user nsample interp delay interval"),
    "exclude": ("name", "body1", "body2"),
}
DRIVES = ("general", "motor", "position", "velocity")
OTHER_DRIVES = ("adhesion", "cylinder", "damper", "dcmotor", "intvelocity", "muscle", "orientation", "pid")
_SENSORS = _words(
    "accelerometer actuatorfrc actuatorpos actuatorvel ballangvel ballquat camprojection clock contact distance "
    "e_kinetic e_potential force frameangacc frameangvel framelinacc framelinvel framepos framequat framexaxis "
    "frameyaxis framezaxis fromto gyro insidesite jointactuatorfrc jointlimitfrc jointlimitpos jointlimitvel "
    "jointpos jointvel magnetometer normal plugin rangefinder subtreeangmom subtreecom subtreelinvel tactile "
    "tendonactuatorfrc tendonlimitfrc tendonlimitpos tendonlimitvel tendonpos tendonvel torque touch user "
    "velocimeter"
)
IN_DEFAULTS = _words(
    "adhesion camera cylinder damper dcmotor default equality general geom intvelocity joint light material mesh "
    "motor muscle orientation pair pid position site tendon velocity"
)
_CHILDREN: dict[str, tuple[str, ...]] = {
    "mujoco": READ + IGNORED,
    "compiler": ("lengthrange",),
    "option": ("flag",),
    "default": IN_DEFAULTS,
    "worldbody": IN_BODIES,
    "body": IN_BODIES,
    "contact": ("exclude", "pair"),
    "actuator": (*DRIVES, *OTHER_DRIVES, "plugin"),
    "sensor": _SENSORS,
}
_COUNTS: dict[str, int | tuple[int, int]] = {  # numbers that attributes hold: so many, or from so many on to so many
    **dict.fromkeys(("user", "surfacevel"), (1, 1000)),
    **dict.fromkeys(
        _words(
            "adhesion armature boundinertia boundmass cranklength cutoff dampratio damping delay density fitscale "
            "frictionloss gap gravcomp inheritrange kp kv margin mass noise ref settotalmass solmix springref "
            "stiffness timeconst timestep"
        ),
        1,
    ),
    **dict.fromkeys(
        _words("actuatorfrcrange ctrlrange forcerange inertiagrouprange lengthrange range springdamper"), 2
    ),
    **dict.fromkeys(_words("axis diaginertia euler gravity magnetic pos wind zaxis"), 3),
    **dict.fromkeys(("axisangle", "quat", "rgba"), 4),
    **dict.fromkeys(("fromto", "fullinertia", "xyaxes"), 6),
    **dict.fromkeys(("friction", "size"), (1, 3)),
    **dict.fromkeys(("solref", "solreflimit", "solreffriction"), (1, 2)),
    **dict.fromkeys(("fluidcoef", "solimp", "solimplimit", "solimpfriction"), (1, 5)),
    **dict.fromkeys(("biasprm", "dynprm", "gainprm"), (1, 10)),
    "gear": (1, 6),
}
_INTEGERS = ("conaffinity", "condim", "contype", "group", "priority")
_AUTO, _TRUE, _FALSE = ("auto", "true", "false"), ("true", "false"), ("false", "true")
_KINDS_OF_JOINTS = ("hinge", "free", "ball", "slide")
_KINDS_OF_SOLIDS = ("sphere", "capsule", "box", "cylinder", "ellipsoid", "hfield", "mesh", "plane", "sdf")
BIASES = ("none", "affine", "muscle", "dcmotor", "so3", "user")
GAINS = ("fixed", "affine", "muscle", "dcmotor", "so3", "pid", "user")
_WORDS = {  # that attributes hold one of
    **dict.fromkeys(("actuatorfrclimited", "actlimited", "ctrllimited", "forcelimited", "limited"), _AUTO),
    **dict.fromkeys(("autolimits", "usethread"), _TRUE),
    **dict.fromkeys(
        _words(
            "actuatorgravcomp alignfree balanceinertia discardvisual fitaabb fusestatic mocap saveinertial "
            "shellinertia strippath"
        ),
        _FALSE,
    ),
    **dict.fromkeys(("align", "inertiafromgeom"), _AUTO),
    "angle": ("degree", "radian"),
    "biastype": BIASES,
    "gaintype": GAINS,
    "dyntype": ("none", "integrator", "filter", "filterexact", "muscle", "dcmotor", "pid", "user"),
    "coordinate": ("local", "global"),
    "fluidshape": ("none", "ellipsoid"),
}
_SOFT = "how soft contacts and stops are"
_NOTES = {  # attributes that are ignored, and named unless they are 0
    "body": {"gravcomp": "gravcomp of bodies"},
    "joint": {
        **{name: f"{name} of joints" for name in ("margin", "springdamper")},
        "actuatorgravcomp": "gravcomp of bodies",
        **dict.fromkeys(_SOFT_STOPS, _SOFT),
    },
    "geom": {
        **{name: f"{name} of geoms" for name in ("adhesion", "gap", "margin", "surfacevel")},
        **dict.fromkeys(_SOFT_CONTACTS, _SOFT),
    },
}
DRIVE_NOTES = ("armature", "damping", "dampratio", "delay", "timeconst")  # of actuators, likewise


def checked(element: Element) -> Element:
    """Return an element whose attributes and children MJCF knows, and that is turned in one way at most.

    Raises:
        ValueError: if it is not so; names the element.
    """
    for name in element.attrib:
        if not ATTRIBUTES[element.tag]:
            raise ValueError(f"{element.tag}: attribute {name!r} is not allowed; leave it out")
        choice(f"attribute of {named(element)}", name, ATTRIBUTES[element.tag])
        _check_value(element, name)
    turns = [name for name in TURNS if name in element.attrib]
    if len(turns) > 1:
        raise ValueError(f"{named(element)}: {' and '.join(turns)} are not allowed together; give one turn")
    allowed = _CHILDREN.get(element.tag, ())
    for child in element:
        if child.tag not in allowed:
            instead = f"give {', '.join(allowed)}" if allowed else "leave it out"
            raise ValueError(f"{named(element)}: <{child.tag}> is not allowed; {instead}")
    return element


def _check_value(element: Element, name: str) -> None:
    """Check that an attribute holds numbers, or a word, of its kind; whether they are allowed, readers say."""
    if element.tag == "flag":
        words: tuple[str, ...] | None = ("disable", "enable")
    elif name == "type":
        words = _KINDS_OF_JOINTS if element.tag == "joint" else _KINDS_OF_SOLIDS
    else:
        words = _WORDS.get(name)
    if words is not None:
        keyword(element, name, *words)
    elif name in _INTEGERS:
        integer(element, name, "0")
    elif isinstance(count := _COUNTS.get(name), tuple):
        if len(found := numbers(element, name)) > count[1]:
            raise ValueError(
                f"{named(element)}: {len(found)} numbers in {name} are not allowed; give at most {count[1]}"
            )
    elif count is not None:
        numbers(element, name, None, count)


def notes(element: Element) -> dict[str, None]:
    """What the engine ignores of an element whose defaults are in it, in the order in which it is named."""
    found = dict[str, None]()
    for name, note in _NOTES.get(element.tag, {}).items():
        text = element.get(name, "false")
        if text not in ("true", "false"):
            text = "true" if numbers(element, name).any() else "false"
        if text == "true":
            found[note] = None
    return found


def unusual_flags(options: Iterable[Element]) -> dict[str, str]:
    """Flags of <option> that are set otherwise than usual and change how robots move, with what they are set to.

    Raises:
        ValueError: for a flag that MJCF does not know, or that is neither ``enable`` nor ``disable``.
    """
    found = dict[str, str]()
    for option in options:
        flag = single(option, "flag")
        for name, value in checked(flag).items() if flag is not None else ():
            found[name] = value
    usual = {**dict.fromkeys(_DISABLED, "enable"), **dict.fromkeys(_ENABLED, "disable")}
    return {name: value for name, value in found.items() if name not in _NO_MOTION and value != usual[name]}
