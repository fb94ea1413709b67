"""What Braitenberg vehicles offer to commands, searches, views and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.braitenberg.body import BASELINE, CONTROLLERS, FORMAT, HALF_SIDE, VehicleBody
from robots.braitenberg.experiment import PUBLISHED, batch_of, contralateral, trace
from robots.braitenberg.sweeps import sweep
from robots.robot import FRAMES, HERE, Facts, Measure, Outcome, Parameter, Picture, Progress, Replay, Robot, World
from robots.world import Environment
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import read_record, write_record
from taichi_sim.vehicle import VehicleBatch, VehicleTask, differentiate, rollout

STEP = 0.1  # of a mutation, part of a parameter's range
WEIGHTS = 41  # of a success matrix, along each side
MEASURES = (
    Measure("approach", "m", "minus the smallest distance from the light"),
    Measure("closest", "m", "smallest distance from the light"),
    Measure("solved", "", "whether the light is reached"),
)


@dataclass(frozen=True, eq=False)
class VehicleRobot(Robot):
    """A vehicle's controller, alone or with the places of its sensors.

    Parameters: x and y of each sensor, ``l1x``, ``l1y``, ... [m], unless the body is fixed; then the weights, ``w1``
    and ``w2`` of the contralateral controller, or ``w11``, ``w12``, ... of the full matrix (motor, sensor).

    Attributes:
        body: fixed body; None lets the sensors be placed.
        controller: ``"contralateral"``, each sensor drives the motor of the other side, or ``"full"``.
        sensors: how many, if the body is free; contralateral needs two.
        task: environments, radius, time step and steps.
    """

    body: VehicleBody | None = None
    controller: str = CONTROLLERS[0]
    sensors: int = 2
    task: VehicleTask = PUBLISHED

    kind = "vehicle"
    measures = MEASURES

    def __post_init__(self) -> None:
        choice("controller", self.controller, CONTROLLERS)
        if self.body is not None:
            object.__setattr__(self, "sensors", len(self.body.sensors))
        object.__setattr__(self, "sensors", whole_number("sensors", self.sensors, 1))
        if self.sensors != 2 and self.controller == "contralateral":
            raise ValueError(f"sensors: {self.sensors} is not allowed with a contralateral controller; give 2")

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
        weights = points[:, sites:]
        if self.body is None:
            places = points[:, :sites].reshape(count, -1, 2)
        else:
            places = np.broadcast_to(self.body.sensors, (count, self.sensors, 2))
        if self.controller == "contralateral":
            return places, contralateral(weights)[:, None]
        return places, weights.reshape(count, 1, 2, self.sensors)

    def batch(self, points: ArrayLike) -> VehicleBatch:
        """Bodies and controllers of points, shape (N, P)."""
        sites, controllers = self.split(points)
        return batch_of([VehicleBody(tuple(map(tuple, each))) for each in sites.tolist()], controllers)

    def simulate(
        self,
        points: ArrayLike,
        world: World,
        *,
        compute: Compute = HERE,
        record_every: int | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """Drive in one environment; with ``record_every`` the frames are ``poses`` and ``readings``."""
        task = self.task_in(world)
        done = rollout(self.batch(points), task, until="closest", **compute.options, progress=progress)
        result, frames = None, {}
        if record_every is not None:
            sites, controllers = self.split(points)
            bodies = [VehicleBody(tuple(map(tuple, each))) for each in sites.tolist()]
            result = trace(bodies, controllers, task, every=record_every, **compute.options)
            frames = {name: getattr(result, name) for name in ("times", "poses", "readings")}
        closest, reached = done.closest[:, 0, 0], done.closest[:, 0, 0] < task.radius
        status = np.where(done.diverged[:, 0, 0] & ~reached, "diverged", "ok")
        steps = np.full(len(closest), task.steps)
        return Outcome(_measures(closest, task), status, steps=steps, frames=frames, result=result)

    def differentiate(
        self, points: ArrayLike, world: World, *, compute: Compute = HERE, progress: Progress | None = None
    ) -> Outcome:
        """Drive in one environment, with the gradients of the distances from the light."""
        task = self.task_in(world)
        found = differentiate(self.batch(points), task, **compute.options, progress=progress)
        closest, slopes = found.closest[:, 0, 0], self.slopes(found)[:, 0]
        gradients = {"approach": -slopes, "closest": slopes}
        return Outcome(_measures(closest, task), gradients=gradients)

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
        """Drive in one environment, and build the motion."""
        from robots.view.vehicle_motion import vehicle_motion

        outcome = self.simulate(point, world, compute=compute, record_every=1, progress=progress)
        sites, _ = self.split(point)
        body = VehicleBody(tuple(map(tuple, sites[0].tolist())))
        motion = vehicle_motion(outcome.result, body, self.task_in(world), name=name or self.name)
        return Replay(outcome, motion.every(-(-len(motion.times) // frames)))

    def design(self, point: ArrayLike) -> "Vehicle":
        """The vehicle of a point, shape (P,)."""
        sites, controllers = self.split(point)
        body = VehicleBody(tuple(map(tuple, sites[0].tolist())))
        return Vehicle(body, tuple(controllers[0, 0].ravel().tolist()), self.task)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write body and controller of a point as JSON."""
        sites, controllers = self.split(point)
        record = {"sensors": sites[0].tolist(), "controller": controllers[0, 0].tolist()}
        write_record(path, FORMAT, record)

    def describe(self) -> dict[str, Any]:
        """Body, controller and task."""
        task = {name: getattr(self.task, name) for name in ("radius", "time_step", "steps")}
        places = {"starts": self.task.starts.tolist(), "lights": self.task.lights.tolist()}
        body = None if self.body is None else [list(site) for site in self.body.sensors]
        return {"body": body, "controller": self.controller, "sensors": self.sensors, "task": {**places, **task}}

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
        count, lights = len(paths), np.unique(self.task.lights, axis=0)
        among = "1 environment" if count == 1 else f"{count} environments"
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
        body = VehicleBody(tuple(map(tuple, sites[0].tolist())))
        overlap = sweep([body], WEIGHTS, task.radius, task.time_step, task.steps, **compute.options)[0]
        words = (
            f"Success matrix of the best body: {int((overlap == 4).sum())} of {overlap.size} controllers solve all "
            "environments; the cross is the one found"
        )

        def draw(axes: Any) -> None:
            add_overlap_bar(axes.figure, draw_overlap(axes, overlap, np.diagonal(controllers[0, 0])), [axes])

        return Picture(words, draw, (3.7, 3.0))

    def at_horizon(self, length: int) -> tuple[str, "VehicleRobot"]:
        """The vehicle for so many time steps."""
        return f"{length} steps", replace(self, task=replace(self.task, steps=length))

    horizons = (100, 300, 1000)


