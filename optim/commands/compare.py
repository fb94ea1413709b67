"""``morpholab compare``: which of several searches is better, by how much, and how sure that is."""

import argparse
import dataclasses
import glob
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import Report, options
from optim.commands.options import Command, Option, path_to
from taichi_sim.base.short_text import counted, decimal

if TYPE_CHECKING:
    from optim.runs.comparison import Curve
    from optim.runs.differences import Difference

PICTURES = (".png", ".svg", ".pdf")
COMMAND = Command(
    "compare",
    "compare runs",
    "Compare the best scores of runs: curves with confidence bands, effect sizes. Runs that differ in their seed only "
    "are one group.",
    (
        dataclasses.replace(options.RUNS, words="*"),
        Option(
            "label",
            "a group by name: runs, or folders of such, that a pattern matches, as in --label new='runs/new*'; "
            "repeatable, beside other runs or instead",
            metavar="NAME=PATTERN",
            several=True,
        ),
        options.by("(default: evaluations)"),
        path_to("out", "FILE", f"new picture of the curves ({', '.join(PICTURES)})"),
        Option("names", "of the groups, in their order, with commas between (default: methods)", metavar="NAMES"),
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Group, compare, draw."""
    from optim.runs import comparison
    from optim.runs.comparable import check_comparable
    from optim.runs.config import score_in
    from optim.runs.differences import differences_at
    from optim.runs.history import begun, read_histories, runs_below
    from optim.runs.robust import held_out
    from taichi_sim.base.claims import claimed_path, undone_if_it_fails

    if args.out and args.out.suffix.lower() not in PICTURES:
        raise ValueError(f"out: {args.out} is not allowed; its name must end in {', '.join(PICTURES)}")
    if args.out:
        args.held.enter_context(claimed_path("out", args.out))
    labels = _labelled(args.label or ())
    if not (args.runs or labels):
        raise ValueError("runs: none are given; name folders of runs, or groups by --label NAME=PATTERN")
    try:
        runs = runs_below((*labels, *args.runs))
    except ValueError as error:
        raise ValueError(f"{error}{_of_study(args.runs)}") from None
    histories, damaged = read_histories(runs, begun)
    check_comparable(histories)
    try:
        curves = _named(comparison.curves(histories, args.by, labels), args.names)
    except ValueError as error:
        raise (ValueError(f"{error}; left out: {damaged[0]}") if damaged else error) from None
    score = score_in(histories[0].config)
    end = comparison.shared_end(curves, args.by)
    differences = differences_at(curves, end)
    document = {
        "score": dataclasses.asdict(score),
        "by": args.by,
        "at": end,
        "groups": [dataclasses.asdict(comparison.standing(curve, end)) for curve in curves],
        "differences": [dataclasses.asdict(difference) for difference in differences],
        "maps": [dataclasses.asdict(one) for one in comparison.map_standings(curves, histories, args.by, end)],
        "held_out": [dataclasses.asdict(one) for one in held_out({curve.label: curve.folders for curve in curves})],
        "picture": None,  # unless it is written
    }

    def write() -> str:
        from optim.plots import save_curves

        with undone_if_it_fails() as made:  # also where it is written, but not that its folder has it
            made.append(args.out)
            save_curves(curves, args.by, args.out, score.label)
        document["picture"] = str(args.out)
        return str(args.out)

    report = Report(document, "\n".join(_lines(score.label, document, differences)))
    return (report.written_by(write) if args.out else report).but_for(damaged)


def _of_study(paths: Sequence[Path]) -> str:
    """What to do with the first path that is a study, which is not compared; empty where none is."""
    from optim.report.assembly import study_of

    study = next((path for path in paths if study_of(path)), None)
    return "" if study is None else f"; {study} is a study, of which `morpholab report` makes a page"


def _labelled(given: Sequence[str]) -> dict[Path, str]:
    """Labels of runs by their folders, as ``--label NAME=PATTERN`` gives them.

    Raises:
        ValueError: for what is no such text, matches no run, or labels one twice.
    """
    from optim.runs.history import runs_below

    labels: dict[Path, str] = {}
    for text in given:
        name, _, pattern = (part.strip() for part in text.partition("="))
        if not (name and pattern):
            raise ValueError(f"label: {text!r} is not allowed; give NAME=PATTERN, as in new=runs/new*")
        found = [Path(path) for path in sorted(glob.glob(pattern))]
        if not found:
            raise ValueError(f"label: nothing matches {pattern}, of {name}")
        same = {run.resolve(): run for run in labels}
        for run in runs_below(found):
            before = labels.setdefault(same.get(run.resolve(), run), name)
            if before != name:
                raise ValueError(f"label: {run} would be {before} and {name}; give it one label")
    return labels


def _named(curves: "list[Curve]", names: str | None) -> "list[Curve]":
    """Curves with the names that the user gives their groups."""
    if names is None:
        return curves
    given = [name.strip() for name in names.split(",")]
    if len(given) != len(curves) or not all(given):
        labels = "; ".join(curve.label for curve in curves)
        raise ValueError(f"names: {names!r} is not allowed; give {len(curves)}, one for each of {labels}")
    return [dataclasses.replace(curve, label=name) for curve, name in zip(curves, given, strict=True)]


def _difference(one: "Difference", unsuccessful: bool) -> str:
    """The line of a pair of groups; ``unsuccessful``: whether some have no success."""
    found, means = one.effect, "too few with success for a difference of means"
    ends = [decimal(each, "+") for each in (found.difference, found.low, found.high) if each is not None]
    if ends:
        means = f"{ends[0]} [{ends[1]}, {ends[2]}]{' of those with success' if unsuccessful else ''}"
    share, d = f"A12 {found.superiority:.2f}", "Cohen's d"
    if found.pairs:
        share, d = f"{found.pairs} pairs, higher in {found.superiority:.2f} of them", "Cohen's d of pairs"
    by = "" if found.cohens_d is None else f", {d} {found.cohens_d:.2f}"
    return f"  {one.second} minus {one.first}: {means}, {share}{by}, p {one.adjusted_p:.2g} ({found.test}, Holm)"


def _lines(score: str, document: dict[str, Any], differences: "list[Difference]") -> list[str]:
    at, by = document["at"], document["by"]
    end = f"{at:.3g} {by}" if by == "seconds" and at < 10 else counted(round(at), by[:-1])
    if by == "evaluations" and document["groups"][0]["unit"] == "climbers":
        end += " of each climber"
    lines = [f"best {score} after {end}: mean, its 95 % interval, best"]
    for group in document["groups"]:
        number = counted(group["count"], group["unit"][:-1])
        if group["without_success"]:
            number += f", {group['without_success']} without any success"
        if group["mean"] is None:
            lines.append(f"  {group['label']} ({number}): nothing succeeded")
            continue
        interval = "" if group["low"] is None else f" [{decimal(group['low'])}, {decimal(group['high'])}]"
        mean, best = decimal(group["mean"]), decimal(group["best"])
        lines.append(f"  {group['label']} ({number}): {mean}{interval}, best {best}")
    without = {group["label"] for group in document["groups"] if group["without_success"]}
    for difference in differences:
        lines.append(_difference(difference, bool(without & {difference.first, difference.second})))
    if not differences and len(document["groups"]) > 1:
        lines.append("  no effect sizes: that takes at least two runs a group, with other seeds")
    if document["maps"]:
        lines.append(f"maps of elites after {end}: mean over runs, 95 % interval")
    for one in document["maps"]:
        interval = "" if one["low"] is None else f" [{decimal(one['low'])}, {decimal(one['high'])}]"
        what = one["name"].replace("qd_score", "QD score")
        lines.append(f"  {one['label']}, {what} ({counted(one['runs'], 'run')}): {decimal(one['mean'])}{interval}")
    if document["held_out"]:
        lines.append("best designs over held-out draws: each number of a run, or its mean over runs, 95 % interval")
    for one in document["held_out"]:
        what = f"{one['label']}, {one['world']}, {one['name']} ({counted(one['runs'], 'run')})"
        interval = "" if one["low"] is None else f" [{decimal(one['low'])}, {decimal(one['high'])}]"
        lines.append(f"  {what}: {decimal(one['value'])}{interval}")
    return lines
