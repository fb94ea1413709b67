"""What is not known exactly of a robot and its ground, and how scores over draws of it become one number."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.robot import HERE, OK, Judgement, Outcome, Progress, Robot, World
from robots.world import MATERIAL_FRICTION, STEEPEST, Terrain, friction_of_parts, terrain_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import decimal, shortest

if TYPE_CHECKING:
    from taichi_sim.lattice import Material

FRICTION = ("friction", "sliding", "gripping")
DRIVE = ("levels", "timing")  # of actuators
GROUND = (*FRICTION, "slope")
QUANTITIES = (*GROUND, *DRIVE)
SHARES = (*FRICTION, *DRIVE)  # given in percent
MOST = {"timing": 0.5}  # of shares, where it is less than 1
TAIL = 0.2  # share of the worst draws that a judgement tells of, unless the risk names one
JUDGED_DRAWS = 64  # held-out draws by which designs are judged
RESAMPLES = 2000  # of the bootstrap
SEARCHED, HELD_OUT = 1, 2  # streams of random numbers: what searches see, and what designs are judged by afterwards


@dataclass(frozen=True)
class Perturbation:
    """One draw: by how much friction, slope, and what actuators do, differ from what is nominal.

    Attributes:
        sliding: factor of the friction of sliding feet.
        gripping: factor of that of gripping feet, skin, seams and bladders.
        slope: added to the slope [degrees].
        levels: factors of how far actuators go, one each; none is as they are told.
        timing: factor of how long their strokes, and waits between them, last.
    """

    sliding: float = 1.0
    gripping: float = 1.0
    slope: float = 0.0
    levels: tuple[float, ...] = ()
    timing: float = 1.0

    def tilted(self, terrain: Terrain) -> float:
        """The slope of a terrain in this draw [degrees]."""
        return min(max(terrain.slope + self.slope, -STEEPEST), STEEPEST)

    def rubbed(self, material: "Material") -> "Material":
        """A material with the friction of this draw."""
        static, kinetic = self.gripping * material.static_friction, self.gripping * material.kinetic_friction
        return dataclasses.replace(material, static_friction=static, kinetic_friction=kinetic)

    def under(self, terrain: Terrain) -> Terrain:
        """The terrain of this draw for robots whose own friction is not the terrain's."""
        if terrain.is_fluid:
            return terrain
        own = {name: getattr(terrain, name) for name in ("high_friction", *MATERIAL_FRICTION)}
        rubbed: dict[str, Any] = {name: value * self.gripping for name, value in own.items() if value is not None}
        return dataclasses.replace(terrain, slope=self.tilted(terrain), **rubbed)

    def on(self, terrain: Terrain, high: float, low: float) -> Terrain:
        """The terrain of this draw; ``high`` and ``low`` are of the robot's feet, where the terrain gives none.

        In a fluid there is no ground that a draw could change.
        """
        if terrain.is_fluid:
            return terrain
        high = (high if terrain.high_friction is None else terrain.high_friction) * self.gripping
        low = low if terrain.low_friction is None else terrain.low_friction
        return dataclasses.replace(
            terrain,
            slope=self.tilted(terrain),
            high_friction=high,
            low_friction=min(low * self.sliding, high),  # sliding feet never hold better than gripping ones
            **friction_of_parts(terrain, self.gripping),
        )


