"""The hardware package: gaits, tables, the state machine, pictures, a player page and a report, in one folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import write_json
from optim.pipeline.changes import Change, Crossing
from optim.pipeline.machine import MACHINE, change_name, machine_document
from optim.pipeline.plans import Plan
from optim.pipeline.task import PipelineTask
from optim.pipeline.trials import State
from optim.problems.inflatable.told import RIG_FILE
from robots.calibration import save_properties
from robots.hardware import export_csv
from robots.inflatable.design import InflatableDesign
from robots.inflatable.files import save_design
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

FOLDERS = ("gaits", "tables", "pictures")
NUMBERS, REPORT = "numbers.json", "report.html"


@dataclass(frozen=True, eq=False)
class Package:
    """All that the pipeline has found."""

    task: PipelineTask  # what was asked for
    candidates: Mapping[str, InflatableDesign]  # gaits that were tried, by name
    speeds: Mapping[str, Floats]  # of them, see ``speeds_of``
    plan: Plan  # the one chosen
    one_gait: Plan | None  # the best with one gait everywhere; None if no gait works everywhere
    one_shape: Plan | None  # the best with one shape everywhere; None if no shape works everywhere
    states: Sequence[State]  # one per terrain
    changes: Mapping[tuple[str, str], Change | None]  # from state to state, by their names; None where the shape stays
    # changes of terrain mid-way that were simulated, by the names of the states
    crossings: Mapping[tuple[str, str], Crossing]
    rejected: Sequence[str]  # plans that were faster, and why they were not chosen

    def numbers(self) -> dict[str, Any]:
        """What was measured, for machines."""
        names, plans = [terrain.name for terrain in self.task.terrains], (self.plan, self.one_gait, self.one_shape)
        plan, one_gait, one_shape = (each and {"gaits": list(each.gaits), "speed": each.speed} for each in plans)
        return {
            "terrains": names,
            "candidates": {
                name: dict(zip(names, map(_mean_and_deviation, self.speeds[name]), strict=True))
                for name in self.candidates
            },
            "plan": plan,
            "one_gait": one_gait,
            "one_shape": one_shape,
            "rejected": list(self.rejected),
            "crossings": [
                {
                    "from": first,
                    "to": second,
                    "single_gait": crossing.gait,
                    "machine": crossing.machine.mean(axis=0).tolist(),
                    "single": crossing.single.mean(axis=0).tolist(),
                    "machine_survives": crossing.survived[0],
                    "single_survives": crossing.survived[1],
                }
                for (first, second), crossing in self.crossings.items()
            ],
        }


def _mean_and_deviation(speeds: Floats) -> list[float | None]:
    values = [float(speeds.mean()), float(speeds.std(ddof=1))]
    return [value if np.isfinite(value) else None for value in values]


def write_package(package: Package, folder: Path) -> list[str]:
    """Write the package in place of an earlier one, and list its files; raises ValueError if the rig refuses a gait."""
    from optim.pipeline.page import PLAYER, report_page
    from robots.view.picture import save_motion_picture
    from robots.view.player import MOST_MOTIONS, page
    from robots.view.soft_motion import journey_motion

    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    task, written = package.task, []
    designs = {state.name: state.design for state in package.states}
    designs |= {change_name(pair): change.design for pair, change in package.changes.items() if change}
    for name, design in designs.items():
        written += [f"gaits/{name}.json", f"tables/{name}.csv"]
        save_design(design, folder / f"gaits/{name}.json")
        export_csv(design, folder / f"tables/{name}.csv", task.rig, seed=task.seed)
    for state in package.states:
        written.append(f"pictures/{state.name}.png")
        save_motion_picture(state.design, state.terrain, folder / written[-1], **task.robot)
    if package.crossings:
        motions = [
            journey_motion(one.shown, one.legs, actuation=task.robot["actuation"], name=f"{first} to {second}")
            for (first, second), one in package.crossings.items()
        ]
        write_text(folder / PLAYER, page(motions[:MOST_MOTIONS], "From terrain to terrain"))
        written.append(PLAYER)
    if task.calibration is not None:
        save_properties(task.calibration, task.geometry, folder / RIG_FILE)
        written.append(RIG_FILE)
    write_json(folder / MACHINE, machine_document(package.states, package.changes, task))
    write_json(folder / NUMBERS, package.numbers())
    write_text(folder / REPORT, report_page(package, folder))
    return [*written, MACHINE, NUMBERS, REPORT]
