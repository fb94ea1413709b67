"""Tables of a package: made so that each begins where the one before ends, and read back to check that they do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from optim.pipeline.handover import Handover, handover, handover_faults
from optim.pipeline.machine import change_name, entry_name, entry_of, read_machine
from optim.pipeline.task import FOUND, PipelineTask
from optim.pipeline.trials import State
from robots.hardware import PRESETS, GaitTable, PneumaticRig, gait_table, read_csv
from robots.inflatable.design import InflatableDesign

RIG = "rig.toml"  # of the package: what its tables were made for
Pair = tuple[str, str]  # names of states: from, to


@dataclass(frozen=True, eq=False)
class PackageTables:
    """All tables of a package."""

    files: Mapping[str, GaitTable]  # by the names of their files, without folder and ending
    entries: Mapping[Pair, str]  # those whose prefixes lead into the gaits of states


def package_tables(
    states: Sequence[State], changes: Mapping[Pair, InflatableDesign | None], task: PipelineTask
) -> PackageTables:
    """Make the tables of states, of changes of shape, None where it stays, and of entries that need their own.

    Raises:
        RigViolation: a ValueError, if the rig refuses one.
        ValueError: if tables that are played one after the other exceed limits of the rig.
    """
    designs = {state.name: state.design for state in states}
    files = {state.name: gait_table(state.design, task.rig, seed=seed_of(state, task)) for state in states}
    entries = dict[Pair, str]()
    for pair, change in changes.items():
        made = handover(designs[pair[0]], change, designs[pair[1]], task.rig)
        if faults := handover_faults(files[pair[0]], made, files[pair[1]], task.rig):
            raise ValueError(f"tables: {' to '.join(pair)}: {faults[0]}")
        if made.change is not None:
            files[change_name(pair)] = made.change
        entries[pair] = pair[1] if made.entry.start is None else entry_name(pair)
        files.setdefault(entries[pair], made.entry)
    return PackageTables(files, entries)


def seed_of(state: State, task: PipelineTask) -> int | None:
    """The seed of the search that found the gait of a state; None if it was given."""
    return task.seed if task.search is not None and state.gait.startswith(FOUND) else None


@dataclass(frozen=True)
class JoinedTables:
    """What the tables from a gait to the next ask of a rig, played one after the other."""

    name: str  # from where to where
    rig: str | None  # that the tables were made for; None if it is not known, and so nothing was checked
    faults: tuple[str, ...]  # limits of it that are exceeded

    def __str__(self) -> str:
        if self.rig is None:
            return f"{self.name}: not checked, as the rig is not known; name it with --rig"
        told = f"beyond the limits of the rig {self.rig}: {self.faults[0]}" if self.faults else ""
        more = f" ({len(self.faults) - 1} more)" if len(self.faults) > 1 else ""
        return f"{self.name}: tables are {told or f'within the limits of the rig {self.rig}'}{more}"


def check_changes(folder: Path, rig: PneumaticRig | None = None) -> list[JoinedTables]:
    """Check the tables of a package from every gait to every other, joined as its rules say, on the rig they are for.

    That is the package's own. Packages of earlier versions have none: then it is the preset that their tables name, or
    the one given.
    """
    machine, found = read_machine(folder), list[JoinedTables]()
    states = {state["name"]: read_csv(folder / state["table"]) for state in machine["states"]}
    own = PneumaticRig.load(folder / RIG) if (folder / RIG).is_file() else None
    for change in machine["changes"]:
        before, after = states[change["from"]], states[change["to"]]
        between = None if change["table"] is None else read_csv(folder / change["table"])
        entry = read_csv(folder / entry_of(machine, change))
        known = own or PRESETS.get(before.rig, rig)
        faults = () if known is None else handover_faults(before, Handover(between, entry), after, known)
        name = f"{change['from']} to {change['to']}"
        found.append(JoinedTables(name, None if known is None else known.name, tuple(faults)))
    return found
