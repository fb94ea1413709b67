"""What URDF allows: the attributes and elements of what is read; all else in it is ignored, and named.

Source: http://wiki.ros.org/urdf/XML, and urdfdom's urdf.xsd, whose version 1.2 has ``quat_xyzw``. Capsules are
MuJoCo's. <visual> is not read, so not checked.
"""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

ROUND = ("radius", "length")
SIZES = {"sphere": {"radius": 1}, "box": {"size": 3}, **dict.fromkeys(("cylinder", "capsule"), dict.fromkeys(ROUND, 1))}
ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name", "type"),
    "joint": ("name", "type"),
    "inertial": (),
    "collision": ("name",),
    "geometry": (),
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    **{solid: tuple(sizes) for solid, sizes in SIZES.items()},
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
}
CHILDREN = {
    "robot": ("link", "joint"),
    "link": ("inertial", "collision"),
    "inertial": ("origin", "mass", "inertia"),
    "collision": ("origin", "geometry"),
    "geometry": tuple(SIZES),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics"),
}
TOLD = {"robot": ("mujoco",), "link": ("visual",)}  # elements that the reader names in words of its own


def strangers(root: Element) -> tuple[str, ...]:
    """Elements and attributes that URDF has not, or that are not read, one for each kind, within the elements read."""
    elements, attributes = set[str](), set[str]()
    for element in _read_in(root):
        attributes |= {f"{_plain(name)} of <{element.tag}>" for name in element.attrib} - {
            f"{name} of <{element.tag}>" for name in ATTRIBUTES[element.tag]
        }
        if element is not root:
            known = CHILDREN.get(element.tag, ()) + TOLD.get(element.tag, ())
            elements |= {f"<{_plain(child.tag)}>" for child in element if child.tag not in known}
    return *sorted(elements), *sorted(attributes)


def _read_in(element: Element) -> Iterator[Element]:
    yield element
    for child in element:
        if child.tag in CHILDREN.get(element.tag, ()):
            yield from _read_in(child)


def _plain(name: str) -> str:
    """A name without the address of its namespace."""
    return name.rpartition("}")[2]
