"""Designing a Braitenberg vehicle: its controller, alone or with the places of its sensors.

Source: dissertation, chapter 4: the loss is the sum over the environments of the smallest distance from the light, or
these distances are objectives of their own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import VEHICLE, Evaluation, Minibatch, check_kind
from optim.problems.robot import RobotDesignProblem
from robots.braitenberg import PUBLISHED, VehicleBody, VehicleTask
from robots.braitenberg.body import CONTROLLERS
from robots.braitenberg.robot import VehicleRobot
from robots.robot import Facts, World
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import choice
from taichi_sim.base.short_text import counted
from taichi_sim.vehicle import VehicleBatch, differentiate, rollout

OBJECTIVES = ("total", "environments")


@dataclass(frozen=True, eq=False)
class VehicleProblem(RobotDesignProblem):
    """Design a Braitenberg vehicle that comes close to the light in each environment.

    The objective is minus the smallest distance from the light [m]: the sum over environments, or one for each.

    Variables: x and y of each sensor, ``l1x``, ``l1y``, ... [m], unless the body is fixed; then the weights, ``w1`` and
    ``w2`` of the contralateral controller, or ``w11``, ``w12``, ... of the full matrix (motor, sensor).

    Attributes:
        body: fixed body; None lets the sensors be placed.
        controller: ``"contralateral"``, each sensor drives the motor of the other side, or ``"full"``.
        objectives: ``"total"`` or ``"environments"``.
        sensors: how many, if the body is free; contralateral needs two.
        task: environments, radius, time step and steps.
        clip: gradients of single environments longer than this are shortened to it, as the distance is nearly flat far
            from the light and steep near it, and environments that are solved add nothing; None gives the true gradient
            of the sum.
    """

    body: VehicleBody | None = None
    controller: str = "contralateral"
    objectives: str = "total"
    sensors: int = 2
    task: VehicleTask = PUBLISHED
    clip: float | None = 1.0

    def __post_init__(self) -> None:
        choice("controller", self.controller, CONTROLLERS)
        choice("objectives", self.objectives, OBJECTIVES)
        object.__setattr__(self, "sensors", self.offered.sensors)
        if self.clip is not None and not 0 < self.clip < np.inf:
            raise ValueError(f"clip: {self.clip} is not allowed; give a finite number above 0, or none")

    @cached_property
    def offered(self) -> VehicleRobot:
        """The vehicle as a robot of its kind, with its free parameters."""
        return VehicleRobot(self.body, self.controller, self.sensors, self.task)

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The environments of the task."""
        return self.offered.worlds

    @property
    def objective_names(self) -> tuple[str, ...]:
        """A name for the one objective, or one for each environment."""
        if self.objectives == "total":
            return ("total",)
        return tuple(f"environment_{world.name}" for world in self.tried_in)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """The unit of all objectives: metres."""
        return ("m",) * len(self.objective_names)

    def split(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Split points, shape (N, D), into sensor sites, shape (N, S, 2) [m], and controllers, shape (N, 1, 2, S)."""
        return self.offered.split(self.space.validate(np.atleast_2d(points)))

    @property
    def subject(self) -> str:
        """Description of what is designed, and in how many environments, in a few words."""
        return f"Braitenberg vehicle in {counted(len(self.task.starts), 'environment')}"

    def facts(self) -> Facts:
        """Rows for a report: body, controller, task and simulation."""
        total = self.objectives == "total"
        aim = "the score is minus their sum" if total else "each is an objective, the score minus their mean"
        return [
            *self.offered.facts(),
            ("Objective", f"the smallest distances from the light [m]; {aim}"),
            ("Free", "weights" if self.body else "places of the sensors and weights"),
            ("Simulation", f"{self.precision} on {self.device}"),
        ]

    @property
    def curves(self) -> Mapping[str, str]:
        """Curves of a search: the number of environments in which the best vehicle reaches the light."""
        return {"solved": "environments solved"}

    def logged(self, point: ArrayLike, best: float | None, details: Mapping[str, Any]) -> list[dict[str, float]]:
        """Measures of the best point for the log: none, as the log has only the total over the environments."""
        return [{} for _ in self.tried_in]

    @property
    def detail_names(self) -> set[str]:
        """Names of the details that every evaluation contains."""
        return {"solved"}

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate the vehicles of all points, shape (N, D).

        Details: ``solved``, in how many environments the light is reached, shape (N,).
        """
        done = rollout(self._batch(points), self.task, until="closest", **self.compute.options, progress=self.progress)
        return self._distances(done.closest[:, 0], done.diverged[:, 0])

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Evaluate points as :meth:`evaluate` does, as nothing is binary; with gradients of the total, see ``clip``."""
        if not gradients:
            return self.evaluate(points)
        if self.objectives != "total":
            raise ValueError(f"objectives: {self.objectives!r} have no single gradient; choose total")
        found = differentiate(self._batch(points), self.task, **self.compute.options, progress=self.progress)
        closest, slopes = found.closest[:, 0], self.offered.slopes(found)
        if self.clip is not None:
            with np.errstate(over="ignore"):  # what is too steep for its square becomes flat
                length = np.linalg.norm(slopes, axis=-1, keepdims=True)
            slopes = slopes * np.minimum(1.0, self.clip / np.maximum(length, 1e-300))
            slopes[closest < self.task.radius] = 0.0
        return self._distances(closest, np.isnan(closest), -slopes.sum(axis=1))

    def check_minibatch(self, size: int) -> None:
        """Check that a minibatch is allowed: some of several environments, whose sum is the only objective."""
        if self.objectives != "total":
            raise ValueError(f"minibatch_size: {size} is not allowed with objectives {self.objectives!r}; choose total")
        super().check_minibatch(size)

    def in_minibatch(self, minibatch: Minibatch) -> "VehicleProblem":
        """Return the problem in a few of the environments; the score is the sum over these."""
        rows = minibatch.of(len(self.task.starts))
        return replace(self, task=replace(self.task, starts=self.task.starts[rows], lights=self.task.lights[rows]))

    def _distances(self, closest: Floats, diverged: Bools, gradients: Floats | None = None) -> Evaluation:
        """The judgement of the smallest distances, shape (N, environments)."""
        reached = closest < self.task.radius
        status = np.where((diverged & ~reached).any(axis=1), "diverged", "ok")
        objectives = -closest if self.objectives == "environments" else -closest.sum(axis=1)
        return Evaluation(objectives, status, {"solved": reached.sum(axis=1)}, gradients)

    def _batch(self, points: ArrayLike) -> VehicleBatch:
        return self.offered.batch(self.space.validate(np.atleast_2d(points)))

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; :meth:`from_description` builds the problem again."""
        task = {
            "starts": self.task.starts.tolist(),
            "lights": self.task.lights.tolist(),
            **{name: getattr(self.task, name) for name in ("radius", "time_step", "steps")},
        }
        options = {name: getattr(self, name) for name in ("controller", "objectives", "sensors", "precision", "device")}
        body = {"body": [list(site) for site in self.body.sensors]} if self.body else {}
        return {"kind": VEHICLE, **options, **body, "task": task, "clip": self.clip or 0.0}

    @classmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a description from :meth:`describe` to the fields of the problem."""
        check_kind(description, VEHICLE)
        settings = {name: value for name, value in description.items() if name != "kind"}
        settings |= {"task": VehicleTask(**description["task"]), "clip": settings["clip"] or None}
        if "body" in settings:
            settings["body"] = VehicleBody(tuple(map(tuple, settings["body"])))
        return settings
