"""Read the mass and the solids of an MJCF body, from its solids or its inertial.

Source: MuJoCo documentation, "XML reference", compiler, inertial and geom.
"""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.assembly import Cylinder, Frame, Lump, placed, possible_inertia, solid_of
from taichi_sim.rigid.model.mjcf_compiler import Compiler, turn_to
from taichi_sim.rigid.model.mjcf_contact import Contacts
from taichi_sim.rigid.model.mjcf_schema import TURNS, checked, notes
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.model.xml_values import integer, keyword, named, not_negative, number, numbers, single

_SIZES = {"sphere": 1, "capsule": 2, "box": 3, "cylinder": 2}  # numbers in size; halves of lengths and edges
_HEAVIEST = 1e100  # kg; the squares of distances times it stay numbers


def check_solid(geom: Element, compiler: Compiler) -> None:
    """Check that a solid of the world that touches nothing is one that there is.

    Raises:
        ValueError: for sizes or places that are not allowed.
    """
    if geom.get("type", "sphere") in _SIZES:
        _read_geom(geom, geom.get("type", "sphere"), Frame(np.zeros(3), np.eye(3)), compiler)


def read_matter(
    body: Element, geoms: Sequence[Element], place: Frame, compiler: Compiler, contacts: Contacts, still: bool
) -> tuple[Lump, list[Solid], list[Solid]]:
    """Read the mass of a body, its solids that touch, and those that do not but have a part in its mass.

    Args:
        body: element of the body.
        geoms: its solids, with their defaults.
        place: of the body, with the robot at rest.
        compiler: settings of the file.
        contacts: what touches the ground; notes the friction of the solids that do.
        still: whether the body never moves, so that its friction is of no account.

    Raises:
        ValueError: for solids or inertias that are not allowed.
    """
    inertial, lump, shapes, immersed = single(body, "inertial"), Lump(), list[Solid](), list[Solid]()
    owner = f"inertial of {named(body)}"
    own = None if inertial is None else _read_inertial(checked(inertial), owner, place, compiler)
    from_geoms = compiler.from_geoms == "true" or (compiler.from_geoms == "auto" and own is None)
    for geom in geoms:
        touches, kind = contacts.touch(geom, body.get("name", ""), still), geom.get("type", "sphere")
        counts = from_geoms and compiler.groups[0] <= integer(geom, "group", "0") <= compiler.groups[1]
        if not touches and not counts:
            if kind in _SIZES or kind == "plane":
                _read_geom(geom, kind, place, compiler)  # a picture, which must be one that there is
            continue
        at, solid = _read_geom(geom, kind, place, compiler)
        if counts:
            if keyword(geom, "shellinertia", "false", "true") == "true":
                raise ValueError(f"{named(geom)}: shellinertia is not allowed; give solids, with a mass")
            density = not_negative(geom, "density", number(geom, "density", "1000"))
            mass = _mass(geom, number(geom, "mass", str(min(density * solid.volume, 2 * _HEAVIEST))))
            lump = lump + Lump.of(mass, at, solid.inertia(mass))
        if not touches:
            immersed += _in_water(solid, named(geom), at)
        else:
            shapes.append(placed(solid, named(geom), at))
            if still:
                continue
            contacts.rub(geom)
            contacts.ignored |= notes(geom)
            if kind == "cylinder":
                contacts.ignored["edges of cylinders, which touch the ground as capsules of their length"] = None
    if own is not None and (not from_geoms or lump.mass == 0):
        at, mass, matrix = own
        mass, matrix = compiler.bounded(owner, mass, matrix)
        return Lump.of(mass, at, possible_inertia(owner, matrix, compiler.balanced)), shapes, immersed
    mass, inertia = compiler.bounded(f"inertia of {named(body)}", lump.mass, lump.inertia)
    if mass != lump.mass or inertia is not lump.inertia:
        # MuJoCo has a body's place in its carrier as the centre of what has none, in the body's own frame.
        alone = place.position + place.rotation @ numbers(body, "pos", "0 0 0", 3)
        lump = Lump(mass, lump.centre if lump.mass > 0 else alone, inertia)
    return lump, shapes, immersed


def _in_water(solid: Solid | Cylinder, name: str, at: Frame) -> list[Solid]:
    """A solid that touches nothing as water finds it; none of a kind that cannot be placed there."""
    try:
        return [placed(solid, name, at)]
    except ValueError:
        return []


def _read_inertial(inertial: Element, owner: str, place: Frame, compiler: Compiler) -> tuple[Frame, float, Floats]:
    """Read the place, the mass and the inertia in that place's axes, of an inertial."""
    full = "fullinertia" in inertial.attrib
    if full and (beside := [name for name in ("diaginertia", *TURNS) if name in inertial.attrib]):
        raise ValueError(f"{owner}: fullinertia and {beside[0]} are not allowed together; give one")
    at = place.then(numbers(inertial, "pos", None, 3), compiler.turn(inertial))
    if full:
        xx, yy, zz, xy, xz, yz = numbers(inertial, "fullinertia", None, 6)
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        matrix = np.diag(numbers(inertial, "diaginertia", None, 3))
    return at, _mass(inertial, number(inertial, "mass")), matrix


def _mass(element: Element, mass: float) -> float:
    if mass > _HEAVIEST:
        raise ValueError(f"{named(element)}: mass {mass:g} is not allowed; give at most {_HEAVIEST:g} kg")
    return not_negative(element, "mass", mass)


def _read_geom(geom: Element, kind: str, place: Frame, compiler: Compiler) -> tuple[Frame, Solid | Cylinder]:
    """Read a solid and its place."""
    if kind not in _SIZES or "mesh" in geom.attrib or "hfield" in geom.attrib:
        kind = kind if kind not in _SIZES else "mesh"
        raise ValueError(f"{named(geom)}: type {kind!r} is not allowed; give {', '.join(_SIZES)}")
    size = numbers(geom, "size")
    if "fromto" in geom.attrib:
        at, half = _between(geom, kind, place)
        size = np.append(np.resize(size[:1], 2 if kind == "box" else 1), half)
    else:
        at = place.then(numbers(geom, "pos", "0 0 0", 3), compiler.turn(geom))
    if len(size) < _SIZES[kind]:
        raise ValueError(f"{named(geom)}: {len(size)} sizes are not allowed; give {_SIZES[kind]}")
    size[0 if kind == "box" else 1 :] *= 2  # from halves of edges and lengths
    return at, solid_of(kind, named(geom), size[: _SIZES[kind]].tolist())


def _between(geom: Element, kind: str, place: Frame) -> tuple[Frame, float]:
    """Frame of a solid that reaches from one point to another, and half its length [m]."""
    ends: Floats = numbers(geom, "fromto", None, 6).reshape(2, 3)
    along = ends[0] - ends[1]  # the third axis, as MuJoCo has it
    length = float(np.linalg.norm(along))
    placed_twice = bool(numbers(geom, "pos", "0 0 0", 3).any())
    if kind == "sphere" or placed_twice or length < 1e-12:
        told = "of a sphere" if kind == "sphere" else "beside pos" if placed_twice else "between equal points"
        raise ValueError(f"{named(geom)}: fromto {told} is not allowed; give it or size, pos and a turn")
    return place.then(ends.mean(0), turn_to(along / length)), length / 2
