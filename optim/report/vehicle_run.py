"""Reports of Braitenberg vehicles: environments, the best vehicle's sensors and weights, and its paths."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from optim.plots.vehicles import add_overlap_bar, draw_overlap, draw_paths
from optim.problems.braitenberg import VehicleProblem
from optim.report.charts import chart
from optim.report.kinds import Best, Progress, Replay, finite
from optim.report.markup import Html, Text, facts, joined, number, picture, side_by_side, table
from optim.runs.generation import Generation
from optim.wording import counted
from robots.braitenberg import PUBLISHED, VehicleBody, sweep, trace
from robots.hardware import PneumaticRig
from taichi_sim.base.arrays import Bytes, Floats

UNIT = "m"
WEIGHTS = 41  # of a success matrix


@dataclass(frozen=True)
class VehicleRun:
    """A run that designs a vehicle's controller, alone or with the places of its sensors."""

    problem: VehicleProblem

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> Self:
        """The run of a problem as described."""
        return cls(VehicleProblem.from_description(description))

    @property
    def task(self) -> str:
        """How many environments."""
        return f"Braitenberg vehicle in {counted(len(self.problem.task.starts), 'environment')}"

    @property
    def score(self) -> tuple[str, str]:
        """Minus the sum or the mean of the distances."""
        return "score", UNIT

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """Body, controller, task, and the simulation."""
        problem, task = self.problem, self.problem.task
        free = "weights" if problem.body else "places of the sensors and weights"
        total = self.problem.objectives == "total"
        aim = "the score is minus their sum" if total else "each is an objective, the score minus their mean"
        return [
            ("Robot", f"Braitenberg vehicle with {problem.sensors} sensors, {problem.controller} controller"),
            ("Environments", f"{len(task.starts)}, solved within {task.radius:g} m of the light"),
            ("Objective", f"the smallest distances from the light [m]; {aim}"),
            ("Free", free),
            ("Simulation", f"{task.steps:,} steps of {task.time_step:g} s, {problem.precision} on {problem.device}"),
        ]

    @property
    def curves(self) -> Mapping[str, str]:
        """In how many environments the best vehicle reaches the light."""
        return {"solved": "environments solved"}

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Drive again in all environments."""
        from robots.view.vehicle_motion import vehicle_motion

        problem, body = self.problem, self._body(point)
        _, controllers = problem.split(point)
        where = {name: getattr(problem, name) for name in ("precision", "device", "threads")}
        traces = trace([body], controllers, problem.task, **where)
        motions, task = [], problem.task
        for n in range(len(task.starts)):
            motion = vehicle_motion(traces, body, task, environment=n, name=f"environment {n + 1}")
            motions.append(motion.every(-(-len(motion.times) // frames)))
            progress((n + 1) / len(task.starts))
        away = np.linalg.norm(traces.poses[0, 0, :, :, :2] - task.lights[:, None], axis=-1)
        closest = [finite(distance) for distance in np.nanmin(away, axis=1).tolist()]
        places = np.full((len(motions), max(len(motion.times) for motion in motions), 2), np.nan)
        for path, motion in zip(places, motions, strict=True):
            path[: len(motion.times)] = motion.path[:, :2]
        lights = np.unique(task.lights, axis=0)
        alt = f"Paths of the best vehicle in {counted(len(motions), 'environment')}, from above, and the light"
        drawn = chart(lambda axes: draw_paths(axes, places, lights), alt, size=(3.4, 3.2))
        return Replay(motions, closest, [picture(drawn, alt)])

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """Distances in each environment, sensors and weights, and which other weights succeed in this body."""
        del rig  # nothing inflates
        body, radius = self._body(point), self.problem.task.radius
        weights = self.problem.split(point)[1][0, 0]
        rows, told = [], []
        for n, distance in enumerate(replay.numbers, 1):
            solved = distance is not None and distance < radius
            rows.append((f"environment {n}", number(distance), "yes" if solved else "no"))
            told.append({"environment": n, "closest": distance, "solved": solved})
        header = ("", "Smallest distance [m]", "Solved")
        measured = [table("The best vehicle, replayed here", header, rows)] if rows else []
        sites = joined((joined(map(number, site), " and ") for site in body.sensors), "; ")
        about = [
            ("Sensors, ahead and to the left [m]", sites),
            *((f"Weights of motor {m}", joined(map(number, row))) for m, row in enumerate(weights.tolist(), 1)),
            ("Environments solved, as logged", str((last.best_details or {}).get("solved", ""))),
        ]
        content = [*measured, facts("Its body and controller", about)]
        pictures = [*replay.pictures, *([self._success(body, weights)] if rows and self._is_swept else [])]
        return Best([*content, side_by_side(pictures)], [], {"environments": told})

    @property
    def _is_swept(self) -> bool:
        """Whether the controllers are those of a sweep: two weights, the published environments."""
        task = self.problem.task
        published = np.array_equal(task.starts, PUBLISHED.starts) and np.array_equal(task.lights, PUBLISHED.lights)
        return published and self.problem.controller == "contralateral"

    def _success(self, body: VehicleBody, weights: Floats) -> Html:
        """The success matrix of the best body."""
        task, problem = self.problem.task, self.problem
        overlap = sweep(
            [body],
            WEIGHTS,
            task.radius,
            task.time_step,
            task.steps,
            precision=problem.precision,
            device=problem.device,
            threads=problem.threads,
        )[0]
        alt = (
            f"Success matrix of the best body: {int((overlap == 4).sum())} of {overlap.size} controllers solve all "
            "environments; the cross is the one found"
        )
        return success_matrix(overlap, alt, np.diagonal(weights))

    def _body(self, point: Floats) -> VehicleBody:
        sites, _ = self.problem.split(point)
        return VehicleBody(tuple(map(tuple, sites[0].tolist())))

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """The weights."""
        names = [name for name in self.problem.space.names if name.startswith("w")]
        return {name: [number(self.problem.space.to_dict(point)[name], 3) for point in points] for name in names}

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """Watching the best vehicle."""
        return [("Watch it", f"morpholab view {shlex.quote(str(folder))} --out best.html")]


def success_matrix(overlap: Bytes, alt: str, weights: Floats | None = None) -> Html:
    """A success matrix with its colours beside it."""

    def draw(axes: Any) -> None:
        add_overlap_bar(axes.figure, draw_overlap(axes, overlap, weights), [axes])

    return picture(chart(draw, alt, size=(3.7, 3.0)), alt)
