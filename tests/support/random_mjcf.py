"""Random robots as MJCF, with all that the reader takes: by a seed, the same text each time."""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

PURE = ("xyz", "zyx", "XYZ", "ZYX", "zxz")
MIXED = ("xYz", "XyZ", "zzY", "XXz")


def numbers(values):
    return " ".join(f"{float(value):.12g}" for value in np.atleast_1d(values))


def attribute(name, value):
    return f' {name}="{value}"'


class Draw:
    """A text that is being drawn; of an ``exact`` one MuJoCo need not find principal axes."""

    def __init__(self, seed, exact=False):
        self.exact = exact
        self.rng = np.random.default_rng([20261127, seed])
        self.degrees = self.chance(0.5)
        self.autolimits = self.chance(0.7)
        self.inertia = "false" if exact else self.pick("auto", "auto", "true", "false")
        self.classes = ["main"]
        self.count, self.joints, self.sites, self.bodies = 0, [], [], []

    def chance(self, share):
        return self.rng.random() < share

    def pick(self, *values):
        return values[self.rng.integers(len(values))]

    def angle(self, value):
        return f"{np.degrees(value) if self.degrees else value:.12g}"

    def maybe(self, share, text):
        return f" {text}" if self.chance(share) else ""

    def vector(self, size=0.3):
        return numbers(self.rng.uniform(-size, size, 3))

    def turn(self, share=0.7):
        """Any way to turn something, or none."""
        if not self.chance(share):
            return ""
        turned = Rotation.from_quat(self.rng.normal(size=4))
        kind = self.pick("quat", "axisangle", "euler", "xyaxes", "zaxis")
        axis = self.rng.normal(size=3)
        text = {
            "quat": numbers(self.rng.uniform(0.1, 3) * turned.as_quat()),
            "axisangle": f"{numbers(axis)} {self.angle(self.rng.uniform(-4, 4))}",
            "euler": " ".join(self.angle(each) for each in self.rng.uniform(-3, 3, 3)),
            "xyaxes": f"{numbers(axis)} {numbers(self.rng.normal(size=3))}",
            "zaxis": numbers(self.pick(axis, [0, 0, -2], [0, 0, 1])),
        }[kind]
        return f' {kind}="{text}"'

    def limited(self, attribute, values, rule, never=True):
        """A range and whether it holds, as far as it must be told."""
        told = self.pick("true", "false") if never else "true"
        if self.autolimits:
            told = self.pick("", "", "auto", told)
        return f' {attribute}="{values}"' + (f' {rule}="{told}"' if told else "")

    def hinge(self, driven):
        name = f"hinge {len(self.joints)}"
        text = f'<joint name="{name}" axis="{self.vector()}"' + self.maybe(0.5, f'pos="{self.vector()}"')
        low = self.rng.uniform(-2, 1)
        ends, limited = (low, low + self.rng.uniform(0.1, 2)), self.chance(0.6)
        if limited:
            text += self.limited("range", " ".join(map(self.angle, ends)), "limited")
        text += self.maybe(0.3, f'ref="{self.angle(self.rng.uniform(*ends) if limited else 0.4)}"')
        for name_of, size in (("damping", 1), ("armature", 0.1), ("frictionloss", 0.1), ("margin", 0.01)):
            text += self.maybe(0.25, f'{name_of}="{self.rng.uniform(0, size):.6g}"')
        text += self.maybe(0.2, f'stiffness="{self.rng.uniform(0, 5):.6g}"')
        text += self.maybe(0.2, f'springref="{self.angle(self.rng.uniform(-1, 1))}"')
        if driven and self.chance(0.2):
            text += self.limited("actuatorfrcrange", "-1.5 1.5", "actuatorfrclimited")
        self.joints.append((name, driven, 'limited="false"' not in text and limited))
        return text + self.of_class() + "/>"

    def of_class(self, share=0.3):
        return self.maybe(share, f'class="{self.pick(*self.classes)}"')

    def matter_of(self):
        return self.pick("", f' mass="{self.rng.uniform(0.1, 2):.6g}"', f' density="{self.rng.uniform(100, 2000):.6g}"')

    def contact(self, touching=True):
        text = self.maybe(0.3, f'friction="{numbers(self.rng.uniform(0, 2, self.rng.integers(1, 4)))}"')
        text += self.maybe(0.3, f'condim="{self.pick(1, 3, 4, 6)}"') + self.maybe(
            0.2, f'priority="{self.pick(0, 1, 2)}"'
        )
        bits = (f'contype="{self.pick(0, 1, 2, 3)}"', f'conaffinity="{self.pick(0, 1, 2)}"')
        if not touching:
            return f'{text} contype="0" conaffinity="0"'
        return text + self.maybe(0.3, bits[0]) + self.maybe(0.3, bits[1]) + self.maybe(0.2, 'margin="0.002"')

    def geom(self, name):
        kind = self.pick("", "sphere", "capsule", "cylinder", "box", "capsule")
        size = self.rng.uniform(0.05, 0.1), self.rng.uniform(0.12, 0.3), self.rng.uniform(0.05, 0.3)
        shown = self.maybe(1.0, f'type="{kind}"') if kind else ""
        between = kind in ("capsule", "cylinder", "box") and self.chance(0.3)
        length = {"": 3, "sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}[kind]
        shown += f' size="{numbers(size[: self.pick(length, 3)])}"'
        if between:
            start = self.rng.uniform(-0.2, 0.2, 3)
            shown += (
                f' fromto="{numbers(start)} {numbers(start + self.pick([0, 0, 0.4], self.rng.uniform(0.2, 0.5, 3)))}"'
            )
        else:
            shown += self.maybe(0.6, f'pos="{self.vector()}"')
        shown += self.turn(0.4) + self.matter_of() + self.maybe(0.3, f'group="{self.pick(0, 1, 3, 5)}"')
        classes = ["main"] if between else self.classes
        shown += self.maybe(0.3, f'class="{self.pick(*classes)}"')
        return f'<geom name="{name}"{shown}{self.contact(kind not in ("box", ""))}/>'

    def inertial(self):
        mass, edges = self.rng.uniform(0.2, 3), self.rng.uniform(0.05, 0.5, 3) ** 2
        moments = mass / 12 * (edges.sum() - edges)
        head = f'<inertial pos="{self.vector()}" mass="{mass:.9g}"'
        if self.exact or self.chance(0.5):
            return f'{head} diaginertia="{numbers(moments)}"{self.turn()}/>'
        turned = Rotation.from_quat(self.rng.normal(size=4)).as_matrix()
        full = turned @ np.diag(moments) @ turned.T
        return f'{head} fullinertia="{numbers(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>'

    def body(self, depth, free=False, hinged=None):
        name = f"body-{self.count}"
        self.count += 1
        self.bodies.append(name)
        hinged = self.chance(0.75) if hinged is None else hinged
        text = f'<body name="{name}" pos="{self.vector()}"{self.turn()}'
        text += self.maybe(0.2, f'childclass="{self.pick(*self.classes)}"') + self.maybe(0.1, 'gravcomp="0.5"') + ">"
        if free:
            text += self.pick("<freejoint/>", '<freejoint align="true"/>', '<joint type="free" damping="0.1"/>')
        elif hinged:
            text += self.hinge(self.chance(0.7))
        own = self.chance(0.4) or (self.inertia == "false" and (hinged or free))
        text += self.inertial() if own else ""
        least = 1 if (hinged or free) and not own else 0
        text += "".join(self.geom(f"{name}-{number}") for number in range(self.rng.integers(least, 4)))
        if self.chance(0.3):
            text += f'<site name="site {name}" pos="{self.vector()}"{self.turn()}/>'
            self.sites.append((f"site {name}", hinged or free))
        for _ in range(self.rng.integers(0, 3) if depth < 4 and self.count < 9 else 0):
            text += self.body(depth + 1)
        return text + "</body>"

    def actuator(self, kind, joint="", limited=False, default=False):
        gear = self.rng.uniform(0.5, 3) * self.pick(1, 1, -1)
        more = self.pick("", " 0 0 0 0 0")
        text = f"<{kind}{joint}" + self.maybe(0.4, f'gear="{gear:.6g}{more}"')
        top = self.rng.uniform(0.2, 2)
        low = -top if kind == "motor" or default else self.rng.uniform(-2, -0.1)
        needs = not default and not (kind == "position" and limited and self.chance(0.4))
        if needs or (default and self.chance(0.4)):
            text += self.limited("ctrlrange", numbers([low, top]), "ctrllimited")
        elif not default and self.chance(0.4):
            text += attribute("inheritrange", self.rng.uniform(0.3, 1.2))
            text += "" if self.autolimits else ' ctrllimited="true"'
        if self.chance(0.3):
            text += self.limited("forcerange", numbers([-3 * top, 3 * top]), "forcelimited")
        if kind == "position":
            text += self.maybe(0.7, f'kp="{self.rng.uniform(1, 50):.6g}"')
            text += self.pick("", f' kv="{self.rng.uniform(0, 3):.6g}"', ' dampratio="0.7"') + self.maybe(
                0.1, 'timeconst="0.1"'
            )
        elif kind == "velocity":
            text += self.maybe(0.7, f'kv="{self.rng.uniform(1, 5):.6g}"')
        elif kind == "general":
            if default:
                text += self.maybe(0.5, 'gainprm="7 1"') + self.maybe(0.5, 'biastype="affine" biasprm="0.4 -7 -0.3"')
            else:
                bias = self.pick("0 -7 -0.3", "0.4 -3 0", "0 -7 0.6", "0 0 -0.5")
                text += f' gainprm="7 1" biastype="{self.pick("none", "affine")}" biasprm="{bias}"'
        return text + ("" if default else self.maybe(0.3, f'class="{self.pick(*self.classes)}"')) + "/>"

    def defaults(self, depth=0):
        """The elements of a class, and classes in it."""
        text = self.maybe(0.5, f'<joint axis="{self.vector()}"{self.maybe(0.5, attribute("damping", 0.2))}/>')
        if self.chance(0.6):
            size = numbers(self.rng.uniform(0.06, 0.2, self.rng.integers(1, 4)))
            text += f'<geom size="{size}"{self.turn(0.4)}{self.matter_of()}{self.contact()}'
            text += self.maybe(0.3, 'type="capsule"') + "/>"
        kinds = self.rng.permutation(["motor", "position", "velocity", "general"])[: self.rng.integers(0, 3)]
        text += "".join(self.actuator(str(kind), default=True) for kind in kinds)
        for _ in range(self.rng.integers(0, 3) if depth < 2 else 0):
            name = f"class-{len(self.classes)}"
            self.classes.append(name)
            text += f'<default class="{name}">{self.defaults(depth + 1)}</default>'
        return text

    def compiler(self):
        rules = f'angle="{"degree" if self.degrees else "radian"}" autolimits="{str(self.autolimits).lower()}"'
        second = f'inertiafromgeom="{self.inertia}"' + self.maybe(0.6, f'eulerseq="{self.pick(*PURE, *MIXED)}"')
        second += self.maybe(0.2, 'boundmass="0.7"') + self.maybe(0.2, 'boundinertia="0.01"')
        second += self.maybe(0.2, 'balanceinertia="true"') + self.maybe(0.2, 'inertiagrouprange="0 3"')
        second += self.maybe(0.2, 'coordinate="local"') + self.maybe(0.1, 'settotalmass="-1"')
        return f"<compiler {rules}/><compiler {second}/>"

    def text(self):
        """The whole file."""
        defaults = f"<default>{self.defaults()}</default>" if self.chance(0.7) else ""
        option = f'<option timestep="{self.rng.uniform(1e-4, 1e-2):.6g}"'
        option += self.maybe(0.5, 'gravity="0 0 -3.7"') + ">"
        flags = "".join(self.maybe(0.1, f'{name}="disable"') for name in ("gravity", "contact", "limit"))
        option += (f"<flag{flags}/>" if flags else "") + "</option>"
        floor = f'<geom name="floor" type="plane" size="1 1 1" pos="1 2 0" mass="0" zaxis="0 0 1"{self.contact()}/>'
        picture = (
            '<geom name="picture" type="sphere" size="1" contype="0" conaffinity="0"/>' if self.chance(0.3) else ""
        )
        base = self.pick("free", "free", "fixed", "hinged")
        body = self.body(0, base == "free", base == "hinged")
        tail = "".join(
            self.actuator(self.pick("position", "velocity", "motor", "general"), f' joint="{name}"', limited)
            for name, driven, limited in self.joints
            if driven
        )
        sensors = "".join(f'<touch site="{name}"/>' for name, heavy in self.sites if heavy)
        exclude = (
            f'<contact><exclude body1="world" body2="{self.pick(*self.bodies)}"/></contact>' if self.chance(0.3) else ""
        )
        return (
            f"<mujoco>{self.compiler()}{option}{defaults}<worldbody>{floor}{picture}{body}</worldbody>"
            f"{exclude}<actuator>{tail}</actuator><sensor>{sensors}</sensor></mujoco>"
        )


def random_mjcf(seed, exact=False):
    """The text of a random robot; all numbers of an ``exact`` one MuJoCo has to the last digits."""
    return Draw(seed, exact).text()


VALUES = ("", "foo", "-1", "0", "1 2", "1 2 3 4 5 6 7", "nan", "1.5", "true", "auto", "0 0 0", "1 -1", "body-0", "free")


def harmed(text, seed):
    """A text with one thing wrong, more or less: an attribute or an element is changed, renamed, lost or given twice.

    Returns:
        The text, and which element and attribute was harmed.
    """
    rng = np.random.default_rng([20261128, seed])
    root = ElementTree.fromstring(text)
    parents = {child: parent for parent in root.iter() for child in parent}
    elements = list(parents)
    element = elements[rng.integers(len(elements))]
    if rng.random() < 0.2 or not element.attrib:
        parent = parents[element]
        if rng.random() < 0.5:
            parent.append(element)
        else:
            parent.remove(element)
            parents_now = [each for each in root.iter() if each is not element]
            parents_now[rng.integers(len(parents_now))].append(element)
        return ElementTree.tostring(root, "unicode"), (element.tag, "")
    name = list(element.attrib)[rng.integers(len(element.attrib))]
    kind = rng.integers(5)
    value = element.attrib[name]
    if kind == 0:
        del element.attrib[name]
    elif kind == 1:
        element.attrib[name[:-1] + rng.choice(["x", "s", ""])] = element.attrib.pop(name)
    elif kind == 2:
        other = elements[rng.integers(len(elements))]
        other.attrib[name] = value
        return ElementTree.tostring(root, "unicode"), (other.tag, name)
    elif kind == 3:
        words = value.split()
        words[rng.integers(len(words))] = VALUES[rng.integers(len(VALUES))]
        element.attrib[name] = " ".join(words)
    else:
        element.attrib[name] = VALUES[rng.integers(len(VALUES))]
    return ElementTree.tostring(root, "unicode"), (element.tag, name)
