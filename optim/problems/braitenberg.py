"""Designing a Braitenberg vehicle: its controller, alone or with the places of its sensors.

Source: dissertation, chapter 4: the loss is the sum over the environments of the smallest distance from the light, or
these distances are objectives of their own.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import VEHICLE, Evaluation, check_kind
from optim.space import Space, Variable
from robots.braitenberg import PUBLISHED, VehicleBody, VehicleTask
from robots.braitenberg.body import HALF_SIDE
from robots.braitenberg.experiment import batch_of
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.files import write_text
from taichi_sim.vehicle import differentiate, rollout

CONTROLLERS = ("contralateral", "full")
OBJECTIVES = ("total", "environments")
STEP = 0.1  # of ranges, standard deviation of a mutation


@dataclass(frozen=True, eq=False)
class VehicleProblem:
    """Objectives: minus the smallest distances from the light [m], their sum or one for each environment.

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
        precision: ``"f64"`` or ``"f32"``.
        device: ``"cpu"``, ``"cuda"``, ...
        threads: CPU threads, all available if None; changes no result.
        progress: called during an evaluation with the fraction done.
    """

    body: VehicleBody | None = None
    controller: str = "contralateral"
    objectives: str = "total"
    sensors: int = 2
    task: VehicleTask = PUBLISHED
    clip: float | None = 1.0
    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        for name, allowed in {"controller": CONTROLLERS, "objectives": OBJECTIVES}.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: {getattr(self, name)!r} is unknown; choose one of {', '.join(allowed)}")
        if self.body is not None:
            object.__setattr__(self, "sensors", len(self.body.sensors))
        object.__setattr__(self, "sensors", whole_number("sensors", self.sensors, 1))
        if self.sensors != 2 and self.controller == "contralateral":
            raise ValueError(f"sensors: {self.sensors} is not allowed with a contralateral controller; give 2")
        if self.clip is not None and not 0 < self.clip < np.inf:
            raise ValueError(f"clip: {self.clip} is not allowed; give a finite number above 0, or none")

    @property
    def objective_names(self) -> tuple[str, ...]:
        """One, or one for each environment."""
        if self.objectives == "total":
            return ("total",)
        return tuple(f"environment_{e}" for e in range(1, len(self.task.starts) + 1))

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Metres."""
        return ("m",) * len(self.objective_names)

    @cached_property
    def space(self) -> Space:
        """Sites, if they are free, and weights."""
        sites = [] if self.body else [f"l{j}{axis}" for j in range(1, self.sensors + 1) for axis in "xy"]
        if self.controller == "contralateral":
            weights = ["w1", "w2"]
        else:
            weights = [f"w{motor}{j}" for motor in (1, 2) for j in range(1, self.sensors + 1)]
        return Space(
            tuple(Variable(name, -HALF_SIDE, HALF_SIDE, step=2 * HALF_SIDE * STEP) for name in sites)
            + tuple(Variable(name, -1.0, 1.0, step=2 * STEP) for name in weights)
        )

    def split(self, points: ArrayLike) -> tuple[Floats, Floats]:
        """Sites, shape (N, S, 2), and controllers, shape (N, 1, 2, S), of points, shape (N, D)."""
        points = self.space.validate(np.atleast_2d(points))
        count = len(points)
        if self.body is None:
            sites = points[:, : 2 * self.sensors].reshape(count, -1, 2)
        else:
            sites = np.broadcast_to(self.body.sensors, (count, self.sensors, 2))
        weights = points[:, self.space.size - self._weights :]
        if self.controller == "contralateral":
            return sites, (weights[:, :, None] * np.eye(2))[:, None]
        return sites, weights.reshape(count, 1, 2, self.sensors)

    @property
    def _weights(self) -> int:
        return 2 if self.controller == "contralateral" else 2 * self.sensors

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Roll out all points, shape (N, D).

        Details: ``solved``, in how many environments the light is reached, shape (N,).
        """
        done = rollout(self._batch(points), self.task, until="closest", **self._where, progress=self.progress)
        return self._judged(done.closest[:, 0], done.diverged[:, 0])

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """The same, as nothing is binary; with gradients of the total, see ``clip``."""
        if not gradients:
            return self.evaluate(points)
        if self.objectives != "total":
            raise ValueError(f"objectives: {self.objectives!r} have no single gradient; choose total")
        found = differentiate(self._batch(points), self.task, **self._where, progress=self.progress)
        by_weights = found.of_closest.controllers[:, 0]
        if self.controller == "contralateral":
            by_weights = np.diagonal(by_weights, axis1=-2, axis2=-1)
        by = [] if self.body else [found.of_closest.sites[:, 0]]
        closest = found.closest[:, 0]
        slopes = np.concatenate([x.reshape(*closest.shape, -1) for x in (*by, by_weights)], axis=-1)
        if self.clip is not None:
            with np.errstate(over="ignore"):  # what is too steep for its square becomes flat
                length = np.linalg.norm(slopes, axis=-1, keepdims=True)
            slopes = slopes * np.minimum(1.0, self.clip / np.maximum(length, 1e-300))
            slopes[closest < self.task.radius] = 0.0
        return self._judged(closest, np.isnan(closest), -slopes.sum(axis=1))

    def _judged(self, closest: Floats, diverged: Bools, gradients: Floats | None = None) -> Evaluation:
        reached = closest < self.task.radius
        status = np.where((diverged & ~reached).any(axis=1), "diverged", "ok")
        objectives = -closest if self.objectives == "environments" else -closest.sum(axis=1)
        return Evaluation(objectives, status, {"solved": reached.sum(axis=1)}, gradients)

    def _batch(self, points: ArrayLike) -> Any:
        sites, controllers = self.split(points)
        return batch_of([VehicleBody(tuple(map(tuple, s))) for s in sites.tolist()], controllers)

    @property
    def _where(self) -> dict[str, Any]:
        return {"precision": self.precision, "device": self.device, "threads": self.threads}

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write body and controller of a point as JSON."""
        sites, controllers = self.split(point)
        design = {"sensors": sites[0].tolist(), "controller": controllers[0, 0].tolist()}
        write_text(path, json.dumps({"format": "morpholab-vehicle-1", **design}, indent=2) + "\n")

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again."""
        task = {
            "starts": self.task.starts.tolist(),
            "lights": self.task.lights.tolist(),
            **{name: getattr(self.task, name) for name in ("radius", "time_step", "steps")},
        }
        options = {name: getattr(self, name) for name in ("controller", "objectives", "sensors", "precision", "device")}
        body = {"body": [list(site) for site in self.body.sensors]} if self.body else {}
        return {"kind": VEHICLE, **options, **body, "task": task, "clip": self.clip or 0.0}

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> "VehicleProblem":
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: in one line, that names what is missing, unknown or not allowed.
        """
        check_kind(description, VEHICLE)
        try:
            settings = {name: value for name, value in description.items() if name != "kind"}
            settings["task"] = VehicleTask(**description["task"])
            settings["clip"] = settings["clip"] or None
            if "body" in settings:
                settings["body"] = VehicleBody(tuple(map(tuple, settings["body"])))
            unknown = set(settings) - {f.name for f in fields(cls)}
            if unknown:
                raise KeyError(", ".join(sorted(unknown)))
            return cls(**settings)
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None
