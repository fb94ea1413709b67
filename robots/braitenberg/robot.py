"""What Braitenberg vehicles offer to commands, searches, views and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.braitenberg.body import BASELINE, CONTROLLERS, FORMAT, HALF_SIDE, VehicleBody
from robots.braitenberg.experiment import PUBLISHED, batch_of, contralateral
from robots.braitenberg.sweeps import sweep
from robots.environments import Environment
from robots.robot import HERE, Facts, Measure, Outcome, Parameter, Picture, Replay, Robot, Trial, World
from taichi_sim import vehicle
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import built, choice, known_names, numbers, whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import read_record, write_record
from taichi_sim.base.short_text import counted
from taichi_sim.vehicle import VehicleBatch, VehicleTask

if TYPE_CHECKING:
    from robots.view.motion import Motion

STEP = 0.1  # of a mutation, part of a parameter's range
WEIGHTS = 41  # of a success matrix, along each side


@dataclass(frozen=True, eq=False, repr=False)
class VehicleRobot(Robot):
    """A vehicle's controller, alone or with the places of its sensors.

    Parameters: x and y of each sensor, ``l1x``, ``l1y``, ... [m], unless the body is fixed; then the weights, ``w1``
    and ``w2`` of the contralateral controller, or ``w11``, ``w12``, ... of the full matrix (motor, sensor).

    Attributes:
        body: fixed body; None lets the sensors be placed.
        controller: ``"contralateral"``, each sensor drives the motor of the other side, or ``"full"``.
        sensors: how many, if the body is free; contralateral needs two.
        task: environments, radius, time step and steps.
        matrix: controller of one vehicle with a fixed body, shape (2, S), see :func:`one_vehicle`; None lets weights
            be found.
    """

    body: VehicleBody | None = None
    controller: str = CONTROLLERS[0]
    sensors: int = 2
    task: VehicleTask = PUBLISHED
    matrix: Floats | None = None

    kind = "vehicle"
    measures = (
        Measure("approach", "m", "minus the smallest distance from the light"),
        Measure("closest", "m", "smallest distance from the light"),
        Measure("solved", "", "whether the light is reached"),
    )
    differentiable = True
    feels = True
    horizons = (100, 300, 1000)

    def __post_init__(self) -> None:
        choice("controller", self.controller, CONTROLLERS)
        if self.body is not None:
            object.__setattr__(self, "sensors", len(self.body.sensors))
        object.__setattr__(self, "sensors", whole_number("sensors", self.sensors, 1))
        if self.sensors != 2 and self.controller == "contralateral":
            raise ValueError(f"sensors: {self.sensors} is not allowed with a contralateral controller; give 2")

    @property
    def name(self) -> str:
        """What people call it: one vehicle by the number of its body, if that is on the published grid."""
        if self.body is None or self.matrix is None:
            return super().name
        return "vehicle" if self.body.design is None else f"vehicle {self.body.design}"

    @property
    def worlds(self) -> tuple[World, ...]:  # type: ignore[override]
        """The environments of the task."""
        return tuple(Environment(number) for number in range(1, len(self.task.starts) + 1))

    @property
    def weight_names(self) -> list[str]:
        """Names of the weights."""
        if self.controller == "contralateral":
            return ["w1", "w2"]
        return [f"w{motor}{j}" for motor in (1, 2) for j in range(1, self.sensors + 1)]

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Sites, if they are free, and weights; searches of sites begin at the canonical body."""
        if self.matrix is not None:
            return ()
        sites = [] if self.body else [f"l{j}{axis}" for j in range(1, self.sensors + 1) for axis in "xy"]
        usual = np.resize(np.ravel(BASELINE.sensors), len(sites)).tolist()
        span, places = 2 * HALF_SIDE, zip(sites, usual, strict=True)
        return (
            *(Parameter(n, -HALF_SIDE, HALF_SIDE, step=span * STEP, unit="m", start=at) for n, at in places),
            *(Parameter(name, -1.0, 1.0, step=2 * STEP, start=1.0) for name in self.weight_names),
        )

    def split(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Sites, shape (N, S, 2), and controllers, shape (N, 1, 2, S), of points, shape (N, P)."""
        points = self.points(points)
        count, sites = len(points), 0 if self.body else 2 * self.sensors
        if self.body is None:
            places = points[:, :sites].reshape(count, -1, 2)
        else:
            places = np.broadcast_to(self.body.sensors, (count, self.sensors, 2))
        if self.matrix is not None:
            return places, np.broadcast_to(self.matrix, (count, 1, 2, self.sensors))
        weights = points[:, sites:]
        if self.controller == "contralateral":
            return places, contralateral(weights)[:, None]
        return places, weights.reshape(count, 1, 2, self.sensors)

    def batch(self, points: ArrayLike) -> VehicleBatch:
        """Bodies and controllers of points, shape (N, P)."""
        sites, controllers = self.split(points)
        return batch_of([VehicleBody(each) for each in sites], controllers)

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Drive in one environment, with the gradients of the distances from the light if wanted.

        With ``record_every`` the frames are ``poses`` and ``readings``.
        """
        task, batch, compute = self.task_in(trial.world), self.batch(points), trial.compute.options
        if trial.gradients:
            found = vehicle.differentiate(batch, task, **compute, progress=trial.progress)
            slopes = self.slopes(found)[:, 0]
            return Outcome(_measures(found.closest[:, 0, 0], task), gradients={"approach": -slopes, "closest": slopes})
        done = vehicle.rollout(batch, task, until="closest", **compute, progress=trial.progress)
        result, frames = None, {}
        if trial.record_every is not None:
            result = vehicle.trace(batch, task, every=trial.record_every, **compute)
            frames = {name: getattr(result, name) for name in ("times", "poses", "readings")}
        closest = done.closest[:, 0, 0]
        status = np.where(done.diverged[:, 0, 0] & ~(closest < task.radius), "diverged", "ok")
        steps = np.full(len(closest), task.steps)
        return Outcome(_measures(closest, task), status, steps=steps, frames=frames, result=result)

    def readings(self, points: ArrayLike, world: World, samples: int, compute: Compute = HERE) -> Floats:
        """Light at the sensors of N vehicles over time [1/m^2], shape (N, S, T)."""
        task = self.task_in(world)
        found = vehicle.trace(self.batch(points), task, every=-(-task.steps // samples), **compute.options)
        return np.asarray(found.readings[:, 0, 0], float)

    def slopes(self, found: Any) -> Floats:
        """d closest / d parameter of a ``VehicleGradient`` of one controller a body, shape (N, E, P)."""
        by_weights = found.of_closest.controllers[:, 0]
        if self.controller == "contralateral":
            by_weights = np.diagonal(by_weights, axis1=-2, axis2=-1)
        by = [] if self.body else [found.of_closest.sites[:, 0]]
        shape = found.closest[:, 0].shape
        return np.concatenate([x.reshape(*shape, -1) for x in (*by, by_weights)], axis=-1)

    def task_in(self, world: World) -> VehicleTask:
        """The task in one of its environments.

        Raises:
            ValueError: if it has no such environment.
        """
        count = len(self.task.starts)
        place = Environment.parse(world.name, count).number - 1
        return replace(self.task, starts=self.task.starts[[place]], lights=self.task.lights[[place]])

    @property
    def steps(self) -> int:
        """0, so that all steps are recorded: motions end at the light, and are thinned afterwards."""
        return 0

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the vehicle up to the light."""
        from robots.braitenberg.motion import vehicle_motion

        assert self.body is not None
        return vehicle_motion(outcome.result, self.body, self.task_in(world), name=name)

    def design(self, point: ArrayLike) -> "VehicleRobot":
        """The vehicle of a point, shape (P,)."""
        sites, controllers = self.split(point)
        return one_vehicle(VehicleBody(sites[0]), controllers[0, 0], self.task)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write body and controller of a point as JSON."""
        sites, controllers = self.split(point)
        record = {"sensors": sites[0].tolist(), "controller": controllers[0, 0].tolist()}
        write_record(path, FORMAT, record)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values: body, controller and task."""
        fields = ("starts", "lights", "radius", "time_step", "steps")
        task = {name: np.asarray(getattr(self.task, name)).tolist() for name in fields}
        body = None if self.body is None else [list(site) for site in self.body.sensors]
        fixed = {} if self.matrix is None else {"matrix": self.matrix.tolist()}
        return {"body": body, "controller": self.controller, "sensors": self.sensors, "task": task, **fixed}

    def facts(self) -> Facts:
        """Sensors, controller, and the task."""
        task = self.task
        return [
            ("Robot", f"Braitenberg vehicle with {self.sensors} sensors, {self.controller} controller"),
            ("Environments", f"{len(task.starts)}, solved within {task.radius:g} m of the light"),
            ("Steps", f"{task.steps:,} of {task.time_step:g} s"),
        ]

    def facts_of(self, point: ArrayLike) -> Facts:
        """Sensors and weights of a point."""
        sites, controllers = self.split(point)
        places = "; ".join(f"{x:.4f} and {y:.4f}" for x, y in sites[0])
        rows = [
            (f"Weights of motor {motor}", ", ".join(f"{weight:.4f}" for weight in row))
            for motor, row in enumerate(controllers[0, 0], 1)
        ]
        return [("Sensors, ahead and to the left [m]", places), *rows]

    def columns(self, points: ArrayLike) -> dict[str, list[str]]:
        """The weights."""
        found = super().columns(points)
        return {name: found[name] for name in self.weight_names}

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """Paths in all environments, and which other weights succeed in the same body."""
        if not replays:
            return []
        from robots.view.vehicle_charts import draw_paths

        paths = [replay.motion.path[:, :2] for replay in replays]
        places = np.full((len(paths), max(map(len, paths)), 2), np.nan)
        for row, path in zip(places, paths, strict=True):
            row[: len(path)] = path
        lights, among = np.unique(self.task.lights, axis=0), counted(len(paths), "environment")
        words = f"Paths of the best vehicle in {among}, from above, and the light"
        found = [Picture(words, lambda axes: draw_paths(axes, places, lights), (3.4, 3.2))]
        task = self.task
        published = np.array_equal(task.starts, PUBLISHED.starts) and np.array_equal(task.lights, PUBLISHED.lights)
        if published and self.controller == "contralateral":
            found.append(self._success(point, compute))
        return found

    def _success(self, point: ArrayLike, compute: Compute) -> Picture:
        """The success matrix of the body of a point, with its own weights as a cross."""
        from robots.view.vehicle_charts import add_overlap_bar, draw_overlap

        (sites, controllers), task = self.split(point), self.task
        overlap = sweep([VehicleBody(sites[0])], WEIGHTS, task.radius, task.time_step, task.steps, **compute.options)[0]
        words = (
            f"Success matrix of the best body: {int((overlap == 4).sum())} of {overlap.size} controllers solve all "
            "environments; the cross is the one found"
        )

        def draw(axes: Any) -> None:
            add_overlap_bar(axes.figure, draw_overlap(axes, overlap, np.diagonal(controllers[0, 0])), [axes])

        return Picture(words, draw, (3.7, 3.0))

    def document(self) -> dict[str, Any]:
        """Sensors and weights."""
        sites, controllers = self.split(())
        return {"sensors": sites[0].tolist(), "weights": controllers[0, 0].tolist()}

    @property
    def lasts(self) -> float:
        """Time that a trial takes, unless the vehicle reaches the light before [s]."""
        return self.task.steps * self.task.time_step

    def at_horizon(self, length: int) -> tuple[str, "VehicleRobot"]:
        """The vehicle for so many time steps."""
        return f"{length} steps", replace(self, task=replace(self.task, steps=length))


def one_vehicle(body: VehicleBody, weights: ArrayLike, task: VehicleTask = PUBLISHED) -> VehicleRobot:
    """A vehicle of which nothing is free.

    Args:
        body: the body.
        weights: two of a contralateral controller, or the full matrix, (2, S), or its rows joined.
        task: what it is tried in.

    Raises:
        ValueError: for weights that are not allowed.
    """
    given = np.asarray(weights, float)
    crossed = given.shape == (2,) and len(body.sensors) == 2
    matrix = contralateral(given) if crossed else given.reshape(2, -1)
    diagonal = matrix.shape == (2, 2) and not (matrix[0, 1] or matrix[1, 0])
    found = VehicleRobot(body, CONTROLLERS[0 if diagonal else 1], task=task, matrix=matrix)
    found.batch(())  # refuses weights that are not allowed
    return found


def load_vehicle(path: Path) -> VehicleRobot:
    """The vehicle that :meth:`VehicleRobot.save` wrote.

    Raises:
        ValueError: if the file is unreadable or damaged.
    """

    def vehicle_of(record: dict[str, Any]) -> VehicleRobot:
        known_names(record, "format", "sensors", "controller")
        body = VehicleBody(record["sensors"])
        return one_vehicle(body, numbers("controller", record["controller"], 2, len(body.sensors)).ravel())

    return read_record(path, FORMAT, vehicle_of)


def vehicle_of_description(description: Mapping[str, Any]) -> VehicleRobot:
    """The robot that ``describe`` described."""
    known_names(description, "body", "controller", "sensors", "task", "matrix")
    body = description["body"]
    return VehicleRobot(
        None if body is None else VehicleBody(body),
        description["controller"],
        description["sensors"],
        built(VehicleTask, description["task"]),
        numbers("matrix", description["matrix"], 2, "S") if "matrix" in description else None,
    )


def _measures(closest: Floats, task: VehicleTask) -> dict[str, Floats]:
    return {"approach": -closest, "closest": closest, "solved": (closest < task.radius).astype(float)}
