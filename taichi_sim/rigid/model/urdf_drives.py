"""The drives of URDF files, which tell of them only how strong and how fast they are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from taichi_sim.base import checks
from taichi_sim.base.names import choices_of
from taichi_sim.rigid.model.tree import Motor, Servo
from taichi_sim.rigid.model.xml_values import not_negative, number, single

FIELD = "servos"
CRITICAL = 1.0  # damping ratio of servos whose damping is not given
_SPEED, _FASTEST = 10.0, 10.0  # 1/s and rad/s, of drives whose own is not given

Gains = tuple[float, ...]  # stiffness [N m/rad], and maybe damping [N m s/rad]


def checked_gains(given: object) -> dict[str, Gains]:
    """Gains of servos by names of joints or patterns of these: stiffness and damping, or stiffness alone.

    Raises:
        ValueError: for anything else.
    """
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise ValueError(f"{FIELD}: {given!r} is not allowed; give gains by names of joints, as {{'knee*': (40, 1)}}")
    return {name: _checked(f"{FIELD} of {name}", gains) for name, gains in given.items()}


def _checked(where: str, gains: object) -> Gains:
    values = tuple(gains) if isinstance(gains, list | tuple) else (gains,)
    if len(values) not in (1, 2):
        raise ValueError(f"{where}: {gains!r} is not allowed; give a stiffness and a damping, or a stiffness alone")
    stiffness = checks.number(f"{where}: stiffness", values[0], 0.0, unit="N m/rad")
    return (stiffness, *(checks.number(f"{where}: damping", each, 0.0, unit="N m s/rad") for each in values[1:]))


def spoken_gains(servos: Mapping[str, Gains]) -> str:
    """Gains for people, such as ``knee* 40 N m/rad, 1 N m s/rad``."""
    told = (("critically damped" if len(g) == 1 else f"{g[1]:g} N m s/rad", name, g[0]) for name, g in servos.items())
    return "; ".join(f"{name} {stiffness:g} N m/rad, {damping}" for damping, name, stiffness in told)


@dataclass(frozen=True)
class Drives:
    """How the drives of a URDF file act: they hold rates, but for those that are servos.

    Attributes:
        speed: of position drives that hold rates: part of the way to their target that they want to go [1/s].
        fastest: rate at full command of continuous joints whose velocity is not given [rad/s].
        servos: gains of servos, by names of joints.
    """

    speed: float
    fastest: float
    servos: Mapping[str, Gains] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        joints: Sequence[Element],
        speed: float | None,
        fastest: float | None,
        servos: Mapping[str, Gains],
        time_step: float,
    ) -> "Drives":
        """Find the joints that the names and patterns of ``servos`` are of; what is None is usual.

        A drive that holds a rate makes up for at most all of what lacks in a ``time_step`` [s].

        Raises:
            ValueError: for a name of no drive, and two for one.
        """
        driven = [joint.get("name", "") for joint in joints if _limits(joint)[0] > 0]
        which = choices_of(FIELD, "drive", driven, servos)
        gains = list(servos.values())
        found = {name: gains[number] for name, number in zip(driven, which, strict=True) if number >= 0}
        return cls(min(speed or _SPEED, 1 / time_step), fastest or _FASTEST, found)

    def drive(self, joint: Element, stops: tuple[float, float] | None) -> Motor | Servo | None:
        """Read the drive of a joint, which has ``stops`` [rad] or turns without end; None without effort.

        Where the velocity is 0, a revolute joint has no largest rate, and a continuous one is told rates up to
        ``fastest``. Servos have no largest rate.

        Raises:
            ValueError: for limits that are not allowed, and gains with which a servo has no torque.
        """
        effort, rate = _limits(joint)
        if effort == 0:  # no force: files of joints that nothing drives say so, and other readers make no drive of it
            return None
        if (gains := self.servos.get(joint.get("name", ""))) is not None:
            return _servo(joint, gains, stops, rate or self.fastest, effort)
        if stops is None:
            return Motor.velocity(rate or self.fastest, effort)
        return Motor.position(*stops, self.speed, effort, rate or None)


def _servo(joint: Element, gains: Gains, stops: tuple[float, float] | None, fastest: float, effort: float) -> Servo:
    """A servo by angle between stops; without them one by rate, of whose gains only the damping counts."""
    stiffness, *damping = gains
    where = f"{FIELD} of {joint.get('name')}"
    if stops is None:
        if not damping or damping[0] == 0:
            raise ValueError(f"{where}: it turns without end; give a damping above 0, as 0,1, by which it holds rates")
        return Servo(damping[0] * fastest, by_rate=damping[0], torque=effort)
    if stiffness == 0:
        raise ValueError(f"{where}: a stiffness of 0 is not allowed between limits; give one above 0")
    low, high = stops
    half, middle = stiffness * (high - low) / 2, stiffness * (high + low) / 2
    rate = {"by_rate": damping[0]} if damping else {"damping_ratio": CRITICAL}
    return Servo(half, -stiffness, middle, torque=effort, **rate)


def _limits(joint: Element) -> tuple[float, float]:
    """Effort [N m] and velocity [rad/s] of a joint; 0 where they are not given."""
    if (limit := single(joint, "limit")) is None:
        return 0.0, 0.0
    effort, rate = (not_negative(joint, name, number(limit, name, "0")) for name in ("effort", "velocity"))
    return effort, rate
