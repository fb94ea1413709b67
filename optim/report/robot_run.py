"""Reports of robots of a user's own: what drives them, and the values that a search found."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from optim.problems.lattice_robot import LatticeRobotProblem
from optim.report.kinds import Best, Progress, Replay, finite
from optim.report.markup import Text, facts, number, table
from optim.runs.generation import Generation
from optim.wording import counted
from robots.hardware import PneumaticRig
from robots.lattice_robot import simulate
from robots.view.motion import record_every
from taichi_sim.base.arrays import Floats

UNIT = "lengths/s"


@dataclass(frozen=True)
class RobotRun:
    """A run that designs what is free of a lattice robot."""

    problem: LatticeRobotProblem

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> Self:
        """The run of a problem as described."""
        return cls(LatticeRobotProblem.from_description(description))

    @property
    def task(self) -> str:
        """Which robot moves where."""
        return f"{self.problem.robot.name}, {self.problem.terrain.spoken}"

    @property
    def score(self) -> tuple[str, str]:
        """Speed."""
        return "speed", UNIT

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """Body, drives, terrain, and the simulation."""
        problem, robot = self.problem, self.problem.robot
        body = robot.body
        drives = ", ".join(f"{drive.name} ({drive.quantity})" for drive in robot.drives)
        return [
            ("Robot", f"{robot.name}: {counted(body.voxel_count, 'voxel')} of {1000 * body.voxel_size:g} mm"),
            ("Terrains", problem.terrain.name),
            ("Objective", f"speed along its heading, in lengths of the robot a second ({UNIT})"),
            ("Free", ", ".join(robot.free)),
            ("Driven", drives),
            ("Cycle", f"{robot.frequency:g} Hz; the speed is that of {counted(robot.cycles, 'cycle')}"),
            ("Simulation", f"{problem.precision} on {problem.device}"),
        ]

    @property
    def curves(self) -> Mapping[str, str]:
        """None beside the score."""
        return {}

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Let a design move again."""
        from robots.view.soft_motion import lattice_robot_motion

        problem, robot = self.problem, self.problem.design(point)
        steps = robot.cycle.end - robot.cycle.begin
        result = simulate(
            robot,
            None,
            problem.terrain,
            precision=problem.precision,
            device=problem.device,
            threads=problem.threads,
            record_every=record_every(steps, frames),
            progress=progress,
        )
        motion = lattice_robot_motion(result, robot, problem.terrain, name=f"best {self.task}")
        return Replay([motion], [finite(float(result.speed[0]))])

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """Its speed, and every value that was free beside its bounds."""
        del rig  # a rig plays gaits of the inflatable robot
        details, where = last.best_details or {}, self.problem.terrain
        again = replay.numbers[0] if replay.numbers else None
        speeds = {"speed": last.best, "distance": details.get("distance"), "replayed": again}
        header = ["Terrain", f"Speed [{UNIT}]", "Distance [m]"] + [f"Replayed here [{UNIT}]"] * bool(replay.numbers)
        row = list(map(number, speeds.values()))[: len(header) - 1]
        free, found = self.problem.robot.free, self.problem.space.to_dict(point)
        values = [[name, f"{found[name]:.4g}", f"{free[name].low:g} to {free[name].high:g}"] for name in free]
        content = [
            table("The best design", header, [[where.spoken, *row]]),
            table("What was free", ["Value", "Found", "Allowed"], values),
            facts("Its body", [("Voxels", str(self.problem.robot.body.voxel_count))]),
        ]
        return Best(content, [], {"terrains": [{"terrain": where.name, **speeds}], "values": found})

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """The values."""
        names = self.problem.space.names
        return {name: [f"{value:.4g}" for value in points[:, n]] for n, name in enumerate(names)}

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """Watching the best design."""
        return [("Watch it", f"morpholab view {shlex.quote(str(folder))} --out best.html")]
