"""Read MJCF, MuJoCo's format: bodies, hinges, solids, drives and touch sensors become a tree of hinges.

Source: MuJoCo documentation, "XML reference" (meaning and defaults of attributes) and "Modeling" (frames, default
classes). What its reader makes of a file, tests compare with this one.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_sim.base.checks import positive
from taichi_sim.rigid.model.assembly import (
    OUTSIDE,
    SHALLOW,
    USUAL,
    Frame,
    Lump,
    Model,
    Part,
    depth_of,
    rest_within,
    tree_of,
)
from taichi_sim.rigid.model.mjcf_compiler import Compiler, merged
from taichi_sim.rigid.model.mjcf_contact import Contacts
from taichi_sim.rigid.model.mjcf_defaults import Defaults
from taichi_sim.rigid.model.mjcf_drives import Ideal, drive, symmetric
from taichi_sim.rigid.model.mjcf_matter import check_solid, read_matter
from taichi_sim.rigid.model.mjcf_schema import (
    IGNORED,
    TRANSMISSIONS,
    WRONG,
    checked,
    notes,
    unusual_flags,
)
from taichi_sim.rigid.model.settings import Physics
from taichi_sim.rigid.model.tree import Hinge, Joint, Motor, Passive, Servo, Weld
from taichi_sim.rigid.model.xml_values import direction, keyword, named, not_negative, number, numbers, with_names
from taichi_sim.rigid.tables import Senses

_ALONG = ("stiffness", "damping", "armature", "frictionloss")  # of joints, none of which is below 0
_OPTIONS = ("timestep", "gravity")
_FLAGS = ("gravity", "limit", "spring", "damper", "passive", "frictionloss")  # that are read, beside "contact"


def read_mjcf(
    root: Element, angles: dict[str, float], speed: float | None, fastest: float | None, time_step: float | None
) -> Model:
    """Read the robot of an MJCF file.

    Raises:
        ValueError: for entries that are not allowed.
    """
    for tag in WRONG:
        if root.find(tag) is not None:
            raise ValueError(f"model: <{tag}> is not allowed; give trees of hinges without it")
    reader = MjcfReader(checked(root), angles, speed, fastest)
    if time_step is not None:
        reader.option.set("timestep", str(float(time_step)))
    fixed = reader.read()
    unknown = sorted(set(angles) - set(reader.hinges))
    if unknown:
        raise ValueError(f"angles: there is no hinge {unknown[0]!r}; there are {', '.join(reader.hinges)}")
    tree = tree_of(reader.parts, fixed)
    touching = reader.touching({body.name for body in tree.bodies})
    world, ignored = reader.world(), reader.all_ignored()
    if (depth := depth_of(tree)) > SHALLOW:
        ignored += (f"that it starts {1e3 * depth:.3g} mm deep in the ground, which throws it out",)
    return Model(tree, Senses(touching), world, reader.commands(), ignored)


class BodyRead(NamedTuple):
    """What a file says of a body: its name, given or made, the default class within it, its place and mass at rest."""

    name: str
    childclass: str
    place: Frame
    lump: Lump


@dataclass(eq=False)
class MjcfReader:
    """Reader of an MJCF file, which collects parts, drives, sensors and ignored entries.

    Once it has read, ``bodies_read`` has what it found of every body, in their order.
    """

    root: Element
    angles: dict[str, float]
    speed: float | None
    fastest: float | None
    parts: list[Part] = field(default_factory=list)
    hinges: dict[str, tuple[str, float]] = field(default_factory=dict)  # the body on each, and its angle in the file
    sites: dict[str, str] = field(default_factory=dict)
    ignored: dict[str, None] = field(default_factory=dict)  # in the order found
    bodies_read: dict[Element, BodyRead] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.compiler, self.defaults = Compiler.of(self.root), Defaults(self.root)
        self.option = Element("option", merged(checked(each) for each in self.root.iterfind("option")))
        self.flags = unusual_flags(self.root.iterfind("option"))
        bases = [body for each in self.root.iterfind("worldbody") for body in checked(each).iterfind("body")]
        if len(bases) != 1:
            raise ValueError(f"worldbody: {len(bases)} bodies are not allowed; give one robot")
        self.base = bases[0]
        self._read_names()
        for tag in ("contact", "actuator", "sensor"):
            for section in self.root.iterfind(tag):
                checked(section)
        for sensor in self.root.iterfind("sensor/*"):
            if len(sensor) and sensor.tag != "plugin":
                raise ValueError(f"{named(sensor)}: <{sensor[0].tag}> is not allowed in it; leave it out")
        excludes = [checked(each) for each in self.root.iterfind("contact/exclude")]
        pairs = [{each.get("body1", ""), each.get("body2", "")} for each in excludes]
        for name in set().union(*pairs) - self.bodies:
            raise ValueError(f"exclude: there is no body {name!r}; give a body's name, or world")
        excluded = frozenset(name for pair in pairs if "world" in pair for name in pair)
        self.contacts = Contacts(self.compiler, excluded, self.flags.pop("contact", "enable") == "disable")
        self.drives: dict[str, tuple[int, Element]] = {}
        for command, actuator in enumerate(each for group in self.root.iterfind("actuator") for each in group):
            given = self.defaults.drive(actuator)
            joint = given.get("joint", "")
            if not joint or joint in self.drives or any(name in given.attrib for name in TRANSMISSIONS):
                raise ValueError(f"{named(given)}: not allowed; give each drive the joint that it alone moves")
            self.drives[joint] = command, given

    def _read_names(self) -> None:
        """Check that names are given once; keep those of bodies and joints."""
        found = {tag: list(self.root.iterfind(f"worldbody//{tag}")) for tag in ("body", "joint", "geom", "site")}
        found["joint"] += self.root.iterfind("worldbody//freejoint")
        found["actuator"], found["sensor"] = (
            list(self.root.iterfind("actuator/*")),
            list(self.root.iterfind("sensor/*")),
        )
        names = {kind: set(with_names(elements, kind)) for kind, elements in found.items()}
        if "world" in names["body"]:
            raise ValueError("body world: the name is not allowed, as it is that of the world; give another")
        self.bodies, self.joints = names["body"] | {"world"}, names["joint"]

    def read(self) -> bool:
        """Read all bodies; return whether the base is fixed to the world."""
        for worldbody in self.root.iterfind("worldbody"):
            for geom in worldbody.iterfind("geom"):
                solid = self.defaults.resolved(geom, "main")
                check_solid(solid, self.compiler)
                self.contacts.add(solid)
        base, world = self.base, Frame(np.zeros(3), np.eye(3))
        loose = [is_free(joint) for joint in self._joints_of(base, "main")]
        hanging = bool(loose) and not loose[0]
        if hanging:
            self.parts.append(Part("world", None, Lump()))
        self._read_body(base, "world" if hanging else None, world, "main", still=True)
        lost = [joint for joint in self.drives if joint not in self.joints or joint not in self.hinges]
        if lost:
            raise ValueError(f"{named(self.drives[lost[0]][1])}: there is no hinge {lost[0]!r}")
        return not any(loose)

    def _joints_of(self, body: Element, childclass: str) -> list[Element]:
        childclass = self.defaults.named(checked(body).get("childclass", childclass), body)
        found = [child for child in body if child.tag in ("joint", "freejoint")]
        return [self.defaults.resolved(each, childclass) for each in found]

    def _read_body(self, body: Element, parent: str | None, carrier: Frame, childclass: str, still: bool) -> None:
        """Read a body and those on it; ``still`` says whether what carries it does not move."""
        joints = self._joints_of(body, childclass)
        childclass = body.get("childclass", childclass)
        name = body.get("name") or unlike(f"body {len(self.parts)}", self.bodies)
        if keyword(body, "mocap", "false", "true") == "true":
            raise ValueError(f"body {name}: mocap is not allowed; give a body that moves by itself")
        place = carrier.then(numbers(body, "pos", "0 0 0", 3), self.compiler.turn(body))
        if len(joints) > 1:
            raise ValueError(f"body {name}: {len(joints)} joints are not allowed; give one, and a body for each")
        carried: Joint | None = None if parent is None else Weld(parent, name)
        if joints and is_free(joints[0]):
            self._read_free(joints[0], name, parent)
        elif joints:
            place, carried = self._read_hinge(joints[0], place, parent or "", name)
        still = still and not joints
        geoms = [self.defaults.resolved(each, childclass) for each in body.iterfind("geom")]
        lump, shapes, immersed = read_matter(body, geoms, place, self.compiler, self.contacts, still)
        self.ignored |= notes(body)
        self.bodies_read[body] = BodyRead(name, childclass, place, lump)
        for site in body.iterfind("site"):
            self.sites[self.defaults.resolved(site, childclass).get("name", "")] = name
        self.parts.append(Part(name, carried, lump, tuple(shapes), tuple(immersed), place.position))
        for child in body:
            if child.tag == "body":
                self._read_body(child, name, place, childclass, still)
            elif child.tag in ("camera", "light"):
                self.ignored[f"<{child.tag}>"] = None

    def _read_free(self, joint: Element, body: str, parent: str | None) -> None:
        """Check the joint of a free base."""
        if parent is not None:
            raise ValueError(f"body {body}: a free joint is not allowed on it; give it to the base")
        if joint.tag == "joint":
            self.ignored |= dict.fromkeys(f"{each} of free joints" for each in _ALONG if self._along(joint, each))
            self.ignored |= notes(joint)

    def _passive(self, joint: Element, rest: float, driven: bool) -> Passive:
        """Rotor, damper and spring of a hinge that rests at an angle [rad]."""
        stiffness, damping, armature, friction = (self._along(joint, each) for each in _ALONG)
        if numbers(joint, "springdamper", "0 0", 2).any() and not driven:
            raise ValueError(
                f"{named(joint)}: springdamper is not allowed without an actuator; give stiffness and damping"
            )
        if self._is_off("spring"):
            stiffness = 0.0
        if self._is_off("damper"):
            damping = 0.0
        if self.flags.get("frictionloss"):
            friction = 0.0
        spring_rest = self.compiler.angle(number(joint, "springref", "0")) - rest
        return Passive(armature, damping, stiffness, spring_rest, friction)

    def _is_off(self, what: str) -> bool:
        return bool(self.flags.get(what) or self.flags.get("passive"))

    def _along(self, joint: Element, name: str) -> float:
        return not_negative(joint, name, number(joint, name, "0"))

    def _read_hinge(self, joint: Element, place: Frame, parent: str, child: str) -> tuple[Frame, Hinge]:
        """Read a joint: the place of the body when its hinge is at rest, and the hinge."""
        if (kind := joint.get("type", "hinge")) != "hinge":
            raise ValueError(f"{named(joint)}: type {kind!r} is not allowed here; give hinges, and a free base")
        name = joint.get("name") or unlike(f"joint {len(self.hinges)}", self.joints)
        anchor = place.position + place.rotation @ numbers(joint, "pos", "0 0 0", 3)
        axis = place.rotation @ direction(joint, "axis", "0 0 1")
        reference = self.compiler.angle(number(joint, "ref", "0"))
        self.hinges[name] = child, reference
        span = self._span(joint)
        rest = self.angles.get(name)
        if rest is None:
            rest, moved_in = rest_within(span, reference)
            self.ignored |= {OUTSIDE: None} if moved_in else {}
        turn = Rotation.from_rotvec(axis * (rest - reference)).as_matrix()
        moved = Frame(anchor + turn @ (place.position - anchor), turn @ place.rotation)
        passive = self._passive(joint, rest, name in self.drives)
        motor, command = self._motor(joint, name, span, rest, passive)
        stops = None if span is None or self.flags.get("limit") else (span[0] - rest, span[1] - rest)
        return moved, Hinge(parent, child, anchor, axis, motor, command, stops, rest, passive)

    def _span(self, joint: Element) -> tuple[float, float] | None:
        """Lowest and highest angle of a joint [rad]; None if it has no stops."""
        span = self.compiler.limits(joint, "range", "limited")
        return None if span is None else (self.compiler.angle(span[0]), self.compiler.angle(span[1]))

    def _motor(
        self, joint: Element, name: str, span: tuple[float, float] | None, rest: float, passive: Passive
    ) -> tuple[Motor | Servo | None, int]:
        """Convert a hinge's actuator to a drive and its number; None and 0 without. Notes what is ignored of both."""
        clamped = self.compiler.limits(joint, "actuatorfrcrange", "actuatorfrclimited") is not None
        motor: Motor | Servo | None = None
        command, also = 0, list[str]()
        if name in self.drives:
            command, actuator = self.drives[name]
            ideal = Ideal(self.speed, self.fastest, 1 / self.time_step)
            motor, also = drive(actuator, span, rest, passive, ideal, self.compiler)
            if clamped:
                largest = symmetric(joint, "actuatorfrcrange")
                motor = replace(motor, torque=largest if motor.torque is None else min(motor.torque, largest))
        self.ignored |= dict.fromkeys(also)
        self.ignored |= notes(joint)
        return motor, command

    def commands(self) -> tuple[str, ...]:
        """Names of the drives, in their order: one without has its joint's, or one like it where a drive has that."""
        taken = {name for _, actuator in self.drives.values() if (name := actuator.get("name"))}
        found = list[str]()
        for joint, (_, actuator) in self.drives.items():
            found.append(actuator.get("name") or unlike(joint, taken))
            taken.add(found[-1])
        return tuple(found)

    def touching(self, bodies: set[str]) -> list[str]:
        """Names of the bodies that touch sensors feel, in their order; each is one of these."""
        found = list[str]()
        for sensor in self.root.iterfind("sensor/touch"):
            body = self.sites.get(checked(sensor).get("site", ""))
            if body not in bodies or body in found:
                raise ValueError(
                    f"{named(sensor)}: not allowed; give the site of a body with a mass, one sensor a body"
                )
            found.append(body)
        return found

    @property
    def time_step(self) -> float:
        """Time step of the file [s]."""
        return positive("timestep of option", number(self.option, "timestep", str(USUAL.time_step)))

    def world(self) -> Physics:
        """Settings of physics in the file: time step, gravity and friction."""
        gravity, frictions = numbers(self.option, "gravity", "0 0 -9.81"), self.contacts.frictions
        if len(gravity) != 3 or gravity[:2].any():
            raise ValueError(f"option: gravity {self.option.get('gravity')!r} is not allowed; give one along z")
        if self.flags.get("gravity"):
            gravity = np.zeros(3)
        if len(frictions) > 1:
            self.ignored[f"frictions below {max(frictions):g}, the largest"] = None
        return Physics(self.time_step, float(gravity[2]), friction=max(frictions, default=USUAL.friction))

    def all_ignored(self) -> tuple[str, ...]:
        """Entries of the file that the engine does not support, one for each kind."""
        tags = sorted({child.tag for child in self.root} & set(IGNORED))
        found = [f"<{tag}>{' (angles can be given)' if tag == 'keyframe' else ''}" for tag in tags]
        found += [f"option {name}" for name in self.option.attrib if name not in _OPTIONS]
        found += [f"flag {name}" for name in self.flags if name not in _FLAGS]
        found += sorted({f"<{each.tag}> sensors" for each in self.root.iterfind("sensor/*") if each.tag != "touch"})
        if self.root.find("contact/pair") is not None:
            found.append("<contact> pairs")
        if self.contacts.floor is None and not self.contacts.off:
            found.append("that there is no ground, which the engine has at z = 0")
        return (*found, *self.ignored, *(each for each in self.contacts.ignored if each not in self.ignored))


def is_free(joint: Element) -> bool:
    """Whether a joint leaves its body free."""
    return joint.tag == "freejoint" or joint.get("type") == "free"


def unlike(name: str, taken: set[str]) -> str:
    """A name for what has none, which nothing in the file has."""
    while name in taken:
        name += "'"
    return name
