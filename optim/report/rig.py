"""What the pneumatic rig's limits say of a gait."""

from collections.abc import Sequence
from typing import Any

from optim.report.markup import Html, Section, Text, joined, number, paragraph, table
from robots.hardware import KPA_PER_UNIT
from robots.hardware.headroom import AT_THE_LIMIT, EXCEEDED, NEAR_THE_LIMIT, WITHIN, RigReport, Use
from robots.hardware.lines import spoken

HEADER = (
    *("Channel", "Pressure, kPa", "Allowed, kPa", "Pressure, psi", "Allowed, psi"),
    *("Rate, kPa/s", "Allowed, kPa/s", "Verdict"),
)
USE = ("names", "lowest_kpa", "highest_kpa", "fastest_kpa_per_s", "verdict")  # told of each channel
KINDS = {EXCEEDED: "bad", AT_THE_LIMIT: "warn", NEAR_THE_LIMIT: "warn", WITHIN: "good"}


def rig_section(report: RigReport, default: bool, simulated: float) -> tuple[Section, dict[str, Any]]:
    """The section of a page, and the same for machines; the simulated gait takes ``simulated`` seconds."""
    names = "the default rig" if default else "this rig"
    refused = f"It exceeds a limit of {names}, and is refused: it cannot be exported as it is."
    verdict = refused if report.exceeded else f"It keeps every limit of {names}."
    times = report.playing_s / simulated if simulated else 0.0
    slower = f", {times:.1f} times the {_seconds(simulated)} s of the simulation" if simulated else ""
    time = (
        f"It takes {_seconds(report.shaping_s)} s to give the body its shape, then {_seconds(report.playing_s)} s for "
        f"{report.states} states of {_range(report)}{slower}."
    )
    content = [
        paragraph(joined([Html(f"<strong>{verdict}</strong>"), time], " "), "note" if report.exceeded else ""),
        table("What the gait asks of each channel (gauge pressures)", HEADER, map(_row, report.uses)),
        paragraph(
            "Near: more than 90 % of a limit. Channels start vented; columns of the gait last until the slowest "
            "of them is done."
        ),
    ]
    told = {name: getattr(report, name) for name in ("exceeded", "shaping_s", "playing_s")}
    channels = [{name: getattr(use, name) for name in USE} for use in report.uses]
    return Section("On the pneumatic rig", content), {**told, "channels": channels}


def _range(report: RigReport) -> str:
    low, high = _seconds(report.shortest_state_s), _seconds(report.longest_state_s)
    return f"{low} s each" if low == high else f"{low} to {high} s each"


def _seconds(value: float) -> str:
    """A time to a tenth of a second, and short ones, as of the states of a wave, to two digits."""
    return f"{value:.1f}" if value >= 1 else f"{value:.2g}"


def _row(use: Use) -> list[Text]:
    limits, share = use.channel, max(use.shares, key=lambda name: use.shares[name])
    asked, allowed = (use.lowest_kpa, use.highest_kpa), (limits.minimum_kpa, limits.maximum_kpa)
    pressures = [_span(*ends, unit) for unit in (1.0, KPA_PER_UNIT["psi"]) for ends in (asked, allowed)]
    rates = number(use.fastest_kpa_per_s, 1), number(limits.slew_kpa_per_s, 1)
    why = "" if use.verdict == WITHIN else f" ({share})"
    return [_name(use.names), *pressures, *rates, Html(f'<span class="{KINDS[use.verdict]}">{use.verdict}</span>{why}')]


def _span(low: float, high: float, unit: float) -> Html:
    return Html(f'<span class="whole">{number(low / unit, 1)} to {number(high / unit, 1)}</span>')


def _name(names: Sequence[str]) -> str:
    """Channels in words, such as ``bladders 1 to 8``."""
    words = list(map(spoken, names))
    (kind, _, first), (last_kind, _, last) = words[0].partition(" "), words[-1].partition(" ")
    if len(words) == 1 or kind != last_kind:
        return ", ".join(words)
    return f"{ {'foot': 'feet'}.get(kind, kind + 's') } {first} to {last}"
