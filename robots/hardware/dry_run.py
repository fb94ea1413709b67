"""A gait on a rig without the rig: what would happen when, as a table."""

from typing import Any

from robots.hardware.rig_table import RigTable, State

_HEADINGS = ("state", "section", "start", "lasts", "waits for", "changes")


def timing_text(table: RigTable) -> str:
    """The states of a table that was made (not read), a line each, then durations, then what was clipped."""
    rows = [_HEADINGS, *(_cells(state) for state in table.timing)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADINGS))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lengths = ", ".join(f"{name} {length:g} s" for name, length in table.durations.items())
    played = f"main played {table.loops} time{'' if table.loops == 1 else 's'}"
    lines.append(f"{lengths}; {played}: {table.seconds:g} s in all")
    return "\n".join([*lines, *(f"clipped: {line}" for line in table.clipped)])


def timing_document(table: RigTable) -> dict[str, Any]:
    """The same as values that fit JSON, for machines."""
    states = [
        {
            "state": state.number,
            "section": state.section,
            "start_s": state.start_s,
            "end_s": state.end_s,
            "waits_for": state.slowest or None,
            "changes": list(state.changes),
        }
        for state in table.timing
    ]
    return {"states": states, "durations_s": dict(table.durations), "loops": table.loops}


def _cells(state: State) -> tuple[str, ...]:
    lasts = f"{state.end_s - state.start_s:.2f} s"
    changes = " ".join(state.changes) or "nothing"
    return (str(state.number), state.section, f"{state.start_s:.2f} s", lasts, state.slowest or "-", changes)
