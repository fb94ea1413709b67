"""Write the file of a robot anew with bodies of other sizes and with other actuation, for other programs.

Names, meshes, drives, sensors and comments stay; only numbers that a factor changes are written, so that the file says
all that the engine has no use for, too.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import astuple
from typing import Unpack
from xml.etree import ElementTree

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.plain_xml import parse_xml
from taichi_sim.rigid.model.actuation import stiffened_tree, strengthened_tree
from taichi_sim.rigid.model.files import Reading, read_model
from taichi_sim.rigid.model.mjcf import MjcfReader
from taichi_sim.rigid.model.mjcf_actuation import stiffen_mjcf, strengthen_mjcf
from taichi_sim.rigid.model.mjcf_resizing import MjcfResizing
from taichi_sim.rigid.model.scaling import scaled_tree
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid
from taichi_sim.rigid.model.tree import Hinge, Joint, Motor, Passive, Servo, Tree
from taichi_sim.rigid.model.urdf import link_of
from taichi_sim.rigid.model.urdf_resizing import resize_urdf, strengthen_urdf

_SAME = 1e-9  # part of the robot's largest length, and of a mass or an inertia, that is rounding


def resized_text(
    text: str,
    factors: Sequence[float],
    stiffness: Sequence[float] = (),
    torques: Sequence[float] = (),
    **reading: Unpack[Reading],
) -> str:
    """Write the text of a file anew, with the bodies of ``scaled_tree`` and the hinges and drives of ``actuation``.

    The new text is read again: it is refused unless it describes the robot that was simulated.

    Args:
        text: content of the file.
        factors: of the bodies in the order of ``tree.ordered``.
        stiffness: factors of the hinges that carry them, by default 1; URDF tells of no stiffness.
        torques: factors of the largest torques of these hinges' drives, by default 1.
        **reading: how the file is read, as of :func:`parse_model`.

    Raises:
        ValueError: for a text that is no such file, or one that cannot hold these bodies.
    """
    tree = read_model(text, **reading).tree
    root = parse_xml(text)
    wanted = scaled_tree(tree, factors)
    if stiffness and root.tag == "mujoco":
        wanted = stiffened_tree(wanted, stiffness)
    if torques:
        wanted = strengthened_tree(wanted, torques)
    if wanted is tree:
        return text
    rise = _origin(wanted) - _origin(tree)
    names = [body.name for body, _ in tree.ordered]
    sizes = {name: float(factor) for name, factor in zip(names, factors, strict=True)}
    stronger = dict(zip(names, torques, strict=False))
    for weighed in (False, True):
        root, copy = parse_xml(text), parse_xml(text, comments=True)
        elements = [each for each in copy.iter() if isinstance(each.tag, str)]
        written = dict(zip(root.iter(), elements, strict=True))
        if root.tag == "mujoco":
            reader = MjcfReader(root, dict(reading.get("angles") or {}), 1.0, 1.0)
            reader.read()
            MjcfResizing(reader, written, sizes, rise, weighed).resize()
            stiffen_mjcf(reader, written, tree, dict(zip(names, stiffness, strict=False)))
            strengthen_mjcf(reader, written, tree, stronger)
            bounded = reader.compiler.smallest > 0 or reader.compiler.lightest > 0
        else:
            resize_urdf(root, written, sizes)
            strengthen_urdf(root, written, stronger)
            bounded = False
        found = f"{_before(text)}{ElementTree.tostring(copy, encoding='unicode')}\n{_after(text, root.tag)}"
        try:
            _check_same(read_model(found, **reading).tree, wanted, placed=root.tag == "mujoco")
        except ValueError:
            if weighed or not bounded:
                raise
        else:
            break
    return found


def starts_of(text: str, **reading: Unpack[Reading]) -> dict[str, float]:
    """Angles [rad] of the hinges that start at another one than in the file itself, by the names of their joints.

    Those are angles that are given, and the middles of ranges that exclude the angle of the file.

    Raises:
        ValueError: for a text that is no such file.
    """
    root = parse_xml(text)
    rests = {hinge.child: hinge.rest for hinge in read_model(text, **reading).tree.hinges}
    if root.tag == "mujoco":
        reader = MjcfReader(root, dict(reading.get("angles") or {}), 1.0, 1.0)
        reader.read()
        found = reader.hinges
    else:
        found = {joint.get("name", ""): (link_of(joint, "child"), 0.0) for joint in root.findall("joint")}
    return {name: rests[child] for name, (child, told) in found.items() if rests.get(child, told) != told}


def height_of(tree: Tree) -> float:
    """Height of the origin of the base's frame above the ground at the start [m], which URDF files do not tell."""
    return float(_origin(tree)[2])


