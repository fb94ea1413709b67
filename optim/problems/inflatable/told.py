"""What a report tells of a search for gaits."""

from typing import TYPE_CHECKING

import numpy as np

from robots.robot import Facts
from robots.world import Terrain

if TYPE_CHECKING:
    from optim.problems.inflatable.problem import GaitProblem

RIG_FILE = "calibration.json"  # in folders of runs


def facts_of(problem: "GaitProblem") -> Facts:
    """Terrains, what is free, what is fixed, and the simulation."""
    geometry = problem.body
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
        ("Objective", f"{aim if len(problem.terrains) > 1 else 'speed'}, in body lengths a second {convention} (BL/s)"),
        ("Free", ", ".join(problem.free)),
        ("Fixed", ", ".join(held) or "nothing"),
        ("Gait", f"{problem.columns} columns, played {often}, encoded as {problem.encoding}"),
        *([("Rig", problem.properties.spoken)] if problem.properties else []),
        ("Simulation", f"{problem.precision} on {problem.device}, weight of bladders {problem.weight}"),
    ]


def _described(terrain: Terrain) -> str:
    friction = {"gripping": terrain.high_friction, "sliding": terrain.low_friction}
    given = [f"friction {name} {value:g}" for name, value in friction.items() if value is not None]
    return " with ".join([terrain.name, *given])
