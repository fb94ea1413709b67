"""Rows of chapter 5 in the table of docs/reproduction.md."""

import re
from typing import Any

from reproduction_rows import DOCS, Row, band, percent, reproduced, summary

from optim.experiments.tables import select
from optim.measures.statistics import mean_interval
from optim.studies.chapter5.experiments import EXPERIMENTS
from optim.studies.chapter5.metrics import STUDY as METRICS
from optim.studies.chapter5.sensitivity import UNCHANGED, Sensitivity

CHANGES = len(Sensitivity().variants) - 1  # of the study's full budget, without the unchanged robot


def gaits() -> list[Row]:
    """Gaits made by hand, friction, slopes, and the published gaits."""
    slopes, friction = summary("slope-sweep"), summary("friction-sweeps")
    speed, rows = dict[tuple[str, int], float](), list[Row]()
    fixed = {"share": "100 %", "command": reproduced("slope-sweep"), "seeds": "0, of starts"}
    published = {("rolling", 0): 0.1753, ("rolling", 15): -0.5743, ("inching", 0): 0.0603, ("inching", 15): 0.0246}
    for (gait, slope), value in published.items():
        (own,) = select(slopes["rows"], gait=gait, slope=float(slope))
        speed[gait, slope] = own["mean"]
        inside = own["lowest"] <= value <= own["highest"]
        here, n = (
            f"{own['mean']:.4f}, sd {own['deviation']:.4f}, {own['lowest']:.4f} to {own['highest']:.4f}",
            f"{own['copies']} copies",
        )
        differs = (
            "nothing: it lies among our copies"
            if inside
            else "one run of another program, outside of our copies: contact is chaotic"
        )
        rows.append(Row(f"{gait} by hand, {slope} degrees [BL/s]", f"{value}", here, n, differs=differs, **fixed))
    shapes = (speed["rolling", 0] + speed["inching", 15]) / 2
    rows.append(
        Row(
            "rolling on flat ground, inching on the hill, mean [BL/s]",
            "0.0998",
            f"{shapes:.4f}",
            n="8 copies each",
            differs="inching on the hill is one run there; its own maxima make 0.0999",
            **fixed,
        )
    )
    far = friction["largest_deviation"]
    copies = friction["rows"][0]["copies"]
    beyond = [max(row["lowest"] - row["published"], row["published"] - row["highest"]) for row in friction["rows"]]
    outside = [distance for distance in beyond if distance > 5e-5]  # digits that are published
    rows.append(
        Row(
            f"inching over friction, {far['of']} points [BL/s]",
            "0.0603 to -0.0014",
            f"largest difference {far['difference']:+.4f}; {far['within']} within {friction['tolerance']:g}",
            f"{copies} copies each",
            "100 %",
            reproduced("friction-sweeps"),
            "0, of starts",
            f"at {len(outside)} points the published run lies outside of our copies, by {min(outside):.4f} to "
            f"{max(outside):.4f}: more than the scatter of one program; [point by point](#friction)",
        )
    )
    found = slopes["transition"]
    rows.append(
        Row(
            "slope at which inching overtakes rolling [degrees]",
            "none simulated; hardware rolls up to about 9",
            f"{found['slope']:.2f} [{found['low']:.2f}, {found['high']:.2f}]",
            n="8 copies, 16 slopes",
            differs="hardware rolls on: here a stroke no longer tips the robot over its edge from 4 degrees on",
            **fixed,
        )
    )
    page = (DOCS / "published-gaits.md").read_text()
    (error,), (rank,) = (
        re.findall(r"5 mm\): \*\*([\d.]+)\*\*", page),
        re.findall(r"correlation: \*\*([\d.]+)\*\*", page),
    )
    ((count, families),) = re.findall(r"^(\d+) evaluations .* from (\d) of its 6 families", page, re.M)
    rows.append(
        Row(
            "published gaits, distance: median error / max(3 %, 5 mm); rank correlation",
            "0; 1",
            f"{error}; {rank}",
            f"{count} of 1915 gaits, 3 copies",
            f"{families} of 6 families",
            "python benchmarks/published_gaits.py published_gaits.json",
            "1",
            "the file holds no gait of the searches with all free",
        )
    )
    return rows + _hardware()


def _hardware() -> list[Row]:
    """Speeds measured on hardware, and those of the setting that agrees best."""
    found, rows = summary("hardware-friction"), list[Row]()
    best, measured = found["best"], {"inching, wood": 0.01, "inching, acrylic": 0.007, "rolling, wood": 0.05}
    measured |= {"inching up 14°, wood": 0.008}
    same = {key: best[key] for key in ("timing", "weight", "inflation", "ground")}
    agrees = f"within a factor of {found['agrees_within']}, in the best of {len(found['sets'])} settings"
    for condition, value in measured.items():
        (own,) = (row for row in select(found["rows"], condition=condition, **same) if row["mean"] == best[condition])
        rows.append(
            Row(
                f"hardware: {condition} [BL/s]",
                f"{value} (measured)",
                band(own, 4),
                f"{own['n']} copies",
                "not published",
                reproduced("hardware-friction", "medium"),
                "0, of starts",
                agrees if own["mean"] > 0 else "it slides down: [why](hardware-speeds.md)",
            )
        )
    return rows


PUBLISHED_CLIMBERS, PUBLISHED_GENERATIONS = 60, 200
EVALUATIONS = PUBLISHED_CLIMBERS * (PUBLISHED_GENERATIONS + 1)  # of a row on a terrain


