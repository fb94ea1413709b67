"""What commands and reports ask of a search for gaits, beside its judgement."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from optim.problems.robot import RobotDesigning, worlds_spoken
from robots.calibration import save_properties
from robots.inflatable.offered import InflatableRobot, fitted, kilopascals
from robots.robot import Facts, Robot, World
from robots.world import Terrain
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from optim.problems.inflatable.problem import GaitProblem

RIG_FILE = "calibration.json"  # in folders of runs


class GaitDesigning(RobotDesigning):
    """The part of ``GaitProblem`` that tells of its points as robots."""

    exportable = True
    robot_kind = "inflatable"

    @property
    def _gaits(self) -> "GaitProblem":
        return cast("GaitProblem", self)

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The terrains."""
        return self._gaits.terrains

    def robot_of(self, point: ArrayLike) -> Robot:
        """The inflatable robot with the gait of a point, shape (D,); its speeds are counted as the search counts."""
        problem, gait = self._gaits, self._gaits.design(point)
        return InflatableRobot(
            gait,
            geometry=problem.geometry,
            weight=problem.weight,
            properties=problem.properties,
            speeds=problem.speeds,
            counted_steps=None if problem.steps is None else problem.counted_steps(gait),
        )

    @property
    def subject(self) -> str:
        """Where the robot travels."""
        return f"inflatable robot, {worlds_spoken(self.tried_in)}"

    def facts(self) -> Facts:
        """Terrains, what is free, what is fixed, and the simulation."""
        problem, geometry = self._gaits, self._gaits.body
        held = [f"orientation {problem.orientation:g}°"] if problem.orientation is not None else []
        if problem.pressure is not None:
            held.append("pressure " + ", ".join(f"{one:g}" for one in np.atleast_1d(problem.pressure)) + " Pa")
        held += ["gait"] if problem.schedule is not None else []
        aim = "mean speed over the terrains" if problem.objectives == "mean" else "speed on each terrain"
        steps = problem.steps
        convention = "by the published convention" if steps is None else f"of {steps:,} time steps"
        times = {1: "once", 2: "twice"}.get(problem.repeats, f"{problem.repeats} times")
        often = f"as often as {problem.most_steps:,} time steps allow" if problem.graded else times
        return [
            ("Robot", f"inflatable shape-changing robot, {problem.geometry} geometry, {geometry.body_length:g} m long"),
            ("Terrains", ", ".join(_described(terrain) for terrain in problem.terrains)),
            (
                "Objective",
                f"{aim if len(problem.terrains) > 1 else 'speed'}, in body lengths a second {convention} (BL/s)",
            ),
            ("Free", ", ".join(problem.free)),
            ("Fixed", ", ".join(held) or "nothing"),
            ("Gait", f"{problem.columns} columns, played {often}, encoded as {problem.encoding}"),
            *([("Rig", fitted(problem.properties))] if problem.properties else []),
            ("Simulation", f"{problem.precision} on {problem.device}, weight of bladders {problem.weight}"),
        ]

    def columns_of(self, points: Floats) -> Mapping[str, Sequence[str]]:
        """Pressures and orientation."""
        designs = [self._gaits.design(point) for point in points]
        each = [kilopascals("Pressure", design) for design in designs]
        found = {f"{name} [kPa]": [f"{pressures[name]:.2f}" for pressures in each] for name in each[0]} if each else {}
        return {**found, "Orientation [°]": [f"{design.orientation:.1f}" for design in designs]}

    @property
    def curves(self) -> Mapping[str, str]:
        """The speed on each terrain, of several."""
        terrains = self._gaits.terrains
        return {f"speed_{terrain.name}": terrain.spoken for terrain in terrains} if len(terrains) > 1 else {}

    def logged(self, point: ArrayLike, best: float | None, details: Mapping[str, Any]) -> list[dict[str, float]]:
        """Speed on each terrain, and the distance that it comes to [m]."""
        problem = self._gaits
        metres = problem.body.body_length * problem.counted_steps(problem.design(point)) * problem.body.time_step
        found = []
        for terrain in problem.terrains:
            speed = details.get(f"speed_{terrain.name}")
            found.append({} if speed is None else {"speed": speed, "distance": float(speed * metres)})
        return found

    def command_options(self, folder: Path) -> dict[str, Any]:
        """Body and rig."""
        problem = self._gaits
        rig = {} if problem.properties is None else {"calibration": folder / RIG_FILE}
        return {"geometry": problem.geometry, "weight": problem.weight, **rig}

    def prepare(self, folder: Path) -> None:
        """Write the properties of the rig, if the robot has some, for ``robots.calibration.load_calibration``."""
        problem = self._gaits
        if problem.properties is None:
            (folder / RIG_FILE).unlink(missing_ok=True)  # of a run that ended before it began
        else:
            save_properties(problem.properties, problem.geometry, folder / RIG_FILE)


def _described(terrain: Terrain) -> str:
    friction = {"gripping": terrain.high_friction, "sliding": terrain.low_friction}
    given = [f"friction {name} {value:g}" for name, value in friction.items() if value is not None]
    return " with ".join([terrain.name, *given])
