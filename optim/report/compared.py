"""The page's sections of several runs: each in a line, their curves, and how they differ."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from optim.plots.curves import draw_curves
from optim.problem import Objective
from optim.report.markup import Html, Section, charted, code, number, paragraph, table
from optim.report.one_run import OneRun
from optim.runs import comparison
from optim.runs.comparison import Axis, Standing
from optim.runs.differences import Difference, differences_at
from optim.runs.robust import HeldOut, held_out
from taichi_sim.base.short_text import counted


def comparison_sections(runs: Sequence[OneRun], axis: Axis) -> tuple[list[Section], dict[str, Any]]:
    """Sections of several runs whose scores mean the same, also for machines; raises ValueError for others."""
    curves = comparison.curves([run.history for run in runs], axis)
    end = comparison.shared_end(curves, axis)
    standings = [comparison.standing(curve, end) for curve in curves]
    differences = differences_at(curves, end)
    score, counted_by = runs[0].subject.score, comparison.spoken_axis(curves, axis)

    def draw(axes: Any) -> None:
        draw_curves(axes, curves, axis)
        axes.set_ylabel(Objective(f"best {score.name} so far", score.unit).label)

    alt = f"Best {score.name} of {counted(len(curves), 'group')} over {counted_by}, mean and 95 % band"
    caption = "Best so far: mean of each group, its 95 % band, and every unit as a thin line."
    compared = [
        charted(draw, alt, caption, size=(5.0, 3.0), kind="medium"),
        _standings(standings, Objective(f"Best scores at {end:g} {counted_by}", score.unit).label),
        _differences(differences, any(one.without_success for one in standings)),
    ]
    robust = held_out({curve.label: curve.folders for curve in curves})
    if robust:
        compared.append(_held_out(robust, score))
    document = {
        "by": axis,
        "at": end,
        "groups": list(map(asdict, standings)),
        "differences": list(map(asdict, differences)),
        **({"held_out": list(map(asdict, robust))} if robust else {}),
    }
    return [Section("The runs", [_overview(runs)]), Section("How they compare", compared)], document


def _overview(runs: Sequence[OneRun]) -> Html:
    rows = []
    for run in runs:
        last, config = run.last, run.history.config
        method, done = config["method"], f"{last.generation} of {config['generations']}"
        named = code(str(run.history.path)), method["name"], str(method.get("seed", "")), run.state, done
        rows.append((*named, last.evaluations, number(last.best), number(last.mean)))
    header = ("Run", "Method", "Seed", "State", "Generations", "Evaluations", "Best", "Mean")
    return table(f"{len(runs)} runs", header, rows)


def _standings(standings: Sequence[Standing], caption: str) -> Html:
    rows = [(one.label, _units(one), *map(number, (one.mean, one.low, one.high, one.best))) for one in standings]
    return table(caption, ("Group", "Of", "Mean", "95 % from", "to", "Best"), rows)


def _units(one: Standing) -> str:
    without = f", {one.without_success} without any success" if one.without_success else ""
    return counted(one.count, one.unit[:-1]) + without


def _held_out(found: Sequence[HeldOut], score: Objective) -> Html:
    rows = [
        (one.label, one.world, one.name, counted(one.runs, "run"), *map(number, (one.value, one.low, one.high)))
        for one in found
    ]
    caption = Objective("Best designs over draws that no search saw", score.unit).label
    return table(caption, ("Group", "World", "Number", "Of", "Value", "95 % from", "to"), rows)


def _differences(differences: Sequence[Difference], unsuccessful: bool) -> Html:
    if not differences:
        return paragraph("No effect sizes: that takes at least two groups of two runs each, with other seeds.")
    rows = []
    for one in differences:
        effect, p = one.effect, number(one.adjusted_p, 3)
        sizes = number(effect.superiority, 2), number(effect.cohens_d, 2)
        means = map(number, (effect.difference, effect.low, effect.high))
        rows.append((f"{one.second} minus {one.first}", *means, *sizes, p, _test(one)))
    header = ("Difference", "Of means", "95 % from", "to", "A12", "Cohen's d", "p (Holm)", "Test")
    caption = "Effect sizes"
    if any(one.effect.pairs for one in differences):
        caption += "; of pairs that began alike, A12 is the share in which the second is higher, d that of differences"
    if unsuccessful:
        caption += (
            "; differences and Cohen's d of those with success, where two of each group have any; A12 and p of all, "
            "those without below all others"
        )
    return table(caption, header, rows)


def _test(one: Difference) -> str:
    """The test of a difference, and which starts both groups share."""
    if one.effect.pairs:
        return f"{one.effect.test}, {counted(one.effect.pairs, 'pair')}"
    return f"{one.effect.test}, {counted(one.shared_starts, 'start')} shared" if one.shared_starts else one.effect.test