def searches() -> list[Row]:
    """The table of searches, and what searches found on the hill."""
    found = summary("shape-change")
    climbers, generations = found["settings"]["climbers"], found["settings"]["generations"]
    made = climbers * (generations + 1)
    about = {
        "n": f"{climbers} climbers",
        "share": f"{percent(made / EVALUATIONS)}: {made:,} of {EVALUATIONS:,} evaluations",
        "command": f"{reproduced('shape-change')} --set climbers={climbers} --set generations=50",
        "seeds": f"{found['settings']['seed']}",
    }
    searched = [row for row in found["rows"] if "climbers" in row and row["published"]]
    budget = f"{climbers} of {PUBLISHED_CLIMBERS} climbers, {generations} of {PUBLISHED_GENERATIONS} generations"
    rows = list[Row]()
    for row in searched:
        places = [place for place in ("flat", "hill") if f"{place}_mean" in row["published"]]
        told = [f"{place}_{what}" for place in places for what in ("mean", "max")]
        ours = [_with_band(found, row["row"], place, row) for place in places]
        what = "; ".join(f"{place} mean, max" for place in places)
        rows.append(
            Row(
                f"{_spoken(row['row'])}: {what} [BL/s]",
                ", ".join(f"{row['published'][name]:.4f}" for name in told),
                "; ".join(ours),
                differs=f"{budget}; [more](#table-of-simulation-results)",
                **about,
            )
        )
    return rows + _on_the_hill()


def _spoken(row: str) -> str:
    return row if row.startswith("rolling") else f"searches with {row} free"


def _with_band(found: Any, row: str, place: str, values: Any) -> str:
    """Mean of the climbers after the last generation, with its interval, and their best."""
    (experiment,) = (each for each in EXPERIMENTS if each.row == row and each.place == place)
    last = {name: curve[-1] for name, curve in found["curves"][experiment.name].items()}
    return f"{band(last, 4)}, {values[f'{place}_max']:.4f}"


def _on_the_hill() -> list[Row]:
    """What studies of the hill, of parameters and of metrics of the soft robot found."""
    rows = list[Row]()
    hunt, climb = summary("gait-hunt"), summary("gait-climb")
    judged = hunt["searches"]
    first, best = judged["hill-climb"], max(judged.values(), key=lambda each: each["speed"])
    for found, differs in (
        (first, f"{first['evaluations']} evaluations for 12,060"),
        (best, f"{best['evaluations']} evaluations, of whole cycles; the best is {best['best']:.4f}"),
    ):
        rows.append(
            Row(
                f"hill of 15 degrees, {found['label']} [BL/s]",
                "0.0158, best of 60 climbers",
                band(found, 4, "speed"),
                f"{found['runs']} runs",
                "100 % of what the study plans",
                reproduced("gait-hunt", "full"),
                "0 to 4",
                differs,
            )
        )
    seeds = climb["seeds"]
    speeds = [seed["speed"] for seed in seeds]
    low, high = mean_interval(speeds)
    rows.append(
        Row(
            "hill of 15 degrees, program of searches [BL/s]",
            "0.0158, best of 60 climbers",
            f"{sum(speeds) / len(speeds):.3f} [{low:.3f}, {high:.3f}]: {', '.join(f'{each:.4f}' for each in speeds)}",
            f"{len(seeds)} runs of 5",
            f"{percent(len(seeds) / 5)} of what the study plans",
            reproduced("gait-climb", "medium") + f" --set 'seeds=[{','.join(str(seed['seed']) for seed in seeds)}]'",
            ", ".join(str(seed["seed"]) for seed in seeds),
            "steps that begin with what flat ground taught; planned on seed 0 ([how](hill-gait.md))",
        )
    )
    rows.append(_sensitivity())
    rows.append(_metrics())
    return rows


def _metrics() -> Row:
    """The largest metrics of the soft robot."""
    found = summary("soft-robot-metrics")
    rows = [row for row in found["rows"] if row["threshold"] == "lenient" and row["M_CI"] is not None]
    bests = {name: max(rows, key=lambda row, name=name: row[name]) for name in ("M_L", "M_CI")}
    told = [f"{row[name]:.3f} [{row[name + '_low']:.3f}, {row[name + '_high']:.3f}]" for name, row in bests.items()]
    gaits, most = found["gaits"], METRICS.scales["full"]
    share = len(rows) * gaits / (len(most.bodies) * most.gaits)
    return Row(
        "largest M_L and M_CI of the soft robot",
        "proposed, no value",
        ", ".join(told),
        f"{len(rows)} bodies, {gaits} gaits each",
        f"{percent(share)}: {len(rows)} of {len(most.bodies)} bodies, {gaits} of {most.gaits} gaits",
        reproduced("soft-robot-metrics", "medium"),
        str(found["seed"]),
        "[random gaits](#learnability-and-interference) hardly hold on a hill; bodies that feel have them, below",
    )


def _sensitivity() -> Row:
    """How many behaviours survive changes of parameters."""
    changed = [row for row in summary("hand-gait-sensitivity")["rows"] if row["parameter"] != UNCHANGED]
    told = [row["survives"] for row in changed if row["survives"] is not None]
    changes = len({(row["parameter"], row["factor"]) for row in changed})
    return Row(
        "changes of parameters that a gait survives",
        '"could be adjusted"',
        f"{sum(told)} of {len(told)}",
        f"{changed[0]['copies']} copies",
        f"{percent(changes / CHANGES)}: {changes} of {CHANGES} changes",
        reproduced("hand-gait-sensitivity", "full"),
        "0, of starts",
        "not of stiffness, weight, resolution and longer steps ([which](#sensitivity))",
    )
