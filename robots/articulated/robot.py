"""Descriptions of articulated robots: the model of a file, and what commands its drives."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from robots.articulated.factors import Factor
from robots.articulated.measures import MEASURES, NEWER, OF_TREES, measures_of, of_trees
from robots.articulated.records import USUAL_RATE, record_of
from robots.articulated.reflexes import PARTS, DriveReflexes, network_of
from robots.articulated.senses import checked_place
from robots.articulated.simulation import ArticulatedResult, anatomy_of, felt_over_time, try_points, unsettled
from robots.articulated.variants import SCALES, Variants
from robots.articulated.worlds import GROUND, check_gradients, ground_place
from robots.outcome import recorded
from robots.own_measures import OwnMeasure, checked_own_measures
from robots.robot import Facts, Measure, Outcome, Parameter, Robot, Trial, World
from robots.world import Terrain
from taichi_sim import rigid
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import counted
from taichi_sim.rigid import Network, Senses, Tree
from taichi_sim.rigid.model.assembly import Model
from taichi_sim.rigid.model.files import Reading, parse_model
from taichi_sim.rigid.model.urdf_drives import Gains, checked_gains, spoken_gains

if TYPE_CHECKING:
    from robots.uncertainty import Perturbation
    from robots.view.motion import Motion

Controller = Literal["rhythm", "network"]
LONGEST = 3600.0  # s
READING = tuple(Reading.__annotations__)  # settings that say how the file is read
STEADY = 16  # commands of a cycle at least, with which coupled oscillators are stable


@dataclass(frozen=True, eq=False, repr=False)
class ArticulatedRobot(Robot):
    """A robot from an MJCF or URDF file, a tree of rigid bodies and hinges, with the controller of its drives.

    A command from -1 to 1 means a drive's whole range: an angle or a rate, as the file says. By a rhythm it is

        amplitude sin(2 pi (frequency t + phase)) + (1 - amplitude) offset,

    with one frequency for all drives, and reflexes may change it. By a network it is tanh(its last value + the sum of
    weights times sensors).

    Attributes:
        text: content of the file, so that the description needs no other file.
        name: name of the robot for people.
        controller: ``"rhythm"`` or ``"network"``; it decides which parameters are free.
        duration: of a trial [s].
        heading: direction in which distance counts, seen from above, anticlockwise from x [degrees].
        slowest: lowest frequency of a rhythm [Hz], which a network has not.
        quickest: highest frequency of a rhythm [Hz].
        command_rate: how often commands of a rhythm change [Hz], at most once a time step; None: 50 Hz, or that.
        light: place of a light [m], seen from the base's centre by networks, reflexes and environments; None for none.
        friction: coefficient of friction; infinite: without a cone, which has gradients; None: that of the file, or 1.
        slip: speed of a point on the ground for each newton of friction [m/(N s)]; None: so little that robots of any
            weight hold, see ``taichi_sim.rigid.Physics``.
        angles: of hinges at the start, by their joints' names [rad]; else as in the file.
        fixed: whether a URDF robot's base is fixed to the world whatever its file says; MJCF says so itself.
        speed: of position drives that hold rates [1/s]; None: those of MJCF are servos, see ``files.Reading``.
        fastest: rate of drives at full command [rad/s]; None: those of MJCF have the torque of the file.
        time_step: of the simulation [s]; None: that of the file, or 2 ms.
        reflexes: what it feels, and how that changes its rhythm; None for a robot that feels nothing.
        seed: of the noise of its senses.
        own_measures: of the user, see ``robots.own_measures``; installed ones may be given by name.
        body_sizes: sizes of bodies, by their names or patterns of these such as ``thigh*``: a factor, or one that is
            ``Free``, for all that match; see ``taichi_sim.rigid.model.scaling``.
        servos: gains of drives of URDF that are servos, by names of joints or patterns, see ``files.Reading``.
        hinge_stiffness: stiffness of servos and springs, by names of the bodies that their hinges carry or patterns of
            these: a factor, or one that is ``Free``; see ``taichi_sim.rigid.model.actuation``.
        drive_torque: largest torques of drives, in the same way.
        model: what the file describes; made of the text.

    Raises:
        ValueError: if a value is not allowed, or the text is no model that has drives.
    """

    text: str
    name: str = "articulated robot"
    controller: Controller = "rhythm"
    duration: float = 5.0
    heading: float = 0.0
    slowest: float = 0.5
    quickest: float = 2.0
    command_rate: float | None = None
    light: tuple[float, float, float] | None = None
    friction: float | None = None
    angles: Mapping[str, float] = field(default_factory=dict)
    fixed: bool = False
    speed: float | None = None
    fastest: float | None = None
    reflexes: DriveReflexes | None = None
    time_step: float | None = None
    slip: float | None = None
    seed: int = 0
    own_measures: tuple[OwnMeasure, ...] = ()
    body_sizes: Mapping[str, Factor] = field(default_factory=dict)
    servos: Mapping[str, Gains] = field(default_factory=dict)
    hinge_stiffness: Mapping[str, Factor] = field(default_factory=dict)
    drive_torque: Mapping[str, Factor] = field(default_factory=dict)
    model: Model = field(init=False, repr=False)

    kind = "articulated"
    worlds = (GROUND,)
    differentiable = True
    horizons = (1, 2, 4)
    changeable = ("duration", "friction", "slip", "time_step")  # how a design is tried, not what it is
    freeing = (*(scale.field for scale in SCALES), "reflexes")

    def __post_init__(self) -> None:
        checks.choice("controller", self.controller, get_args(Controller))
        checks.number("duration", self.duration, 1e-3, LONGEST, "s")
        checks.number("heading", self.heading, unit="degrees")
        checks.number("slowest", self.slowest, 1e-3, unit="Hz")
        checks.number("quickest", self.quickest, 1e-3, unit="Hz")
        if self.command_rate is not None:
            checks.number("command_rate", self.command_rate, 1e-3, unit="Hz")
        checks.flag("fixed", self.fixed)
        checks.whole_number("seed", self.seed, 0)
        names = [measure.name for measure in MEASURES if measure.name not in NEWER]
        object.__setattr__(self, "own_measures", checked_own_measures(self.own_measures, names))
        if self.quickest <= self.slowest:
            raise ValueError(f"quickest: {self.quickest:g} Hz is not allowed; give more than slowest, {self.slowest:g}")
        if self.friction is not None and self.friction != math.inf:
            checks.number("friction", self.friction, 0.0, checks.MOST_FRICTION)
        if self.slip is not None:
            checks.positive("slip", self.slip)
        if self.light is not None:
            object.__setattr__(self, "light", checked_place("light", self.light))
        object.__setattr__(self, "servos", checked_gains(self.servos))
        model = parse_model(self.text, **self.reading)
        object.__setattr__(self, "model", model)
        for scale in SCALES:
            object.__setattr__(self, scale.field, scale.checked(getattr(self, scale.field)))
        _ = self.variants  # which finds bodies and hinges
        self._check_command_rate()
        if not self.drives:
            raise ValueError("model: no hinge of it has a drive; give actuators (MJCF) or limits with effort (URDF)")
        if self.controller == "network" and not self.senses.count:
            raise ValueError("controller: a network needs sensors; give touch sensors in the model, or a light")
        if self.reflexes is not None:
            self._check_reflexes(self.reflexes)

    def _check_command_rate(self) -> None:
        """Refuse commands of a rhythm that change more than once a time step."""
        step = self.physics.time_step
        rate = self.command_rate or 0.0
        if self.controller == "rhythm" and rate * step > 1 + 1e-9:
            raise ValueError(
                f"command_rate: {rate:g} Hz is not allowed with time steps of {step:g} s; give at most "
                f"{1 / step:g} Hz, or a shorter time_step"
            )

    def _check_reflexes(self, reflexes: DriveReflexes) -> None:
        """Refuse reflexes without a rhythm, and what they cannot feel or keep up with."""
        if self.controller != "rhythm":
            raise ValueError("reflexes: not allowed beside a network; give them with a rhythm")
        network_of(reflexes, anatomy_of(self))
        slowest, rate = STEADY * self.quickest, 1 / (self.hold * self.physics.time_step)
        if reflexes.kind == "oscillators" and slowest > rate * (1 + 1e-9):
            raise ValueError(f"command_rate: {rate:g} Hz is not allowed; give {slowest:g} or more")

    @property
    def reading(self) -> Reading:
        """How the file is read."""
        return cast(Reading, {name: getattr(self, name) for name in READING})

    @property
    def rhythm_size(self) -> int:
        """Number of the parameters that belong to the rhythm."""
        return 1 + len(PARTS) * len(self.drives)

    @property
    def weights_fixed(self) -> bool:
        """Whether the weights of the reflexes, if there are any, are fixed, not free."""
        return self.reflexes is None or self.reflexes.weights is not None

    @cached_property
    def variants(self) -> Variants:
        """Factors on sizes of bodies and on the actuation of hinges; free ones follow all other parameters."""
        return Variants.of(self.model.tree, {scale.field: getattr(self, scale.field) for scale in SCALES})

    @cached_property
    def tree(self) -> Tree:
        """The robot itself, with free factors as they start; ``model.tree`` is that of the file."""
        return self.variants.tree_of(self.variants.start)

    def split(self, points: Floats) -> tuple[Floats, Floats]:
        """Split points, (N, P), into what commands the drives, and the K free factors of bodies and hinges."""
        count = points.shape[-1] - len(self.variants.free)
        return points[..., :count], points[..., count:]

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of the drives, in the order of commands."""
        return self.model.commands

    @property
    def senses(self) -> Senses:
        """Sensors: the touch sensors of the file, and a light sensor at the base's centre if there is a light."""
        eyes = [] if self.light is None else [(self.model.tree.bodies[0].name, (0.0, 0.0, 0.0))]
        return Senses(self.model.senses.touch, eyes)

    @cached_property
    def physics(self) -> rigid.Physics:
        """Physical world: time step and gravity of the model, and the friction and slip of the robot's fields."""
        own = self.model.world
        friction = own.friction if self.friction is None else float(self.friction)
        return rigid.Physics(own.time_step, own.gravity, self.slip, friction, own.error_reduction, own.integration)

    @property
    def network(self) -> Network:
        """Network of neurons that remember their last values, like those of the quadrupeds."""
        return Network()

    @property
    def steps(self) -> int:
        """Number of time steps in a trial."""
        return max(1, round(self.duration / self.physics.time_step))

    @property
    def lasts(self) -> float:
        """Time of a trial [s]."""
        return self.steps * self.physics.time_step

    @property
    def hold(self) -> int:
        """Number of time steps for which each command of a rhythm is kept."""
        return max(1, round(1 / ((self.command_rate or USUAL_RATE) * self.physics.time_step)))

    @property
    def direction(self) -> Floats:
        """The heading as a unit vector, shape (3,)."""
        angle = math.radians(self.heading)
        return np.array([math.cos(angle), math.sin(angle), 0.0])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Free parameters: a rhythm's frequency and numbers of each drive, or a network's weights; then factors."""
        if self.controller == "network":
            sensors = [*(f"touch {name}" for name in self.senses.touch), *(["light"] if self.light else [])]
            names = [f"{sensor} to {drive}" for sensor in sensors for drive in self.drives]
            return *(Parameter(name, -1.0, 1.0, step=0.05) for name in names), *self.variants.parameters
        ranges = {"amplitude": (0.0, 1.0), "phase": (0.0, 1.0), "offset": (-1.0, 1.0)}
        span = self.quickest - self.slowest
        found = [Parameter("frequency", self.slowest, self.quickest, step=0.1 * span, unit="Hz")]
        for drive in self.drives:
            for part, (low, high) in ranges.items():
                kind: Literal["angle", "continuous"] = "angle" if part == "phase" else "continuous"
                found.append(Parameter(f"{drive}_{part}", low, high, kind, 0.1 * (high - low)))
        if self.reflexes is not None and not self.weights_fixed:
            most, count = self.reflexes.limit, network_of(self.reflexes, anatomy_of(self)).weight_count
            found += [Parameter(f"reflex_{n + 1}", -most, most, step=0.1 * most, start=0.0) for n in range(count)]
        return *found, *self.variants.parameters

    @property
    def measures(self) -> tuple[Measure, ...]:  # type: ignore[override]
        """Measures of the robot: what it does and is made of, and users' own measures."""
        own = {measure.name for measure in self.own_measures}
        return *(measure for measure in measures_of(self.model.tree) if measure.name not in own), *self.own_measures

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of one point, without own measures, as a robot needs no package."""
        Robot.save(replace(self, own_measures=()), point, path)

    def describe(self) -> dict[str, Any]:
        """Describe the robot as JSON values, from which :func:`robot_of_record` rebuilds it."""
        return record_of(self)

    def design(self, point: ArrayLike) -> Robot:
        """The robot of one point, whose speed can be judged."""
        from robots.articulated.robustness import ArticulatedDesign

        return ArticulatedDesign(self, point)

    def save_model(self, point: ArrayLike, path: Path) -> list[str]:
        """Write the robot's file with bodies and hinges of a design; return what it does not tell of them."""
        from robots.articulated.export import save_model

        return save_model(self, point, path)

    def save_commands(self, point: ArrayLike, path: Path) -> None:
        """Write the angles and rates that a design tells its drives over time."""
        from robots.articulated.export import save_commands

        save_commands(self, point, path)

    @property
    def uncertain_in(self) -> tuple[str, ...]:  # type: ignore[override]
        """Quantities that can be uncertain: the slope, and friction if it is finite."""
        return ("friction", "slope") if math.isfinite(self.physics.friction) else ("slope",)

    def perturbed(self, drawn: "Perturbation") -> "ArticulatedRobot":
        """Return this robot with its friction multiplied by a drawn factor."""
        return self if drawn.gripping == 1 else replace(self, friction=self.physics.friction * drawn.gripping)

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Simulate the robot at N points, with the gradients of measures if wanted."""
        found = try_points(self, points, trial)
        slopes = dict(found.gradients)
        if found.gradient is not None:
            slopes["speed"] = found.gradient / self.lasts
        measures = {
            "speed": found.distance / self.lasts,
            "distance": found.distance,
            "energy": found.energy,
            **{name: of_trees(name, found.trees, len(points)) for name in OF_TREES},
            **found.own,
        }
        measures = {measure.name: measures[measure.name] for measure in self.measures}
        frames = recorded(found.runs[0].frames)
        if frames:
            frames["angles"] = frames["angles"] + [hinge.rest for hinge in self.model.tree.hinges]
        return Outcome(measures, found.status, steps=found.steps, gradients=slopes, frames=frames, result=found)

    def doubts_about(self, outcome: Outcome) -> tuple[str, ...]:
        """Steps in which contacts or drives did not settle."""
        return unsettled(outcome.result) if isinstance(outcome.result, ArticulatedResult) else ()

    def check_gradients(self, world: World) -> None:
        """Refuse Coulomb friction, which has no derivatives."""
        check_gradients(self, world)

    @property
    def sees(self) -> bool:
        """Whether a light that it has changes what it does by itself."""
        return self.controller == "network" or (self.reflexes is not None and "light" in self.reflexes.senses)

    @property
    def feels(self) -> bool:  # type: ignore[override]
        """Whether the robot has reflexes."""
        return self.reflexes is not None

    def felt_over_time(self, points: Floats, world: World, compute: Compute) -> Floats:
        """Return what the robot's S sensors read at N points, shape (N, P), at T decisions, shape (N, S, T)."""
        return felt_over_time(self, points, world, compute)

    def as_terrain(self, world: World) -> World:
        """Convert the level ground of earlier versions to a flat terrain; other worlds are terrains already."""
        return world if isinstance(world, Terrain) else GROUND

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """Build the motion of the robot, with its sensors and commands, from an outcome with recorded frames."""
        from robots.articulated.motion import motion_of

        (run,) = outcome.result.runs
        return motion_of(self, run.frames, world, name=name, tree=outcome.result.trees[0])

    def facts(self) -> Facts:
        """Rows for a report: body, drives and trial."""
        tree, masses, physics = self.tree, self.tree.masses, self.physics
        slip = "" if physics.slip is None else f", points that hold slip at {physics.slip:g} m/s for each newton"
        return [
            ("Robot", f"{self.name}: {(masses > 0).sum()} bodies on {len(tree.hinges)} hinges, {masses.sum():.3g} kg"),
            ("Driven", f"{', '.join(self.drives)}, by a {self.controller}"),
            *([("Reflexes", self.reflexes.spoken)] if self.reflexes else []),
            *([("Bodies", f"sizes {self.variants.sizes.spoken}")] if self.body_sizes else []),
            *([("Servos", spoken_gains(self.servos))] if self.servos else []),
            *([("Hinges", f"stiffness {self.variants.stiffness.spoken}")] if self.hinge_stiffness else []),
            *([("Drives", f"largest torques {self.variants.torques.spoken}")] if self.drive_torque else []),
            ("Trial", f"{self.duration:g} s; distance along {self.heading:g}°"),
            ("Time step", f"{1e3 * physics.time_step:g} ms"),
            ("Floor", f"friction {physics.friction:g}{slip}"),
        ]

    def facts_of(self, point: ArrayLike) -> Facts:
        """What a design with free sizes weighs."""
        _, (factors,) = self.split(self.points(point))
        return [("Mass", f"{self.variants.tree_of(factors).masses.sum():.3g} kg")] if self.variants.sizes.free else []

    @property
    def footprint(self) -> tuple[float, float]:
        """Positions along the heading of the rear and front of what may touch the ground, from its origin [m]."""
        centres, radii = self.tree.balls()
        along = (centres - ground_place(self)) @ self.direction
        return float((along - radii).min()), float((along + radii).max())

    def at_horizon(self, length: int) -> tuple[str, "ArticulatedRobot"]:
        """Return a label and the robot with a trial of ``length`` seconds."""
        return counted(length, "second"), replace(self, duration=float(length))
