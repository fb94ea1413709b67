"""Uncertain quantities of a robot and its ground, random draws of them, and risk measures of scores over draws."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.robot import HERE, OK, Judgement, Outcome, Progress, Robot, World
from robots.tail_interval import RESAMPLES, has_interval, tail_interval
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
MOST = {"timing": 0.5}  # largest values of shares, where less than 1
TAIL = 0.2  # share of the worst draws in the CVaR of a judgement, unless the risk names one
JUDGED_DRAWS = 64  # held-out draws by which designs are judged
SEARCHED, HELD_OUT = 1, 2  # streams of random numbers: draws for searches, draws for judging designs afterwards


@dataclass(frozen=True)
class Perturbation:
    """One draw: deviations of friction, slope and actuators from their nominal values.

    Attributes:
        sliding: factor of the friction of sliding feet.
        gripping: factor of the friction of gripping feet, skin, seams and bladders.
        slope: angle added to the slope [degrees].
        levels: factors of the actuators' levels, one for each; empty for nominal levels.
        timing: factor of the durations of strokes and of the waits between them.
        most: largest factor that levels may have in any draw, with which time steps reckon, so that draws share these.
    """

    sliding: float = 1.0
    gripping: float = 1.0
    slope: float = 0.0
    levels: tuple[float, ...] = ()
    timing: float = 1.0
    most: float = 1.0

    @property
    def largest_level(self) -> float:
        """The largest factor that levels have in this draw, or may have in others of its uncertainty; 1 at least."""
        return max(self.most, 1.0, *self.levels)

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
        if terrain.props:
            rubbed["props"] = [dataclasses.replace(prop, rubbing=self.gripping) for prop in terrain.props]
        return dataclasses.replace(terrain, slope=self.tilted(terrain), **rubbed)

    def on(self, terrain: Terrain, own: Any) -> Terrain:
        """The terrain of this draw for robots with feet that grip or slide; a fluid is returned unchanged.

        ``own`` has the robot's friction by the names of a terrain's, which counts where the terrain has none.
        """
        if terrain.is_fluid:
            return terrain
        high = (own.high_friction if terrain.high_friction is None else terrain.high_friction) * self.gripping
        low = own.low_friction if terrain.low_friction is None else terrain.low_friction
        parts = {**friction_of_parts(own, self.gripping), **friction_of_parts(terrain, self.gripping)}
        return dataclasses.replace(
            terrain,
            slope=self.tilted(terrain),
            high_friction=high,
            low_friction=min(low * self.sliding, high),  # sliding feet never have more friction than gripping ones
            **parts,
        )


@dataclass(frozen=True)
class Uncertainty:
    """Half-widths of the intervals from which uncertain quantities are drawn, uniformly and independently.

    Attributes:
        friction: half-width of a common factor of sliding and gripping friction, 0 to 1.
        sliding: half-width of a factor of sliding friction alone, 0 to 1.
        gripping: half-width of a factor of gripping friction alone, 0 to 1.
        slope: half-width of the angle added to the slope, 0 to 45 degrees.
        levels: half-width of a factor of each actuator's level, 0 to 1, drawn for every actuator.
        timing: half-width of the factor of the durations of strokes and waits, 0 to 0.5.
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
        """Parse a text such as ``friction=20%,slope=1``; shares may also be written as ``0.2``.

        Raises:
            ValueError: if a quantity is unknown or given twice, or a value is not allowed.
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
        """Canonical text of the uncertainty, which :meth:`parse` reads."""
        given = [name for name in QUANTITIES if getattr(self, name)]
        return ",".join(f"{name}={getattr(self, name)!r}" for name in given)

    def check_ground(self, world: World) -> None:
        """Check that a world has the quantities of the ground that are to be drawn.

        Raises:
            ValueError: if it does not; names what is missing.
        """
        of_ground = [name for name in GROUND if getattr(self, name)]
        if not isinstance(world, Terrain):
            raise ValueError(f"uncertain: {self.text} is not allowed in {world.name}, which has no ground")
        if of_ground and world.is_fluid:
            told = f"uncertain: {self.text} is not allowed {world.where}, which has no ground"
            raise ValueError(f"{told}; leave out {', '.join(of_ground)}")
        if self.slope and world.is_wet:
            raise ValueError(f"uncertain: {self.text} is not allowed with water, which is level; leave out slope")
        if self.slope and abs(world.slope) + self.slope > STEEPEST:
            told = f"uncertain: {self.text} is not allowed {world.where}, as draws would be steeper than"
            raise ValueError(f"{told} {STEEPEST:g} degrees; give a smaller slope")

    def check(self, robot: Robot, world: World) -> None:
        """Check that a robot and its world have the quantities that are to be drawn.

        Raises:
            ValueError: if they do not; names what is missing.
        """
        self.check_ground(robot.as_terrain(world))
        for name in QUANTITIES:
            if getattr(self, name) and name not in robot.uncertain_in:
                lacking = "friction" if name == "friction" else "actuators" if name in DRIVE else f"{name} feet"
                raise ValueError(f"uncertain: {self.text} is not allowed; {robot.name} has no {lacking} to draw")

    @property
    def drives(self) -> bool:
        """Whether quantities of actuators are uncertain."""
        return any(getattr(self, name) for name in DRIVE)

    def draw(self, count: int, stream: int = SEARCHED, seed: int = 0, actuators: int = 0) -> list[Perturbation]:
        """Draw perturbations; those of one stream and seed are always the same, other streams are independent.

        Args:
            count: number of perturbations.
            stream, seed: stream of random numbers and its seed.
            actuators: number of actuators of the robot, for ``levels``.
        """
        each = np.random.default_rng((stream, seed)).uniform(-1.0, 1.0, (count, len(GROUND)))
        pair, sliding, gripping, slope = (each * [getattr(self, name) for name in GROUND]).T
        grounds = np.stack([(1 + pair) * (1 + sliding), (1 + pair) * (1 + gripping), slope], axis=1).tolist()
        # Separate streams, so that the ground does not depend on whether, and how many, actuators are uncertain.
        times = 1 + self.timing * np.random.default_rng((stream, seed, 1)).uniform(-1.0, 1.0, count)
        levels = np.random.default_rng((stream, seed, 2)).uniform(-1.0, 1.0, (count, actuators if self.levels else 0))
        told = zip(grounds, (1 + self.levels * levels).tolist(), times.tolist(), strict=True)
        return [
            Perturbation(low, high, tilt, tuple(reach), time, 1 + self.levels)
            for (low, high, tilt), reach, time in told
        ]


@dataclass(frozen=True)
class Risk:
    """Risk measure: combines scores over draws to one number, the mean of the worst share of them.

    Attributes:
        share: 1 for the mean of all draws, 0 for the worst draw, between for the conditional value at risk (CVaR).
    """

    share: float = 1.0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a risk measure: ``mean``, ``worst`` or ``cvar:SHARE``, such as ``cvar:0.2``.

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
        """Text of the risk measure, which :meth:`parse` reads."""
        return {1.0: "mean", 0.0: "worst"}.get(self.share, f"cvar:{shortest(self.share)}")

    def weights(self, scores: ArrayLike) -> Floats:
        """Weights of K scores, shape (..., K), which are also the derivatives of the result by the scores.

        The worst K times ``share`` scores, at least one, have equal weights; of a fraction the last counts in part.
        """
        scores = np.asarray(scores, float)
        count = scores.shape[-1]
        worst = max(self.share * count, 1.0)
        ranks = np.argsort(np.argsort(scores, axis=-1, kind="stable"), axis=-1, kind="stable")
        return np.asarray(np.clip(worst - ranks, 0.0, 1.0) / worst)

    def of(self, scores: ArrayLike) -> Floats:
        """Risk measure, shape (...), of scores, shape (..., K); NaN where a draw failed."""
        scores = np.asarray(scores, float)
        failed = ~np.isfinite(scores).all(axis=-1)
        return np.where(failed, np.nan, (self.weights(scores) * np.where(failed[..., None], 0, scores)).sum(axis=-1))


@dataclass(frozen=True)
class Score:
    """A score by which a robot is judged in one world; larger is better.

    Attributes:
        name: name, such as ``speed`` or ``minus energy``.
        unit: unit, such as ``BL/s``; empty for a plain number.
        of: function from an outcome to the values, shape (N,).
        stands_in: whether the robot's first measure replaces an objective that is not a single measure.
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
    """Judge a robot without free variables over draws that no search has used.

    The judgement has the mean, the CVaR and the worst of the scores.

    Args:
        robot: robot to judge.
        world: world in which it is judged.
        uncertainty: quantities that are drawn.
        risk: risk measure that the text reports first; its share is that of the CVaR, or ``TAIL`` if it has none.
        draws: number of draws.
        score: score by which it is judged, by default its first measure. A draw with a score that is not finite failed.
        compute: device, precision and threads.
        progress: called at intervals with the fraction done.

    Raises:
        ValueError: if the world or the robot does not have a quantity that is to be drawn.
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
    """Readable text of the document of a judgement over draws; the risk measure comes first."""
    if document["failed"]:
        return f"{document['failed']} of {document['draws']} held-out draws failed"
    names = {"mean": "mean", "cvar": f"CVaR {document['share']:g}", "worst": "worst"}
    first = document["risk"].partition(":")[0]
    parts = [
        f"{names[name]} {decimal(document[name])} ({_ends_told(document, name)} {decimal(document[f'{name}_low'])} to "
        f"{decimal(document[f'{name}_high'])})"
        for name in sorted(names, key=lambda name: name != first)
    ]
    measure = document["measure"] + (", the first measure," if document.get("stands_in") else "")
    draws = document["draws"]
    told = f"{', '.join(parts)}, standard deviation {decimal(document['sd'])} {document['unit']}".rstrip()
    return f"{measure} over {draws} held-out draws: {told}"


def _ends_told(document: Mapping[str, Any], name: str) -> str:
    return "of resampled draws" if interval_of(document, name) is None else "95 % interval"


def interval_of(document: Mapping[str, Any], name: str) -> tuple[float, float] | None:
    """Both ends of the 95 % interval of the mean, CVaR or worst in the document of a judgement; None if it has none."""
    share = {"mean": 1.0, "worst": 0.0}.get(name, document["share"])
    ends = document[f"{name}_low"], document[f"{name}_high"]
    return ends if has_interval(share, document["draws"]) else None


def summary(scores: Sequence[float], share: float) -> dict[str, float]:
    """Mean, CVaR and worst of scores, each with two ends, and the standard deviation of the scores.

    The ends are those of the 95 % interval, see :func:`tail_interval`. The worst draw alone has none: its ends are
    those between which the worst of 95 % of resamples is. They never go below it, although further draws may be worse:
    of 64, they hold the worst to be expected of as many others in about half of all cases.
    """
    each = np.asarray(scores, float)
    found: dict[str, float] = {"sd": float(each.std(ddof=1))}
    for name, risk in (("mean", Risk(1.0)), ("cvar", Risk(share)), ("worst", Risk(0.0))):
        low, high = tail_interval(each, risk.share) or _resampled(risk, each)
        found |= {name: float(risk.of(each)), f"{name}_low": low, f"{name}_high": high}
    return found


def _resampled(risk: Risk, scores: Floats) -> tuple[float, float]:
    """Between what a risk measure of 95 % of resamples of scores is."""
    picked = np.random.default_rng(0).integers(0, len(scores), (RESAMPLES, len(scores)))
    low, high = np.percentile(risk.of(scores[picked]), [2.5, 97.5])
    return float(low), float(high)
