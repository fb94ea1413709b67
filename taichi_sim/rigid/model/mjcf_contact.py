"""Which solids of an MJCF file touch the ground, the plane z = 0 of its world, and with what friction.

Source: MuJoCo documentation, "Computation" (collision, selection) and "Modeling" (contact parameters).
"""

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from taichi_sim.rigid.model.mjcf_compiler import Compiler
from taichi_sim.rigid.model.xml_values import integer, named, not_negative, numbers

_DIMENSIONS = (1, 3, 4, 6)


@dataclass(eq=False)
class Contacts:
    """The solids of a file's world, and the friction on them of those of its robot.

    Attributes:
        compiler: settings of the file.
        excluded: names of bodies that touch nothing of the world.
        off: whether the file has nothing touch.
        floor: the plane, once it was found.
        others: other solids of the world.
        frictions: coefficients of the robot's solids on the plane.
        ignored: what the engine has not, by what was found so far.
    """

    compiler: Compiler
    excluded: frozenset[str]
    off: bool
    floor: Element | None = None
    others: list[Element] = field(default_factory=list)
    frictions: set[float] = field(default_factory=set)
    ignored: dict[str, None] = field(default_factory=dict)

    def add(self, geom: Element) -> None:
        """Add a solid of the world.

        Raises:
            ValueError: for a second plane, or one that is not z = 0.
        """
        _check_bits(geom)
        if geom.get("type") != "plane":
            self.others.append(geom)
            return
        level = abs(self.compiler.turn(geom)[2, 2] - 1) < 1e-9 and abs(numbers(geom, "pos", "0 0 0", 3)[2]) < 1e-9
        if not level or self.floor is not None:
            raise ValueError(f"{named(geom)}: not allowed; give one plane, z = 0")
        if numbers(geom, "size", None, 3)[2] <= 0:
            raise ValueError(f"{named(geom)}: size {geom.get('size')!r} is not allowed; give a third number above 0")
        self.floor = geom

    def touch(self, geom: Element, body: str, still: bool) -> bool:
        """Whether a solid of a body touches the ground; without a plane, whether it would touch the usual one.

        Raises:
            ValueError: if it touches another solid of the world, which it does not if it is as ``still`` as that.
        """
        _check_bits(geom)
        if self.off or body in self.excluded:
            return False
        for other in self.others:
            if not still and _meet(geom, other):
                raise ValueError(f"{named(other)}: the world has a plane only; give no other solid that touches robots")
        return _meet(geom, Element("geom") if self.floor is None else self.floor)

    def rub(self, geom: Element) -> None:
        """Note the friction of a solid that touches the ground, by MuJoCo's rule for two.

        The solid of the higher priority decides, else the larger numbers.
        """
        pair = [each for each in (geom, self.floor) if each is not None]
        ranks = [integer(each, "priority", "0") for each in pair]
        own = [not_negative(each, "friction", float(numbers(each, "friction", "1")[0])) for each in pair]
        deciding = [number for number, rank in enumerate(ranks) if rank == max(ranks)]
        dimensions = max(integer(pair[number], "condim", "3") for number in deciding)
        self.frictions.add(0.0 if dimensions == 1 else max(own[number] for number in deciding))
        if dimensions > 3:
            self.ignored["friction of turning and rolling (condim)"] = None


def _check_bits(geom: Element) -> None:
    if (dimensions := integer(geom, "condim", "3")) not in _DIMENSIONS:
        raise ValueError(f"{named(geom)}: condim {dimensions} is not allowed; give 1, 3, 4 or 6")
    _bits(geom)


def _bits(geom: Element) -> tuple[int, int]:
    return integer(geom, "contype", "1"), integer(geom, "conaffinity", "1")


def _meet(one: Element, other: Element) -> bool:
    """Whether two solids collide: the type of one and the affinity of the other have a bit in common."""
    mine, theirs = _bits(one), _bits(other)
    return bool(mine[0] & theirs[1] or theirs[0] & mine[1])