class Vehicle(VehicleRobot):
    """One vehicle: nothing of it is free."""

    def __init__(self, body: VehicleBody, weights: Sequence[float], task: VehicleTask = PUBLISHED) -> None:
        """Fix a body, and its controller: two weights of a contralateral one, or a row of each motor, joined."""
        super().__init__(body, "full", len(body.sensors), task)
        crossed = len(weights) == 2 and len(body.sensors) == 2
        matrix = contralateral(weights) if crossed else np.reshape(np.asarray(weights, float), (2, -1))
        object.__setattr__(self, "matrix", matrix)
        if np.count_nonzero(matrix - np.diag(np.diagonal(matrix))) == 0 and matrix.shape == (2, 2):
            object.__setattr__(self, "controller", "contralateral")
        self.batch(np.zeros((1, 0)))  # refuses weights that are not allowed

    matrix: Floats
    parameters = ()

    @property
    def name(self) -> str:
        """With the number of the body, if it is on the published grid."""
        number = self.body.design if self.body else None
        return "vehicle" if number is None else f"vehicle {number}"

    def split(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """The sites and the controller, as often as there are points."""
        assert self.body is not None
        count = len(self.points(points))
        sites = np.broadcast_to(self.body.sensors, (count, self.sensors, 2))
        return sites, np.broadcast_to(self.matrix, (count, 1, 2, self.sensors))

    def design(self, point: ArrayLike) -> "Vehicle":
        """Itself."""
        return self

    def document(self) -> dict[str, Any]:
        """Sensors and weights."""
        return {"sensors": [list(site) for site in self.split(())[0][0].tolist()], "weights": self.matrix.tolist()}


def load_vehicle(path: Path) -> Vehicle:
    """The vehicle that :meth:`VehicleRobot.save` wrote.

    Raises:
        ValueError: if the file is unreadable or damaged.
    """

    def build(record: dict[str, Any]) -> Vehicle:
        body = VehicleBody(tuple(map(tuple, record["sensors"])))
        return Vehicle(body, tuple(np.ravel(record["controller"]).tolist()))

    return read_record(path, FORMAT, build)


def vehicle_of_description(description: Mapping[str, Any]) -> VehicleRobot:
    """The robot that ``describe`` described."""
    body = description["body"]
    return VehicleRobot(
        None if body is None else VehicleBody(tuple(map(tuple, body))),
        description["controller"],
        description["sensors"],
        VehicleTask(**description["task"]),
    )


def _measures(closest: Floats, task: VehicleTask) -> dict[str, Floats]:
    return {"approach": -closest, "closest": closest, "solved": (closest < task.radius).astype(float)}
