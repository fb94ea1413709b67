"""Read MJCF, MuJoCo's format: bodies, hinges, solids, drives and touch sensors become a tree of hinges.

Source: MuJoCo documentation, "XML reference" (meaning and defaults of attributes) and "Modeling" (frames, default
classes). Angles are degrees unless the compiler says otherwise.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import positive
from taichi_sim.rigid.model.assembly import (
    OUTSIDE,
    USUAL,
    Cylinder,
    Lump,
    Model,
    Part,
    Place,
    depth_of,
    placed,
    possible_inertia,
    rest_within,
    solid_of,
    tree_of,
)
from taichi_sim.rigid.model.mjcf_drives import drive
from taichi_sim.rigid.model.settings import World
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.model.tree import Hinge, Joint, Weld
from taichi_sim.rigid.model.xml_values import direction, keyword, named, not_negative, number, numbers, single
from taichi_sim.rigid.tables import Senses

_SIZES = {"sphere": 1, "capsule": 2, "box": 3, "cylinder": 2}  # numbers in size; halves of lengths and edges
_READ = ("compiler", "option", "default", "worldbody", "actuator", "sensor", "contact")
_WRONG = ("equality", "tendon", "deformable", "extension", "include")  # the robot moves otherwise with them
_IN_BODIES = ("body", "joint", "freejoint", "geom", "inertial", "site", "camera", "light")
_IGNORED_OF_JOINTS = ("stiffness", "damping", "armature", "frictionloss")
_OPTIONS = ("timestep", "gravity")
_SHALLOW = 1e-4  # m, a depth in the ground that is rounding


def read_mjcf(root: Element, angles: dict[str, float], speed: float, fastest: float, time_step: float | None) -> Model:
    """Read the robot of an MJCF file.

    Raises:
        ValueError: for entries that are not allowed.
    """
    for tag in _WRONG:
        if root.find(tag) is not None:
            raise ValueError(f"model: <{tag}> is not allowed; give trees of hinges without it")
    reader = _Reader(root, angles, speed, fastest)
    if time_step is not None:
        reader.option.set("timestep", str(float(time_step)))
    fixed = reader.read()
    unknown = sorted(set(angles) - set(reader.hinges))
    if unknown:
        raise ValueError(f"angles: there is no hinge {unknown[0]!r}; there are {', '.join(reader.hinges)}")
    lost = [joint for joint in reader.drives if joint not in reader.hinges]
    if lost:
        raise ValueError(f"{named(reader.drives[lost[0]][1])}: there is no hinge {lost[0]!r}")
    tree = tree_of(reader.parts, fixed)
    names = {body.name for body in tree.bodies}
    touching = []
    for sensor in root.iterfind("sensor/touch"):
        body = reader.sites.get(sensor.get("site", ""))
        if body not in names or body in touching:
            raise ValueError(f"{named(sensor)}: not allowed; give the site of a body with a mass, one sensor a body")
        touching.append(body)
    commands = tuple(actuator.get("name", joint) for joint, (_, actuator) in reader.drives.items())
    world, ignored = reader.world(), reader.all_ignored()
    if not fixed and (depth := depth_of(tree)) > _SHALLOW:
        ignored += (f"that it starts {1e3 * depth:.3g} mm deep in the ground, which throws it out",)
    return Model(tree, Senses(touching), world, commands, ignored)


@dataclass(eq=False)
class _Reader:
    """Reader of an MJCF file, which collects parts, drives, sensors and ignored entries."""

    root: Element
    angles: dict[str, float]
    speed: float
    fastest: float
    parts: list[Part] = field(default_factory=list)
    hinges: list[str] = field(default_factory=list)
    sites: dict[str, str] = field(default_factory=dict)
    ignored: dict[str, None] = field(default_factory=dict)  # in the order found
    frictions: set[float] = field(default_factory=set)
    floor: Element | None = None

    def __post_init__(self) -> None:
        self.compiler, self.option = (_merged(self.root, tag) for tag in ("compiler", "option"))
        if self.compiler.get("coordinate") == "global" or "settotalmass" in self.compiler.attrib:
            raise ValueError("compiler: global coordinates and settotalmass are not allowed; give a file without them")
        self.degrees = keyword(self.compiler, "angle", "degree", "radian") == "degree"
        self.balanced = keyword(self.compiler, "balanceinertia", "false", "true") == "true"
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for default in self.root.iterfind("default"):
            self._read_defaults(default, default.get("class", "main"), self.defaults["main"])
        self.drives: dict[str, tuple[int, Element]] = {}
        for command, actuator in enumerate(each for group in self.root.iterfind("actuator") for each in group):
            given = self.resolved(actuator, "main")
            joint = given.get("joint", "")
            if not joint or joint in self.drives:
                raise ValueError(f"{named(given)}: not allowed; give each drive the joint that it alone moves")
            self.drives[joint] = command, given

    def _read_defaults(self, element: Element, name: str, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in inherited.items()}
        for child in element:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attrib}
        self.defaults[name] = own
        for child in element.iterfind("default"):
            self._read_defaults(child, child.get("class", ""), own)

    def resolved(self, element: Element, childclass: str) -> Element:
        """Copy of an element that has the defaults of its class."""
        name = element.get("class", childclass)
        if name not in self.defaults:
            raise ValueError(f"{named(element)}: there is no class {name!r}; there are {', '.join(self.defaults)}")
        return Element(element.tag, {**self.defaults[name].get(element.tag, {}), **element.attrib})

    def angle(self, value: float) -> float:
        """Convert an angle of the file to radians."""
        return float(np.radians(value)) if self.degrees else value

    def turn(self, element: Element) -> Floats:
        """Rotation matrix of an element, from whichever attribute gives it."""
        if "quat" in element.attrib:
            found = Rotation.from_quat(numbers(element, "quat", None, 4), scalar_first=True)
        elif "axisangle" in element.attrib:
            x, y, z, angle = numbers(element, "axisangle", None, 4)
            found = Rotation.from_rotvec(np.array([x, y, z]) / np.linalg.norm([x, y, z]) * self.angle(angle))
        elif "euler" in element.attrib:  # lower case is about moving axes here, upper case in scipy
            given = [self.angle(each) for each in numbers(element, "euler", None, 3)]
            found = Rotation.from_euler(self.compiler.get("eulerseq", "xyz").swapcase(), given)
        elif "xyaxes" in element.attrib:
            axes = numbers(element, "xyaxes", None, 6).reshape(2, 3)
            x = axes[0] / np.linalg.norm(axes[0])
            y = axes[1] - (axes[1] @ x) * x
            y = y / np.linalg.norm(y)
            return np.column_stack([x, y, np.cross(x, y)])
        elif "zaxis" in element.attrib:
            return _to(direction(element, "zaxis", "0 0 1"))
        else:
            return np.eye(3)
        return np.asarray(found.as_matrix())

    def read(self) -> bool:
        """Read all bodies; return whether the base is fixed to the world."""
        bases = []
        for worldbody in self.root.iterfind("worldbody"):
            for child in _known(worldbody):
                if child.tag == "geom":
                    self._read_ground(self.resolved(child, "main"))
                elif child.tag == "body":
                    bases.append(child)
        if len(bases) != 1:
            raise ValueError(f"worldbody: {len(bases)} bodies are not allowed; give one robot")
        world = Place(np.zeros(3), np.eye(3))
        loose = [joint.tag == "freejoint" or joint.get("type") == "free" for joint in _joints_of(bases[0])]
        hanging = bool(loose) and not loose[0]
        if hanging:
            self.parts.append(Part("world", None, Lump()))
        self._read_body(bases[0], "world" if hanging else None, world, "main")
        return not any(loose)

    def _read_ground(self, geom: Element) -> None:
        if geom.get("type") != "plane":
            if _touches(geom, self.floor):
                raise ValueError(f"{named(geom)}: the world has a plane only; give no other solid that touches robots")
            return
        level = abs(self.turn(geom)[2, 2] - 1) < 1e-9 and abs(numbers(geom, "pos", "0 0 0", 3)[2]) < 1e-9
        if not level or self.floor is not None:
            raise ValueError(f"{named(geom)}: not allowed; give one plane, z = 0")
        self.floor = geom

    def _read_body(self, body: Element, parent: str | None, carrier: Place, childclass: str) -> None:
        childclass = body.get("childclass", childclass)
        name = body.get("name", f"body {len(self.parts)}")
        place = carrier.then(numbers(body, "pos", "0 0 0", 3), self.turn(body))
        joints = _joints_of(body)
        if len(joints) > 1:
            raise ValueError(f"body {name}: {len(joints)} joints are not allowed; give one, and a body for each")
        carried: Joint | None = None if parent is None else Weld(parent, name)
        if joints and joints[0].tag == "joint":
            joint = self.resolved(joints[0], childclass)
            if joint.get("type") != "free" or parent not in (None, "world"):
                place, carried = self._read_hinge(joint, place, parent or "", name)
        elif joints and parent is not None:
            raise ValueError(f"body {name}: a free joint is not allowed on it; give it to the base")
        lump, shapes = self._read_matter(body, place, childclass)
        for site in body.iterfind("site"):
            self.sites[site.get("name", "")] = name
        self.parts.append(Part(name, carried, lump, tuple(shapes)))
        for child in _known(body):
            if child.tag == "body":
                self._read_body(child, name, place, childclass)
            elif child.tag in ("camera", "light"):
                self.ignored[f"<{child.tag}>"] = None

    def _read_hinge(self, joint: Element, place: Place, parent: str, child: str) -> tuple[Place, Hinge]:
        """Read a joint: the place of the body when its hinge is at rest, and the hinge."""
        if (kind := joint.get("type", "hinge")) != "hinge":
            raise ValueError(f"{named(joint)}: type {kind!r} is not allowed here; give hinges, and a free base")
        name = joint.get("name", f"joint {len(self.hinges)}")
        self.hinges.append(name)
        anchor = place.position + place.rotation @ numbers(joint, "pos", "0 0 0", 3)
        axis = place.rotation @ direction(joint, "axis", "0 0 1")
        reference = self.angle(number(joint, "ref", "0"))
        span = self._range(joint)
        rest = self.angles.get(name)
        if rest is None:
            rest, moved_in = rest_within(span, reference)
            self.ignored |= {OUTSIDE: None} if moved_in else {}
        turn = Rotation.from_rotvec(axis * (rest - reference)).as_matrix()
        moved = Place(anchor + turn @ (place.position - anchor), turn @ place.rotation)
        lacking = [each for each in _IGNORED_OF_JOINTS if number(joint, each, "0")]
        motor, command = None, 0
        if name in self.drives:
            command, actuator = self.drives[name]
            damping, quickest = not_negative(joint, "damping", number(joint, "damping", "0")), 1 / self.time_step
            motor, also = drive(actuator, span, rest, damping, self.speed, self.fastest, quickest)
            used = "damping" if actuator.tag == "position" else ""
            lacking = [each for each in lacking if each != used] + also
        elif "stiffness" in lacking:
            raise ValueError(
                f"{named(joint)}: stiffness {joint.get('stiffness')!r} is not allowed without an actuator; give 0, as "
                "there are no springs"
            )
        self.ignored.update(dict.fromkeys(each if " " in each else f"{each} of joints" for each in lacking))
        stops = None if span is None else (span[0] - rest, span[1] - rest)
        return moved, Hinge(parent, child, anchor, axis, motor, command, stops)

    def _range(self, joint: Element) -> tuple[float, float] | None:
        """Lowest and highest angle of a joint [rad]; None if it has no stops."""
        automatic = keyword(self.compiler, "autolimits", "true", "false") == "true" and "range" in joint.attrib
        limited = keyword(joint, "limited", "auto", "true", "false")
        if limited != "true" and not (limited == "auto" and automatic):
            return None
        low, high = (self.angle(each) for each in numbers(joint, "range", None, 2))
        return low, high

    def _read_matter(self, body: Element, place: Place, childclass: str) -> tuple[Lump, list[Solid]]:
        """Read the mass and the solids of a body."""
        inertial, lump, shapes = single(body, "inertial"), Lump(), list[Solid]()
        rule = keyword(self.compiler, "inertiafromgeom", "auto", "true", "false")
        from_geoms = rule == "true" or (rule == "auto" and inertial is None)
        for geom in (self.resolved(each, childclass) for each in body.iterfind("geom")):
            touches, kind = _touches(geom, self.floor), geom.get("type", "sphere")
            if not touches and not from_geoms:
                continue  # a picture
            at, solid = self._read_geom(geom, kind, place)
            if from_geoms:
                density = not_negative(geom, "density", number(geom, "density", "1000"))
                mass = not_negative(geom, "mass", number(geom, "mass", str(density * solid.volume)))
                lump = lump + Lump.of(mass, at, solid.inertia(mass))
            if touches:
                shapes.append(placed(solid, named(geom), at))
                self.frictions.add(self._friction(geom))
                if kind == "cylinder":
                    self.ignored["edges of cylinders, which touch the ground as capsules of their length"] = None
        if inertial is not None and not from_geoms:
            at = place.then(numbers(inertial, "pos", "0 0 0", 3), self.turn(inertial))
            if "fullinertia" in inertial.attrib:
                xx, yy, zz, xy, xz, yz = numbers(inertial, "fullinertia", None, 6)
                matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            else:
                matrix = np.diag(numbers(inertial, "diaginertia", None, 3))
            matrix = possible_inertia(f"inertial of {named(body)}", matrix, self.balanced)
            lump = Lump.of(number(inertial, "mass"), at, matrix)
        return lump, shapes

    def _read_geom(self, geom: Element, kind: str, place: Place) -> tuple[Place, Solid | Cylinder]:
        """Read a solid and its place."""
        if kind not in _SIZES:
            raise ValueError(f"{named(geom)}: type {kind!r} is not allowed; give {', '.join(_SIZES)}")
        size = numbers(geom, "size")
        if "fromto" in geom.attrib and kind != "sphere":
            ends = numbers(geom, "fromto", None, 6).reshape(2, 3)
            along = ends[0] - ends[1]  # the third axis, as MuJoCo has it
            length = float(np.linalg.norm(along))
            at = place.then(ends.mean(0), _to(along / length))
            size = np.append(size[:1] if kind != "box" else np.resize(size, 2), length / 2)
        else:
            at = place.then(numbers(geom, "pos", "0 0 0", 3), self.turn(geom))
        if len(size) < _SIZES[kind]:
            raise ValueError(f"{named(geom)}: {len(size)} sizes are not allowed; give {_SIZES[kind]}")
        size[0 if kind == "box" else 1 :] *= 2  # from halves of edges and lengths
        return at, solid_of(kind, named(geom), size[: _SIZES[kind]].tolist())

    def _friction(self, geom: Element) -> float:
        """Coefficient of friction of a solid on the ground: the larger of the two coefficients."""
        pair = [each for each in (geom, self.floor) if each is not None]
        own = [not_negative(each, "friction", float(numbers(each, "friction", "1")[0])) for each in pair]
        return max(0.0 if each.get("condim") == "1" else mu for each, mu in zip(pair, own, strict=True))

    @property
    def time_step(self) -> float:
        """Time step of the file [s]."""
        return positive("timestep of option", float(numbers(self.option, "timestep", str(USUAL.time_step))[0]))

    def world(self) -> World:
        """World settings of the file: time step, gravity and friction."""
        gravity = numbers(self.option, "gravity", "0 0 -9.81")
        if len(gravity) != 3 or gravity[:2].any():
            raise ValueError(f"option: gravity {self.option.get('gravity')!r} is not allowed; give one along z")
        if len(self.frictions) > 1:
            self.ignored[f"frictions below {max(self.frictions):g}, the largest"] = None
        return World(self.time_step, float(gravity[2]), friction=max(self.frictions, default=USUAL.friction))

    def all_ignored(self) -> tuple[str, ...]:
        """Entries of the file that the engine does not support, one for each kind."""
        found = [f"<{tag}>" for tag in sorted({child.tag for child in self.root} - set(_READ))]
        found += [f"option {name}" for name in self.option.attrib if name not in _OPTIONS]
        found += sorted({f"<{each.tag}> sensors" for each in self.root.iterfind("sensor/*") if each.tag != "touch"})
        if self.root.find("contact/pair") is not None:
            found.append("<contact> pairs")
        if self.floor is None:
            found.append("that there is no ground, which the engine has at z = 0")
        return (*found, *self.ignored)


def _merged(root: Element, tag: str) -> Element:
    """One element with the attributes of all elements of a tag; where several have one, that of the last."""
    return Element(tag, {name: value for each in root.iterfind(tag) for name, value in each.items()})


def _joints_of(body: Element) -> list[Element]:
    return [child for child in body if child.tag in ("joint", "freejoint")]


def _known(body: Element) -> Iterable[Element]:
    for child in body:
        if child.tag not in _IN_BODIES:
            raise ValueError(f"{named(body)}: <{child.tag}> is not allowed; give {', '.join(_IN_BODIES)}")
        yield child


def _touches(geom: Element, floor: Element | None) -> bool:
    """Whether a solid collides with the floor: their contact types and affinities have a bit in common."""
    other = Element("geom") if floor is None else floor
    mine, theirs = ([int(number(each, name, "1")) for name in ("contype", "conaffinity")] for each in (geom, other))
    return bool(mine[0] & theirs[1] or theirs[0] & mine[1])


def _to(axis: Floats) -> Floats:
    """Matrix of the smallest rotation that takes the third axis to a direction."""
    cross = np.array([-axis[1], axis[0], 0.0])
    sine = np.linalg.norm(cross)
    if sine < 1e-12:
        return np.diag([1.0, 1.0, 1.0]) if axis[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(Rotation.from_rotvec(cross / sine * np.arctan2(sine, axis[2])).as_matrix())
