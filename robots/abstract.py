"""Base class of robots: free parameters, measures, simulation and motion; and a robot with a fixed design.

The rest of the lab imports it from ``robots.robot``.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.abilities import Abilities
from robots.delegation import delegating
from robots.kind import KINDS, OWN_MEASURES_FIELD
from robots.outcome import Facts, Measure, Outcome, Place, Replay, World, checked_motion, checked_outcome
from robots.points import checked_design, checked_points
from robots.terrain_fields import check_taken
from robots.trial import HERE, Progress, Trial
from robots.world import terrain_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_record
from taichi_sim.base.foreign import staying
from taichi_sim.base.short_text import ShortText
from taichi_sim.base.variables import Variable

if TYPE_CHECKING:
    from robots.uncertainty import Perturbation
    from robots.view.motion import Motion

DESIGN_FORMAT = "morpholab-robot-design-1"  # of files by :meth:`Robot.save`
Parameter = Variable  # what is free of a robot
FRAMES = 1000  # of a motion, at most


class Robot(Abilities, ShortText):
    """Base class of robots: free parameters, measures by which designs are judged, and their simulation in a world.

    Points are arrays of shape (N, P): N designs, each a value for every parameter. A robot of which nothing is free
    has points of shape (N, 0). A kind defines ``kind``, ``measures`` and :meth:`run`; parameters and measures may be
    attributes. With :attr:`steps` and :meth:`motion` it can be shown, all else is optional.
    """

    kind: str
    parameters: tuple[Parameter, ...] = ()
    measures: tuple[Measure, ...]
    worlds: tuple[World, ...] = (Place(),)
    terrain_fields: tuple[str, ...] | None = None  # of a ``Terrain``, that it takes; None refuses others itself
    relaxable = False  # whether :meth:`run` judges what lies between true designs, if a trial's sharpness is finite
    differentiable = False  # whether :meth:`run` gives the gradients that a trial asks for
    has_table = False  # whether :meth:`table` gives this robot, nothing of it free, a table of pressures for a rig
    no_table_reason = ""  # why it gives none, where other robots of its kind have one; otherwise empty
    table_option = ""  # such as ``"--channels 8"``: option of its kind that has a search find designs with tables
    uncertain_in: tuple[str, ...] = ("slope",)  # which ``robots.uncertainty.QUANTITIES`` can be drawn of it
    actuators: int = 0  # whose levels can be drawn
    pictured = False  # whether searches draw the best design by :meth:`save_picture`
    curves: Mapping[str, str] = {}  # measures whose course in a search is worth a curve, and what to call them
    descriptors: Mapping[
        str, tuple[float, float]
    ] = {}  # what trials tell of kinds of designs, with its lowest and highest
    feels = False  # whether it has senses, whose readings :meth:`felt_over_time` gives
    horizons: tuple[int, ...] = ()  # lengths of trials that ``gradient-check`` looks at by default; see ``at_horizon``
    changeable: tuple[str, ...] = ()  # options of its kind that :meth:`changed` takes
    freeing: tuple[str, ...] = ()  # options that free more parameters, see ``robots.partly_fixed.freed``

    @property
    def name(self) -> str:
        """Name of the robot for people."""
        return KINDS.of(self).title

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Simulate N designs in a trial; the result of one must not depend on the others.

        Args:
            points: values of the P parameters of each design, shape (N, P), finite; they may lie beyond the bounds.
            trial: world, computation, and what to record and differentiate.
        """
        raise NotImplementedError

    def _tried(self, points: Floats, trial: Trial) -> Outcome:
        """Run the robot, and check what comes of it."""
        self._check_world(trial.world)
        measures = self.measures_in([trial.world])
        with staying():
            given = self.run(points.copy(), trial)
        return checked_outcome(given, self, measures, points.shape, trial.gradients)

    def _check_world(self, world: World) -> None:
        """Refuse a terrain with fields that the robot does not take, where it says which it takes."""
        if self.terrain_fields is not None:
            check_taken(terrain_of(world), self.terrain_fields)

    @property
    def footprint(self) -> tuple[float, float] | None:
        """Rear and front along the heading at the start, from the robot's origin [m]; None if unknown."""
        return None

    def measures_in(self, worlds: Sequence[World]) -> tuple[Measure, ...]:
        """Return the measures that the robot has in all of some worlds; by default the same everywhere."""
        return self.measures

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: "Sequence[Self]" = ()
    ) -> list[Outcome]:
        """Simulate N designs in several worlds; a kind may make one batch of them, with the same results.

        Args:
            points: checked values of the parameters, shape (N, P).
            worlds: where the designs are simulated.
            trial: computation, and what to record and differentiate.
            variants: of this robot, such as :meth:`perturbed` ones, one for each world; itself by default.
        """
        each = zip(variants or [self] * len(worlds), trial.parts(worlds), strict=True)
        return [robot._tried(points, part) for robot, part in each]

    def simulate(
        self,
        points: ArrayLike,
        world: World,
        *,
        compute: Compute = HERE,
        record_every: int | None = None,
        progress: Progress | None = None,
        sharpness: float = math.inf,
    ) -> Outcome:
        """Simulate N designs in a world, as one batch.

        Args:
            points: values of the P parameters of each design, shape (N, P).
            world: where the designs are simulated.
            compute: device, precision and threads.
            record_every: time steps between recorded poses, for ``Outcome.frames`` and motions; None for none.
            progress: called now and then with the fraction done.
            sharpness: how strongly mixtures of designs are pushed towards true ones, see ``Trial``.

        Raises:
            ValueError: for a value that is not allowed; a design that fails is not an error but has a status.
        """
        return self._tried(self.points(points), Trial(world, compute, record_every, progress, (), sharpness))

    def readings(self, points: ArrayLike, world: World, samples: int, compute: Compute = HERE) -> Floats:
        """Read the S sensors of N designs, shape (N, P), in a world, at most ``samples`` times T: shape (N, S, T).

        Raises:
            ValueError: if this robot feels nothing.
        """
        if not self.feels:
            raise ValueError(f"robot: {self.name} feels nothing")
        self._check_world(world)
        found = self.felt_over_time(self.points(points), world, compute)
        return found[:, :, :: -(-found.shape[2] // whole_number("samples", samples, 1))]

    def felt_over_time(self, points: Floats, world: World, compute: Compute) -> Floats:
        """Return all readings of the S sensors of N designs, shape (N, P), over time in a world, shape (N, S, T)."""
        raise NotImplementedError

    def simulate_in(
        self,
        worlds: Sequence[World],
        *,
        draws: "Sequence[Perturbation]" = (),
        compute: Compute = HERE,
        progress: Progress | None = None,
    ) -> list[Outcome]:
        """Simulate a robot without free parameters in several worlds.

        With draws, one for each world, the robot is :meth:`perturbed` by them.
        """
        if not worlds:
            return []
        variants = [self.perturbed(drawn) for drawn in draws]
        return self.run_in(self.points(()), worlds, Trial(worlds[0], compute, progress=progress), variants)

    def differentiate(
        self,
        points: ArrayLike,
        world: World,
        *,
        measures: Sequence[str] | str | None = None,
        compute: Compute = HERE,
        progress: Progress | None = None,
        sharpness: float = math.inf,
        gradient_horizon: float | None = None,
    ) -> Outcome:
        """Simulate N designs in a world, with derivatives of measures (by default the first one) by the parameters.

        ``sharpness`` and ``gradient_horizon`` are those of :class:`Trial`.

        Raises:
            ValueError: if the robot has no gradients or these no horizon, and for measures that are unknown or have no
                derivatives.
        """
        if not self.differentiable:
            told = "choose a method that needs none" if self.parameters else "nothing of it is free"
            raise ValueError(f"robot: {KINDS.of(self).title} has no gradients; {told}")
        given = (measures,) if isinstance(measures, str) else measures
        names = tuple(given) if given is not None else (self.measures[0].name,)
        known = [measure.name for measure in self.measures_in([world])]
        if unknown := [name for name in names if name not in known]:
            raise ValueError(f"measures: {unknown[0]!r} is unknown; there are {', '.join(known)}")
        if gradient_horizon is not None:
            KINDS.of(self).check_gradient_horizon(gradient_horizon)
        trial = Trial(world, compute, None, progress, names, sharpness, gradient_horizon)
        outcome = self._tried(self.points(points), trial)
        if without := [name for name in names if name not in outcome.gradients]:
            raise ValueError(f"measures: {without[0]} has no derivatives; there are {', '.join(outcome.gradients)}")
        return dataclasses.replace(outcome, gradients={name: outcome.gradients[name] for name in names})

    @property
    def steps(self) -> int:
        """Number of time steps in a trial, from which the interval between recorded poses follows.

        Raises:
            ValueError: if robots of this kind cannot be shown.
        """
        raise ValueError(f"robot: {KINDS.of(self).title} cannot be shown")

    @property
    def has_motion(self) -> bool:
        """Whether the robot can be shown in motion: its kind defines :attr:`steps` and :meth:`motion`."""
        own = type(self)
        return own.motion is not Robot.motion and getattr(own, "steps", None) is not Robot.steps

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """Build the motion of a robot without free parameters, from an outcome with recorded frames.

        Raises:
            ValueError: if robots of this kind cannot be shown.
        """
        raise ValueError(f"robot: {KINDS.of(self).title} cannot be shown")

    def replay(
        self,
        point: ArrayLike,
        world: World,
        *,
        frames: int = FRAMES,
        name: str = "",
        compute: Compute = HERE,
        progress: Progress | None = None,
    ) -> Replay:
        """Simulate one design, shape (P,), and build its motion, with at most ``frames`` (2 or more) recorded poses.

        Raises:
            ValueError: if the design is no robot, or robots of this kind cannot be shown.
        """
        fixed, name = self.design(point) if self.parameters else self, name or self.name
        every = max(1, -(-fixed.steps // (frames - 1)))
        outcome = fixed.simulate((), world, compute=compute, record_every=every, progress=progress)
        if outcome.reason[0]:
            raise ValueError(f"source: {name} is no robot: {outcome.reason[0]}")
        motion = checked_motion(
            fixed.motion(outcome, world, name), fixed.robot if isinstance(fixed, FixedRobot) else fixed
        )
        return Replay(outcome, motion.every(-(-len(motion.times) // frames)), fixed.title_of(outcome, world))

    def design(self, point: ArrayLike) -> "Robot":
        """Return the robot of one point, shape (P,), with nothing free; by default a :class:`FixedRobot`."""
        return FixedRobot(self, point)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of one point, shape (P,), to a file: always the same bytes for the same point.

        Raises:
            ValueError: for a value that its parameter does not take.
        """
        names = [parameter.name for parameter in self.parameters]
        values = dict(zip(names, checked_design(self.parameters, self.points(point)[0]).tolist(), strict=True))
        record = {"kind": self.kind, "robot": self.describe(), "values": values}
        write_record(path, DESIGN_FORMAT, record)

    def describe(self) -> dict[str, Any]:
        """Describe everything that results depend on, as JSON values; by default the fields of the dataclass."""
        return dataclasses.asdict(self) if dataclasses.is_dataclass(self) and not isinstance(self, type) else {}

    @property
    def start(self) -> Floats:
        """Point of the parameters before any search, shape (P,)."""
        return np.array([parameter.first for parameter in self.parameters])

    def points(self, given: ArrayLike) -> Floats:
        """Convert points to an array of shape (N, P), and check them.

        Raises:
            ValueError: for another shape, or numbers that are not finite.
        """
        return checked_points(self.parameters, given)

    def facts(self) -> Facts:
        """Rows for a report about properties that all designs share."""
        return [("Robot", self.name)]

    def columns(self, points: ArrayLike) -> dict[str, list[str]]:
        """Columns of a table of several designs, shape (N, P): values by name."""
        points = self.points(points)
        return {p.name: [f"{value:.4g}" for value in points[:, n]] for n, p in enumerate(self.parameters)}

    def spoken(self, outcome: Outcome) -> str:
        """Summarise the first design of a successful outcome, as text for people."""
        return ", ".join(measure.value(float(outcome.measures[measure.name][0])) for measure in self.measures)

    def changed(self, options: Mapping[str, Any]) -> "Robot":
        """Return this robot, from a run or a saved design, with other values of its kind's options.

        Raises:
            ValueError: if a design settles what an option would change.
        """
        told = (OWN_MEASURES_FIELD,) if hasattr(self, OWN_MEASURES_FIELD) else ()  # changes nothing of what it does
        for name in options:
            if name not in (*told, *self.changeable):
                raise ValueError(f"{name}: {self.name} has its own; leave it out")
        return dataclasses.replace(self, **options) if options else self  # type: ignore[type-var]


@delegating("robot", {"points": "_completed", "point": "_completed_one"})
class FixedRobot(Robot):
    """The robot of one point: nothing of it is free. It asks the robot, at that point, all that is not defined here.

    A kind that tells more of its designs, such as a gait table, has :meth:`Robot.design` give a robot of its own.
    """

    parameters = ()
    differentiable = False  # by parameters, of which there are none
    # What is told of a robot of which nothing is free, the robot itself could only tell of another design.
    has_table, pictured, can_be_judged = False, False, False
    judge, table, rig_report, save_picture = Robot.judge, Robot.table, Robot.rig_report, Robot.save_picture
    # These lead to what is defined here.
    start, points, differentiate = Robot.start, Robot.points, Robot.differentiate
    simulate, simulate_in = Robot.simulate, Robot.simulate_in

    def __init__(self, robot: Robot, point: ArrayLike) -> None:
        """Fix a robot at a point, shape (P,)."""
        self.robot, self.point = robot, robot.points(point)[0].copy()

    def _completed(self, points: ArrayLike) -> Floats:
        """Points of the robot, shape (N, P), for those of this one, shape (N, 0)."""
        return np.tile(self.point, (len(self.points(points)), 1))

    def _completed_one(self, point: ArrayLike) -> Floats:
        """The point of the robot, shape (P,), for that of this one, shape (0,)."""
        return self._completed(point)[0]

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Try the design, as often as there are points, shape (N, 0)."""
        return self.robot.simulate(
            self._completed(points),
            trial.world,
            compute=trial.compute,
            record_every=trial.record_every,
            progress=trial.progress,
            sharpness=trial.sharpness,
        )

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: Sequence[Self] = ()
    ) -> list[Outcome]:
        """Try the design in several worlds, in the robot's own way, which may make one batch of them."""
        plain = dataclasses.replace(trial, gradients=())
        return self.robot.run_in(self._completed(points), worlds, plain, [variant.robot for variant in variants])

    def perturbed(self, drawn: "Perturbation") -> Self:
        """The design with what a draw says of it."""
        return type(self)(self.robot.perturbed(drawn), self.point)

    def at_horizon(self, length: int) -> tuple[str, Self]:
        """The design in trials of another length."""
        spoken, robot = self.robot.at_horizon(length)
        return spoken, type(self)(robot, self.point)

    def changed(self, options: Mapping[str, Any]) -> Self:
        """The design of the robot with other values of options."""
        return type(self)(self.robot.changed(options), self.point)

    def design(self, point: ArrayLike) -> Self:
        """Itself, as there is no other design of it."""
        self.points(point)
        return self

    def describe(self) -> dict[str, Any]:
        """All that results depend on: the robot, and the values that are fixed."""
        return {"robot": self.robot.describe(), **self._values}

    def document(self) -> dict[str, Any]:
        """What the robot tells machines, and the values that are fixed."""
        return {**self.robot.document(), **self._values}

    @property
    def _values(self) -> dict[str, Any]:
        """Values that are fixed, by the names of the parameters."""
        names = [parameter.name for parameter in self.robot.parameters]
        return {"values": dict(zip(names, self.point.tolist(), strict=True))}
