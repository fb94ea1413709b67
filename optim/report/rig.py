"""What the pneumatic rig's limits say of a gait."""

from typing import Any

from optim.report.markup import Html, Section, Text, joined, number, paragraph, table
from robots.hardware import KPA_PER_UNIT
from robots.hardware.headroom import AT_THE_LIMIT, EXCEEDED, NEAR_THE_LIMIT, WITHIN, RigReport, Use

KPA_PER_PSI = KPA_PER_UNIT["psi"]
KINDS = {EXCEEDED: "bad", AT_THE_LIMIT: "warn", NEAR_THE_LIMIT: "warn", WITHIN: "good"}


def rig_section(report: RigReport, default: bool, simulated: float) -> tuple[Section, dict[str, Any]]:
    """The section of a page, and the same for machines.

    Args:
        report: what a gait asks of the rig.
        default: whether it is the default rig.
        simulated: time of the gait in the simulation [s].
    """
    names = "the default rig" if default else "this rig"
    refused = f"It exceeds a limit of {names}, and is refused: it cannot be exported as it is."
    verdict = refused if report.exceeded else f"It keeps every limit of {names}."
    slower = f", {report.playing_s / simulated:.1f} times the {simulated:.1f} s of the simulation" if simulated else ""
    time = (
        f"It takes {report.shaping_s:.1f} s to give the body its shape, then {report.playing_s:.1f} s for "
        f"{report.states} states of {_range(report)}{slower}."
    )
    header = [
        "Channel",
        "Pressure, kPa",
        "Allowed, kPa",
        "Pressure, psi",
        "Allowed, psi",
        "Rate, kPa/s",
        "Allowed, kPa/s",
        "Verdict",
    ]
    content = [
        paragraph(joined([Html(f"<strong>{verdict}</strong>"), time], " "), "note" if report.exceeded else ""),
        table("What the gait asks of each channel (gauge pressures)", header, map(_row, report.uses)),
        paragraph(
            "Near: more than 90 % of a limit. Channels start vented; columns of the gait last until the slowest "
            "of them is done."
        ),
    ]
    document = {
        "exceeded": report.exceeded,
        "shaping_s": report.shaping_s,
        "playing_s": report.playing_s,
        "channels": [
            {
                "names": use.names,
                "lowest_kpa": use.lowest_kpa,
                "highest_kpa": use.highest_kpa,
                "fastest_kpa_per_s": use.fastest_kpa_per_s,
                "verdict": use.verdict,
            }
            for use in report.uses
        ],
    }
    return Section("On the pneumatic rig", content), document


def _range(report: RigReport) -> str:
    low, high = f"{report.shortest_state_s:.1f}", f"{report.longest_state_s:.1f}"
    return f"{low} s each" if low == high else f"{low} to {high} s each"


def _row(use: Use) -> list[Text]:
    limits, share = use.channel, max(use.shares, key=lambda name: use.shares[name])
    what = "" if use.verdict == WITHIN else f" ({share})"
    return [
        _name(use.names),
        _span(use.lowest_kpa, use.highest_kpa),
        _span(limits.minimum_kpa, limits.maximum_kpa),
        _span(use.lowest_kpa / KPA_PER_PSI, use.highest_kpa / KPA_PER_PSI),
        _span(limits.minimum_kpa / KPA_PER_PSI, limits.maximum_kpa / KPA_PER_PSI),
        number(use.fastest_kpa_per_s, 1),
        number(limits.slew_kpa_per_s, 1),
        Html(f'<span class="{KINDS[use.verdict]}">{use.verdict}</span>{what}'),
    ]


def _span(low: float, high: float) -> Html:
    return Html(f'<span class="whole">{number(low, 1)} to {number(high, 1)}</span>')


def _name(names: tuple[str, ...]) -> str:
    """Channels in words, such as ``bladders 1 to 8``."""
    kind, first = names[0].rstrip("0123456789"), names[0].lstrip("abcdefghijklmnopqrstuvwxyz")
    if len(names) == 1:
        return f"{kind} {first}".strip()
    last = names[-1].lstrip("abcdefghijklmnopqrstuvwxyz")
    if names[-1].rstrip("0123456789") != kind:
        return ", ".join(_name((name,)) for name in names)
    return f"{ {'foot': 'feet'}.get(kind, kind + 's') } {first} to {last}"
