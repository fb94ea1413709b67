"""What MJCF's <compiler> says of a file's numbers: angles, turns, limits, and where masses come from.

Source: MuJoCo documentation, "XML reference", compiler, and "Modeling" (frame orientations).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.assembly import computable
from taichi_sim.rigid.model.mjcf_schema import checked
from taichi_sim.rigid.model.xml_values import direction, keyword, limits, named, number, numbers

_SWITCHES = ("false", "true")
_MOST_BOUND = 1e100  # kg, or kg m^2


@dataclass(frozen=True)
class Compiler:
    """Settings of all <compiler> elements of a file.

    Attributes:
        degrees: whether angles are in degrees.
        sequence: axes of Euler angles; lower case turns with the frame, upper case stays.
        automatic: whether limits that are given hold unless it is said that they do not.
        balanced: whether impossible inertias are balanced.
        from_geoms: whether solids give a body its mass: ``"auto"``, where it has no inertial; ``"true"``; ``"false"``.
        lightest: least mass of a body [kg].
        smallest: least principal moment of inertia of a body [kg m^2].
        groups: first and last group of the solids that have mass.
    """

    degrees: bool
    sequence: str
    automatic: bool
    balanced: bool
    from_geoms: str
    lightest: float
    smallest: float
    groups: tuple[int, int]

    @classmethod
    def of(cls, root: Element) -> "Compiler":
        """Read the settings of a file.

        Raises:
            ValueError: for settings that are not allowed.
        """
        found = Element("compiler", merged(checked(each) for each in root.iterfind("compiler")))
        if keyword(found, "coordinate", "local", "global") == "global" or number(found, "settotalmass", "-1") > 0:
            raise ValueError("compiler: global coordinates and settotalmass are not allowed; give a file without them")
        sequence = found.get("eulerseq", "xyz")
        if len(sequence) != 3 or set(sequence) - set("xyzXYZ"):
            raise ValueError(f"compiler: eulerseq {sequence!r} is not allowed; give three of x, y, z, X, Y and Z")
        groups = numbers(found, "inertiagrouprange", "0 5", 2)
        if (groups != groups.round()).any():
            raise ValueError(
                f"compiler: inertiagrouprange {found.get('inertiagrouprange')!r} is not allowed; give two groups"
            )
        bounds = [number(found, name, "0") for name in ("boundmass", "boundinertia")]
        if max(bounds) > _MOST_BOUND:
            raise ValueError(f"compiler: a bound of {max(bounds):g} is not allowed; give at most {_MOST_BOUND:g}")
        return cls(
            keyword(found, "angle", "degree", "radian") == "degree",
            sequence,
            keyword(found, "autolimits", "true", "false") == "true",
            keyword(found, "balanceinertia", *_SWITCHES) == "true",
            keyword(found, "inertiafromgeom", "auto", "true", "false"),
            bounds[0],
            bounds[1],
            (int(groups[0]), int(groups[1])),
        )

    def angle(self, value: float) -> float:
        """Convert an angle of the file to radians."""
        return float(np.radians(value)) if self.degrees else value

    def turn(self, element: Element) -> Floats:
        """Rotation matrix of an element, from whichever attribute gives it.

        Raises:
            ValueError: for an attribute that gives none.
        """
        if "axisangle" in element.attrib:
            *axis, angle = numbers(element, "axisangle", None, 4)
            length = np.linalg.norm(axis)
            if length < 1e-12:
                raise ValueError(
                    f"{named(element)}: axisangle {element.get('axisangle')!r} is not allowed; give an axis"
                )
            return np.asarray(Rotation.from_rotvec(np.array(axis) / length * self.angle(angle)).as_matrix())
        if "euler" in element.attrib:
            return _euler(self.sequence, [self.angle(each) for each in numbers(element, "euler", None, 3)])
        if "xyaxes" in element.attrib:
            return _axes(element)
        if "zaxis" in element.attrib:
            return turn_to(direction(element, "zaxis", "0 0 1"))
        if "quat" in element.attrib:
            given = numbers(element, "quat", None, 4)
            if not given.any():
                raise ValueError(
                    f"{named(element)}: quat {element.get('quat')!r} is not allowed; give one that is not 0"
                )
            return np.asarray(Rotation.from_quat(given, scalar_first=True).as_matrix())
        return np.eye(3)

    def limits(self, element: Element, attribute: str, limited: str) -> tuple[float, float] | None:
        """Two limits of an element, None without, with the errors of :func:`limits`."""
        return limits(element, attribute, limited, self.automatic)

    def bounded(self, name: str, mass: float, inertia: Floats) -> tuple[float, Floats]:
        """The mass and inertia of what has a name, with the least mass and principal moments that the file allows."""
        if self.smallest > 0:
            moments, axes = np.linalg.eigh(computable(name, inertia))
            if moments[0] < self.smallest:
                inertia = axes @ np.diag(np.maximum(moments, self.smallest)) @ axes.T
        return max(mass, self.lightest), inertia


def merged(elements: Iterable[Element]) -> dict[str, str]:
    """Attributes of all elements; where several have one, that of the last."""
    return {name: value for each in elements for name, value in each.items()}


def turn_to(axis: Floats) -> Floats:
    """Matrix of the smallest rotation that takes the third axis to a direction."""
    cross = np.array([-axis[1], axis[0], 0.0])
    sine = np.linalg.norm(cross)
    if sine < 1e-12:
        return np.diag([1.0, 1.0, 1.0]) if axis[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(Rotation.from_rotvec(cross / sine * np.arctan2(sine, axis[2])).as_matrix())


def _euler(sequence: str, angles: list[float]) -> Floats:
    """Matrix of Euler angles."""
    pure = sequence.islower() or sequence.isupper()
    if pure and sequence[0] != sequence[1] != sequence[2]:
        return np.asarray(Rotation.from_euler(sequence.swapcase(), angles).as_matrix())  # scipy's cases are the other
    found = Rotation.identity()  # sequences that scipy does not take
    for axis, angle in zip(sequence, angles, strict=True):
        turn = Rotation.from_euler(axis.lower(), angle)
        found = found * turn if axis.islower() else turn * found
    return np.asarray(found.as_matrix())


def _axes(element: Element) -> Floats:
    axes = numbers(element, "xyaxes", None, 6).reshape(2, 3)
    length = np.linalg.norm(axes[0])
    x = axes[0] / max(length, 1e-300)
    y = axes[1] - (axes[1] @ x) * x
    if length < 1e-12 or np.linalg.norm(y) < 1e-12:
        raise ValueError(f"{named(element)}: xyaxes {element.get('xyaxes')!r} is not allowed; give two directions")
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