@dataclass(frozen=True)
class Uncertainty:
    """Half-widths of the intervals from which unknown quantities are drawn, evenly and independently.

    Attributes:
        friction: of the factor that sliding and gripping friction share, 0 to 1.
        sliding: of a factor of sliding friction alone, 0 to 1.
        gripping: of a factor of gripping friction alone, 0 to 1.
        slope: of what is added to the slope, 0 to 45 degrees.
        levels: of a factor of how far each actuator goes, 0 to 1, drawn for every one of them.
        timing: of the factor of how long strokes and waits last, 0 to 0.5.
    """

    friction: float = 0.0
    sliding: float = 0.0
    gripping: float = 0.0
    slope: float = 0.0
    levels: float = 0.0
    timing: float = 0.0

    def __post_init__(self) -> None:
        for name in SHARES:
            value, most = getattr(self, name), MOST.get(name, 1.0)
            if not 0 <= value <= most:
                raise ValueError(f"uncertain: {name}={100 * value:g}% is not allowed; give 0% to {100 * most:g}%")
        if not 0 <= self.slope <= STEEPEST:
            raise ValueError(f"uncertain: slope={self.slope:g} is not allowed; give 0 to {STEEPEST:g} degrees")

    @classmethod
    def parse(cls, text: str) -> Self:
        """The uncertainty of a text such as ``friction=20%,slope=1``; shares may also be written as ``0.2``.

        Raises:
            ValueError: for an unknown quantity, one given twice, and a value that is not allowed.
        """
        found: dict[str, float] = {}
        for part in text.split(","):
            name, _, value = (piece.strip() for piece in part.partition("="))
            if name not in QUANTITIES:
                raise ValueError(f"uncertain: {name!r} is unknown; choose from {', '.join(QUANTITIES)}")
            if name in found:
                raise ValueError(f"uncertain: {name} is given twice; give it once")
            percent = name in SHARES and value.endswith("%")
            try:
                number = float(value.removesuffix("%") if percent else value)
            except ValueError:
                example = f"{name}=20%" if name in SHARES else f"{name}=1 (degrees)"
                raise ValueError(f"uncertain: {part.strip()!r} is not allowed; give such as {example}") from None
            found[name] = number / 100 if percent else number
        return cls(**found)

    @property
    def text(self) -> str:
        """The text that says it, always the same for the same uncertainty."""
        given = [name for name in QUANTITIES if getattr(self, name)]
        return ",".join(f"{name}={getattr(self, name)!r}" for name in given)

    def check_ground(self, world: World) -> None:
        """Refuse to draw what a world does not have.

        Raises:
            ValueError: that names it.
        """
        of_ground = [name for name in GROUND if getattr(self, name)]
        if not isinstance(world, Terrain):
            raise ValueError(f"uncertain: {self.text} is not allowed in {world.name}, which has no ground")
        if of_ground and world.is_fluid:
            told = f"uncertain: {self.text} is not allowed {world.where}, which has no ground"
            raise ValueError(f"{told}; leave out {', '.join(of_ground)}")
        if self.slope and world.is_wet:
            raise ValueError(f"uncertain: {self.text} is not allowed with water, which is level; leave out slope")

    def check(self, robot: Robot, world: World) -> None:
        """Refuse to draw what a robot or its world does not have.

        Raises:
            ValueError: that names it.
        """
        self.check_ground(robot.as_terrain(world))
        for name in QUANTITIES:
            if getattr(self, name) and name not in robot.uncertain_in:
                lacking = "friction" if name == "friction" else "actuators" if name in DRIVE else f"{name} feet"
                raise ValueError(f"uncertain: {self.text} is not allowed; {robot.name} has no {lacking} to draw")

    @property
    def drives(self) -> bool:
        """Whether what actuators do is uncertain."""
        return any(getattr(self, name) for name in DRIVE)

    def draw(self, count: int, stream: int = SEARCHED, seed: int = 0, actuators: int = 0) -> list[Perturbation]:
        """So many perturbations; those of one stream and seed are always the same, other streams are independent.

        Args:
            count: how many.
            stream, seed: which.
            actuators: that the robot has, for ``levels``.
        """
        each = np.random.default_rng((stream, seed)).uniform(-1.0, 1.0, (count, len(GROUND)))
        pair, sliding, gripping, slope = (each * [getattr(self, name) for name in GROUND]).T
        grounds = np.stack([(1 + pair) * (1 + sliding), (1 + pair) * (1 + gripping), slope], axis=1).tolist()
        # Streams of their own: so the ground is the same whether or not actuators are uncertain, and how many.
        times = 1 + self.timing * np.random.default_rng((stream, seed, 1)).uniform(-1.0, 1.0, count)
        levels = np.random.default_rng((stream, seed, 2)).uniform(-1.0, 1.0, (count, actuators if self.levels else 0))
        told = zip(grounds, (1 + self.levels * levels).tolist(), times.tolist(), strict=True)
        return [Perturbation(low, high, tilt, tuple(reach), time) for (low, high, tilt), reach, time in told]


@dataclass(frozen=True)
class Risk:
    """How scores over draws become one number: the mean of the worst share of them.

    Attributes:
        share: 1 is the mean of all draws, 0 the worst draw alone; between, the conditional value at risk (CVaR).
    """

    share: float = 1.0

    @classmethod
    def parse(cls, text: str) -> Self:
        """The risk measure of a text: ``mean``, ``worst`` or ``cvar:SHARE`` such as ``cvar:0.2``.

        Raises:
            ValueError: for anything else.
        """
        if text in ("mean", "worst"):
            return cls(1.0 if text == "mean" else 0.0)
        kind, _, share = text.partition(":")
        try:
            number = float(share) if kind == "cvar" else math.nan
        except ValueError:
            number = math.nan
        if not 0 < number <= 1:
            raise ValueError(f"risk: {text!r} is not allowed; give mean, worst or cvar:SHARE with a share in (0, 1]")
        return cls(number)

    @property
    def text(self) -> str:
        """The text that says it."""
        return {1.0: "mean", 0.0: "worst"}.get(self.share, f"cvar:{shortest(self.share)}")

    def weights(self, scores: ArrayLike) -> Floats:
        """Derivatives of the number by the scores, shape (..., K): of the worst K times share, equal weights.

        A share that is no whole number of draws counts the last of them in part.
        """
        scores = np.asarray(scores, float)
        count = scores.shape[-1]
        worst = max(self.share * count, 1.0)
        ranks = np.argsort(np.argsort(scores, axis=-1, kind="stable"), axis=-1, kind="stable")
        return np.asarray(np.clip(worst - ranks, 0.0, 1.0) / worst)

    def of(self, scores: ArrayLike) -> Floats:
        """The number, shape (...), of scores, shape (..., K); NaN where a draw failed."""
        scores = np.asarray(scores, float)
        failed = ~np.isfinite(scores).all(axis=-1)
        return np.where(failed, np.nan, (self.weights(scores) * np.where(failed[..., None], 0, scores)).sum(axis=-1))


