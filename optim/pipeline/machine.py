"""The state machine of shapes and terrains, as JSON and back; and its tables played: are they as fast as designed?"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress
from optim.pipeline.changes import Change
from optim.pipeline.plans import core_of
from optim.pipeline.task import PipelineTask, slug
from optim.pipeline.trials import State
from robots.calibration import Properties, robot_of
from robots.hardware import PneumaticRig, read_csv
from robots.hardware.rig_play import Play, play_tables
from robots.hardware.time_course import CourseDifference, course_difference
from robots.inflatable import simulation
from robots.inflatable.actuation import WEIGHTS
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.robustness import NOISE
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.checks import choice, number, whole_number
from taichi_sim.base.files import read_text
from taichi_sim.base.parsing import parse_json

FORMAT = "morpholab-state-machine-1"
MACHINE = "machine.json"
RULES = (
    "Begin in the initial state: play the prefix of its table, then its main again and again.",
    "When the terrain becomes that of another state, finish what is played, prefix or main, and go on to where 'on' "
    "says; play the prefix of the change's 'table' without its state 0, then the prefix of its 'entry' without its "
    "state 0, then the main of the next state's table again and again.",
    "A change without a table needs none, as the shape stays: its 'entry' follows at once.",
    "State 0 of a change's tables leads vented lines to where the table before leaves them: they are there already.",
    "To stop, finish the main and play the suffix.",
)


def machine_document(
    states: Sequence[State],
    changes: Mapping[tuple[str, str], Change | None],
    entries: Mapping[tuple[str, str], str],
    task: PipelineTask,
) -> dict[str, Any]:
    """The state machine as JSON; the first state is the initial one, and changes are None where the shape stays.

    Entries are names of the tables whose prefixes lead into the next state's gait.
    """
    simulated = {
        "geometry": task.geometry,
        "precision": task.precision,
        "runs": task.runs,
        "seed": task.seed,
        **({"properties": asdict(task.calibration)} if task.calibration else {}),
        **({} if task.weight == "published" else {"weight": task.weight}),
    }
    return {
        "format": FORMAT,
        "initial": states[0].name,
        "simulated": simulated,
        "states": [
            {
                "name": state.name,
                "terrain": state.terrain.document,
                "gait": f"gaits/{state.name}.json",
                "table": f"tables/{state.name}.csv",
                "pressure_pa": core_of(state.design),
                "orientation_deg": state.design.orientation,
                "speed_bl_per_s": state.speed,
            }
            for state in states
        ],
        "changes": [_change(pair, change, f"tables/{entries[pair]}.csv") for pair, change in changes.items()],
        "rules": list(RULES),
    }


def change_name(pair: tuple[str, str]) -> str:
    """The name of the files of a change from a state to another."""
    return f"{pair[0]}-to-{pair[1]}"


def entry_name(pair: tuple[str, str]) -> str:
    """The name of the table that leads from a state, or the change from it, into the gait of another."""
    return f"{change_name(pair)}-entry"


def _change(pair: tuple[str, str], change: Change | None, entry: str) -> dict[str, Any]:
    own: dict[str, Any] = {"from": pair[0], "to": pair[1], "on": None, "gait": None, "table": None, "entry": entry}
    if change is None:
        return own
    return own | {
        "on": slug(change.terrain),
        "gait": f"gaits/{change_name(pair)}.json",
        "table": f"tables/{change_name(pair)}.csv",
        "way": change.way,
        **asdict(change.judgement),
        "next_speed": change.next_speed,
        "faults": list(change.faults),
    }


def read_machine(folder: Path) -> dict[str, Any]:
    """The state machine of a package; raises ValueError for a folder that has none, or a damaged one."""
    path = folder / MACHINE
    if not path.is_file():
        raise ValueError(f"package: {folder} holds none; there is no {MACHINE}")
    try:
        document: dict[str, Any] = parse_json(read_text(path))
        if document["format"] != FORMAT or not document["states"]:
            raise ValueError
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"package: {path} is no state machine of a package") from None
    try:
        simulated = document["simulated"]
        choice("geometry", simulated["geometry"], NAMED_GEOMETRIES)
        choice("precision", simulated["precision"], ("f32", "f64"))
        whole_number("runs", simulated["runs"], 1)
        whole_number("seed", simulated["seed"], 0)
        choice("weight", weight_of(simulated), WEIGHTS)
        properties_of(simulated)
        for state in document["states"]:
            _check_state(state)
        for change in document["changes"]:
            _check_change(change, [state["name"] for state in document["states"]])
    except KeyError as missing:
        raise ValueError(f"package: {path} is damaged: {missing} is missing") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"package: {path} is damaged: {error}") from None
    return document


def properties_of(simulated: Mapping[str, Any]) -> Properties | None:
    """Properties of the robot that a package was made for; None if it is the published one."""
    return Properties(**simulated["properties"]) if "properties" in simulated else None


def weight_of(simulated: Mapping[str, Any]) -> str:
    """Weight of bladders that a package was made for."""
    return str(simulated.get("weight", "published"))


def _check_state(state: Mapping[str, Any]) -> None:
    """Check that the table of a state lies in the package and that its values are allowed."""
    _check_table("table", state["table"])
    Terrain(**state["terrain"])
    number("speed_bl_per_s", state["speed_bl_per_s"])
    if not isinstance(state["name"], str):
        raise ValueError(f"name: {state['name']!r} is not allowed; it must be a text")


def _check_change(change: Mapping[str, Any], names: Sequence[str]) -> None:
    """Check that a change leads from a state to another and that its tables lie in the package."""
    for end in ("from", "to"):
        choice(end, change[end], names)
    if change["table"] is not None:
        _check_table("table", change["table"])
    if "entry" in change:
        _check_table("entry", change["entry"])


def _check_table(field: str, given: str) -> None:
    table = Path(given)
    if table.is_absolute() or ".." in table.parts:
        raise ValueError(f"{field}: {given!r} is not allowed; it must be in the package")


def entry_of(machine: Mapping[str, Any], change: Mapping[str, Any]) -> str:
    """The table whose prefix leads into a gait after a change; that of its state in packages of earlier versions."""
    own: dict[str, str] = {state["name"]: state["table"] for state in machine["states"]}
    return str(change.get("entry", own[change["to"]]))


TOLERANCE = 0.05


@dataclass(frozen=True)
class Replayed:
    """A gait of a package."""

    name: str  # of the state
    designed: float  # mean speed that the package says [body lengths/s]
    replayed: float  # the same from the rows of its table
    course: CourseDifference  # of its rows from the gait in the simulator, over time
    on_rig: float | None = None  # mean speed in the rig's time while a rig plays the rows, if one is given

    @property
    def holds(self) -> bool:
        """Whether both agree within ``TOLERANCE``."""
        return bool(abs(self.replayed - self.designed) <= TOLERANCE * abs(self.designed))


def replay_package(
    folder: Path, progress: Progress = None, threads: int | None = None, rig: PneumaticRig | None = None
) -> list[Replayed]:
    """Play every gait of a package from the rows of its table, with the noise with which it was measured.

    Levels of rows are played at the simulator's rates, and their course over time is compared with the simulator's.
    With a rig, that plays the rows, too, in its own time.
    """
    machine = read_machine(folder)
    states, simulated = machine["states"], machine["simulated"]
    found: list[Replayed] = []
    geometry, actuation = robot_of(simulated["geometry"], weight_of(simulated), properties_of(simulated))
    runs = simulated["runs"]
    settings: dict[str, Any] = {
        "geometry": geometry,
        "actuation": actuation,
        "precision": simulated["precision"],
        "perturbation": NOISE,
        "seed": simulated["seed"],
        "threads": threads,
    }
    parts = len(states) * (1 if rig is None else 2)
    for state in states:
        table, ground = read_csv(folder / state["table"]), Terrain(**state["terrain"])
        run = simulation.simulate(
            [table.played()] * runs, ground, **settings, progress=part_of(progress, len(found), parts)
        )
        replayed = float(np.mean(run.speed))
        course = course_difference(table, actuation, geometry.time_step)
        found.append(Replayed(state["name"], state["speed_bl_per_s"], replayed, course))
    if rig is None:
        return found
    for place, state in enumerate(states):
        table, ground = read_csv(folder / state["table"]), Terrain(**state["terrain"])
        played = play_tables(
            [Play(table, rig, ground, copy=copy) for copy in range(runs)],
            **settings,
            progress=part_of(progress, len(states) + place, parts),
        )
        found[place] = replace(found[place], on_rig=float(np.mean(played.speed_simulated)))
    return found
