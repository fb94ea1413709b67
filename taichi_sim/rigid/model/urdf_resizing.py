"""Resize links and strengthen drives within a URDF file: numbers that factors change are written anew.

Source: http://wiki.ros.org/urdf/XML. A joint's frame is its child's, so links are resized about the origin of theirs.
"""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from taichi_sim.rigid.model.urdf import base_of, link_of, outwards
from taichi_sim.rigid.model.urdf_schema import SIZES
from taichi_sim.rigid.model.xml_values import numbers, single, with_numbers

_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def resize_urdf(root: Element, written: Mapping[Element, Element], sizes: Mapping[str, float]) -> None:
    """Write the links of a file anew.

    Args:
        root: the file as it was read.
        written: the element to write for each element that was read.
        sizes: factors by the names of the tree's bodies; others join their carriers, and have the size of these.
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = root.findall("joint")
    base = base_of(links, joints)
    found = {base: sizes.get(base, 1.0)}
    for joint in outwards(joints, base):
        carrier = found[link_of(joint, "parent")]
        found[link_of(joint, "child")] = sizes.get(link_of(joint, "child"), carrier)
        _resize(single(joint, "origin"), written, {"xyz": 1}, carrier)
    for name, size in found.items():
        _resize_link(links[name], written, size)


def strengthen_urdf(root: Element, written: Mapping[Element, Element], factors: Mapping[str, float]) -> None:
    """Write the largest torques of drives anew, by factors of the links that their joints carry; others stay."""
    for joint in root.findall("joint"):
        _resize(single(joint, "limit"), written, {"effort": 1}, factors.get(link_of(joint, "child"), 1.0))


def _resize_link(link: Element, written: Mapping[Element, Element], size: float) -> None:
    """Resize what belongs to a link: its inertial, solids and pictures."""
    for part in link:
        if part.tag in ("inertial", "visual", "collision"):
            _resize(single(part, "origin"), written, {"xyz": 1}, size)
        if part.tag == "inertial":
            _resize(single(part, "mass"), written, {"value": 3}, size)
            _resize(single(part, "inertia"), written, dict.fromkeys(_INERTIA, 5), size)
        for solid in part.iterfind("geometry/*"):
            if solid.tag == "mesh" and size != 1:
                written[solid].set("scale", with_numbers(size * numbers(solid, "scale", "1 1 1")))
            _resize(solid, written, dict.fromkeys(SIZES.get(solid.tag, ()), 1), size)


def _resize(
    element: Element | None, written: Mapping[Element, Element], powers: Mapping[str, int], size: float
) -> None:
    """Multiply attributes of an element, if it has them, by a power of a size each."""
    if element is None or size == 1:
        return
    for name, power in powers.items():
        if name in element.attrib:
            written[element].set(name, with_numbers(size**power * numbers(element, name)))
