"""Resolve MJCF's default classes: what an element has of its class, as MuJoCo's reader combines it.

Source: MuJoCo documentation, "Modeling" (default settings), and its behaviour where that is silent (tests compare): a
shorter list of sizes replaces the first of them, a turn of any kind goes before an inherited ``quat``, and the
defaults of all kinds of actuators are the same settings.
"""

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from taichi_sim.rigid.model.mjcf_schema import ATTRIBUTES, DRIVES, OTHER_DRIVES, OTHER_TURNS, TRANSMISSIONS, checked
from taichi_sim.rigid.model.xml_values import named, number, numbers

_OWN = ("name", "class", "joint")
_ALONE = (*_OWN, *(name for name in TRANSMISSIONS if name != "cranklength"), "lengthrange")  # what classes cannot have
_CHECKED = ("geom", "joint", "site", *DRIVES)  # of others the attributes are not read
_AFFINE = {"gaintype": "fixed", "biastype": "affine"}
_Class = dict[str, dict[str, str]]  # attributes, by tag; those of actuators are under "actuator"


@dataclass(eq=False)
class Defaults:
    """The default classes of a file.

    Attributes:
        root: element of the file.
    """

    root: Element
    classes: dict[str, _Class] = field(default_factory=lambda: {"main": {}})

    def __post_init__(self) -> None:
        for default in self.root.iterfind("default"):
            if default.get("class", "main") != "main":
                raise ValueError(f"default: class {default.get('class')!r} is not allowed outside another; give main")
            self._read(default, "main", self.classes["main"])

    def _read(self, element: Element, name: str, inherited: _Class) -> None:
        own, seen = {tag: dict(values) for tag, values in inherited.items()}, set[str]()
        for child in checked(element):
            if child.tag == "default":
                continue
            if child.tag in seen:
                raise ValueError(f"default {name}: two elements {child.tag} are not allowed; give one")
            seen.add(child.tag)
            given = checked(child) if child.tag in _CHECKED else child
            if alone := [each for each in given.attrib if each in _ALONE]:
                raise ValueError(f"default {name}: {alone[0]} of {child.tag} is not allowed; leave it out")
            if child.tag in DRIVES + OTHER_DRIVES:
                own["actuator"] = _of_actuator(given, own.get("actuator", {}))
            else:
                own[child.tag] = _over(given, own.get(child.tag, {}))
        self.classes[name] = own
        for child in element.iterfind("default"):
            inner = child.get("class", "")
            if not inner or inner in self.classes:
                raise ValueError(f"default: class {inner!r} is not allowed; give each class a name of its own")
            self._read(child, inner, own)

    def named(self, name: str, element: Element) -> str:
        """Return the name of a class that an element gives.

        Raises:
            ValueError: if there is no such class.
        """
        if name not in self.classes:
            raise ValueError(f"{named(element)}: there is no class {name!r}; there are {', '.join(self.classes)}")
        return name

    def resolved(self, element: Element, childclass: str) -> Element:
        """Copy of an element that has the defaults of its class.

        Raises:
            ValueError: for a class that does not exist, or attributes that MJCF does not know.
        """
        inherited = self.classes[self.named(element.get("class", childclass), element)]
        return Element(element.tag, _over(checked(element), inherited.get(element.tag, {})))

    def drive(self, element: Element) -> Element:
        """Copy of an actuator that has the defaults of its class; ``kp`` and ``kv`` are those that it acts with.

        Raises:
            ValueError: for other kinds, or defaults of other kinds.
        """
        inherited = self.classes[self.named(element.get("class", "main"), element)].get("actuator", {})
        if element.tag not in DRIVES:
            return element
        settings = _of_actuator(checked(element), inherited)
        if "of" in settings:
            raise ValueError(
                f"{named(element)}: defaults of <{settings['of']}> are not allowed for it; give it a class without them"
            )
        if element.tag not in ("position", "general"):
            for name in ("dampratio", "dyntype", "inheritrange", "timeconst"):
                settings.pop(name, None)
        return Element(element.tag, {**{each: element.get(each, "") for each in _OWN}, **settings})


def _over(element: Element, inherited: dict[str, str]) -> dict[str, str]:
    """Attributes of an element over those that it inherits."""
    found = dict(inherited)
    if any(name in element.attrib for name in OTHER_TURNS):
        found = {name: text for name, text in found.items() if name not in OTHER_TURNS}
    found |= element.attrib
    if "size" in element.attrib and "size" in inherited:
        own = element.attrib["size"].split()
        found["size"] = " ".join(own + inherited["size"].split()[len(own) :])
    return found


def _of_actuator(element: Element, inherited: dict[str, str]) -> dict[str, str]:
    """Settings of an actuator over inherited ones, as one kind leaves them to another.

    A position's ``kp`` and a velocity's ``kv`` are the same number, its gain; a position's ``kv`` is its drag. The
    first numbers of a bias are ``constant`` and ``by_length``.
    """
    found = dict(inherited)
    given = {name: text for name, text in element.items() if name not in _OWN and name in ATTRIBUTES["position"]}
    gain, drag, ratio = (given.pop(name, None) for name in ("kp", "kv", "dampratio"))
    found |= given
    if element.tag in OTHER_DRIVES:
        found["of"] = element.tag
    elif element.tag == "motor":
        found |= {"kp": "1", "biastype": "none", "gaintype": "fixed"}
        found.pop("of", None)
    elif element.tag == "position":
        if drag is not None and ratio is not None:
            raise ValueError(f"{named(element)}: kv and dampratio are not allowed together; give one")
        found["kp"] = found.get("kp", "1") if gain is None else gain
        if drag is not None:
            found["kv"] = drag
            found.pop("dampratio", None)
        if ratio is not None:
            found["dampratio"] = ratio
            found.pop("kv", None)
        if "timeconst" in given:
            found.pop("dyntype", None)
        found |= {"by_length": repr(-number(Element(element.tag, found), "kp")), **_AFFINE}  # a constant bias stays
    elif element.tag == "velocity":
        found["kp"] = found["kv"] = found.get("kp", "1") if drag is None else drag
        found.pop("dampratio", None)
        found |= {"constant": "0", "by_length": "0", **_AFFINE}
    else:
        _general(element, found)
    return found


def _general(element: Element, found: dict[str, str]) -> None:
    """Write what a general actuator leaves to others into settings: its gain and its drag, a negative bias."""
    if "gainprm" in element.attrib:
        found["kp"] = repr(float(numbers(element, "gainprm")[0]))
    bias = numbers(element, "biasprm").tolist() if "biasprm" in element.attrib else []
    found |= {name: repr(value) for name, value in zip(("constant", "by_length"), bias, strict=False)}
    if len(bias) > 2:
        found["kv"] = repr(max(0.0, -bias[2]))
        found.pop("dampratio", None)
        if bias[2] > 0:  # MuJoCo takes it for a ratio
            found["dampratio"] = repr(bias[2])
    found |= {name: element.attrib[name] for name in ("gaintype", "biastype") if name in element.attrib}
    if "dyntype" in element.attrib:
        found["dyntype"] = element.attrib["dyntype"]