def _before(text: str) -> str:
    """Comments before the root of a file; the encoding of the new one is always UTF-8."""
    head = re.match(r"\s*(<\?xml.*?\?>\s*)?((<!--.*?-->\s*)*)", text, re.DOTALL)
    return head[2] if head else ""


def _after(text: str, tag: str) -> str:
    """Comments after the root of a file."""
    tail = text[text.rfind(f"</{tag}") :].partition(">")[2].lstrip()
    return tail if re.fullmatch(r"(<!--.*?-->\s*)*", tail, re.DOTALL) else ""


def _origin(tree: Tree) -> Floats:
    base = tree.ordered[0][0]
    return np.add(base.position, base.frame)


def _check_same(found: Tree, wanted: Tree, placed: bool) -> None:
    """Refuse a robot that is not the one that was wanted; ``placed`` says whether it must start at the same place."""
    names, others = ([body.name for body, _ in tree.ordered] for tree in (found, wanted))
    same = names == others and found.fixed == wanted.fixed
    for name, joint, other in zip(names[1:], *(tree.ordered[1:] for tree in (found, wanted)), strict=False):
        same = same and type(joint[1]) is type(other[1]) and _alike(joint[1], other[1])
        if not same:
            raise ValueError(f"model: the joint of {name} would not be the same in such a file")
    if not same:
        raise ValueError("model: such a file would have other bodies")
    lengths, matter = _numbers(wanted, np.zeros(3) if placed else _origin(wanted))
    new_lengths, new_matter = _numbers(found, np.zeros(3) if placed else _origin(found))
    largest = np.abs(np.concatenate([*lengths, [0.0]])).max()
    for n, name in enumerate(others):
        close = len(lengths[n]) == len(new_lengths[n]) and np.allclose(new_lengths[n], lengths[n], 0, _SAME * largest)
        heaviest = np.abs(matter[n]).max(axis=1, keepdims=True)
        if not close or not (np.abs(new_matter[n] - matter[n]) <= _SAME * heaviest).all():
            raise ValueError(
                f"model: {name} would be another body in such a file, as with bounds of its compiler; give a "
                "file without them"
            )


def _alike(joint: Joint | None, other: Joint | None) -> bool:
    """Whether two joints are the same in what has nothing to do with sizes, but for rounding of their actuation."""
    if not isinstance(joint, Hinge) or not isinstance(other, Hinge):
        return True
    kept, also = ((tuple(map(float, e.axis)), e.parent, e.child, e.command, e.stops, e.rest) for e in (joint, other))
    return kept == also and all(_near(*pair) for pair in ((joint.motor, other.motor), (joint.passive, other.passive)))


def _near(law: Motor | Servo | Passive | None, other: Motor | Servo | Passive | None) -> bool:
    """Whether two laws have the same numbers, but for rounding."""
    if law is None or other is None or type(law) is not type(other):
        return law is other
    mine, theirs = astuple(law), astuple(other)
    little = _SAME * max(abs(number) for number in theirs if number is not None)  # as the torque at rest cancels
    pairs = zip(mine, theirs, strict=True)
    return all(a == b or (None not in (a, b) and math.isclose(a, b, rel_tol=_SAME, abs_tol=little)) for a, b in pairs)


def _numbers(tree: Tree, origin: Floats) -> tuple[list[Floats], list[Floats]]:
    """Lengths of each body and the anchor of its hinge [m], and its mass and its inertia, (2, 9) each."""
    lengths, matter = [], []
    for body, joint in tree.ordered:
        parts = [np.array(body.position, float) - origin, np.array(body.frame, float)]
        parts += [_of_solid(solid) for solid in (*body.shapes, *body.immersed)]
        parts += [np.array(joint.anchor, float) - origin] if isinstance(joint, Hinge) else []
        lengths.append(np.concatenate(parts))
        matter.append(np.array([np.full(9, body.mass), np.ravel(np.asarray(body.inertia))]))
    return lengths, matter


def _of_solid(solid: Solid) -> Floats:
    if isinstance(solid, Box):
        return np.concatenate([solid.size, solid.centre])
    if isinstance(solid, Capsule):
        return np.concatenate([[solid.radius], np.multiply(solid.length, solid.axis), solid.centre])
    return np.concatenate([[solid.radius], solid.centre])