@dataclass(frozen=True)
class Score:
    """A number by which a robot is judged in one world, where more is better.

    Attributes:
        name: such as ``speed`` or ``minus energy``.
        unit: such as ``BL/s``; empty for a plain number.
        of: its values, shape (N,), in an outcome.
        stands_in: whether it is the robot's first measure in place of what a search judges, which is no such number.
    """

    name: str
    unit: str
    of: Callable[[Outcome], Floats]
    stands_in: bool = False

    @classmethod
    def first_of(cls, robot: Robot, stands_in: bool = False) -> Self:
        """The first measure of a robot."""
        measure = robot.measures[0]
        return cls(measure.name, measure.unit, lambda outcome: outcome.measures[measure.name], stands_in)


def judge_uncertain(
    robot: Robot,
    world: World,
    uncertainty: Uncertainty,
    risk: Risk,
    draws: int,
    *,
    score: Score | None = None,
    compute: Compute = HERE,
    progress: Progress | None = None,
) -> Judgement:
    """Tell how a robot of which nothing is free does over draws that no search has seen.

    What the risk names is told first; CVaR is of its share, or of ``TAIL``.

    Args:
        robot: that is judged.
        world: where.
        uncertainty: what is drawn.
        risk: that is told first.
        draws: how many.
        score: by which it is judged; its first measure by default. A draw in which it is no number has failed.
        compute: device, precision and threads.
        progress: called now and then with the fraction done.

    Raises:
        ValueError: if its world has no such ground, or it no friction, levels or timing that can be drawn.
    """
    uncertainty.check(robot, world)
    terrain = terrain_of(robot.as_terrain(world))
    share = risk.share if 0 < risk.share < 1 else TAIL
    drawn = uncertainty.draw(draws, HELD_OUT, actuators=robot.actuators)
    terrains = [robot.drawn_terrain(terrain, one) for one in drawn]
    outcomes = robot.simulate_in(terrains, draws=drawn, compute=compute, progress=progress)
    score = score or Score.first_of(robot)
    scores = [float(score.of(outcome)[0]) if str(outcome.status[0]) == OK else math.nan for outcome in outcomes]
    failed = sum(not math.isfinite(one) for one in scores)
    about = {"uncertain": uncertainty.text, "draws": draws, "failed": failed}
    if failed:
        return Judgement(spoken(about), about, True)
    document = {**about, "measure": score.name, "unit": score.unit, "risk": risk.text, "share": share}
    document |= {**({"stands_in": True} if score.stands_in else {}), **summary(scores, share)}
    return Judgement(spoken(document), document)


def spoken(document: Mapping[str, Any]) -> str:
    """What is told people of the document of a judgement over draws, what the risk names first."""
    if document["failed"]:
        return f"{document['failed']} of {document['draws']} held-out draws failed"
    names = {"mean": "mean", "cvar": f"CVaR {document['share']:g}", "worst": "worst"}
    first = document["risk"].partition(":")[0]
    parts = [
        f"{names[name]} {decimal(document[name])} (95 % interval {decimal(document[f'{name}_low'])} to "
        f"{decimal(document[f'{name}_high'])})"
        for name in sorted(names, key=lambda name: name != first)
    ]
    measure = document["measure"] + (", the first measure," if document.get("stands_in") else "")
    draws = document["draws"]
    told = f"{', '.join(parts)}, standard deviation {decimal(document['sd'])} {document['unit']}".rstrip()
    return f"{measure} over {draws} held-out draws: {told}"


def summary(scores: Sequence[float], share: float) -> dict[str, float]:
    """Mean, CVaR and worst of scores, each with its 95 % bootstrap interval, and their standard deviation.

    The interval of the worst is that of the worst of the draws, which goes no lower: others may be worse.
    """
    each = np.asarray(scores, float)
    picked = np.random.default_rng(0).integers(0, len(each), (RESAMPLES, len(each)))
    found: dict[str, float] = {"sd": float(each.std(ddof=1))}
    for name, part in (("mean", 1.0), ("cvar", share), ("worst", 0.0)):
        low, high = np.percentile(Risk(part).of(each[picked]), [2.5, 97.5])
        found |= {name: float(Risk(part).of(each)), f"{name}_low": float(low), f"{name}_high": float(high)}
    return found
