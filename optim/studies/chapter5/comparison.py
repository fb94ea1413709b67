"""What searches and gaits made by hand say of changing shape: the rows of the table, and tests between experiments."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from optim.measures.statistics import effect, mean_band, welch
from optim.studies.chapter5.champions import PLACES, Played
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PARTS, ROWS, Found, ShapeChange
from optim.studies.chapter5.gaits import spread
from optim.studies.chapter5.published import COMBINED, TABLE
from taichi_sim.base.arrays import Floats

OPEN = f"{'-'.join(PARTS)}-{HILL}"  # the experiment that rolling on the hill is held against
CHANGING = "changing shape by hand"


def summarise(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> dict[str, Any]:
    """Everything the study says, ready for JSON.

    Args:
        settings: of the study.
        found: by experiment, as far as they have come.
        played: gaits beside them.
    """
    rows = [*_searched(settings, found, played), *_by_hand(played)]
    return {
        "settings": asdict(settings),
        "rows": rows,
        "played": played.generation,
        "tests": tests(found),
        "curves": {name: curve(one.scores) for name, one in found.items()},
    }


def _searched(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> Iterator[dict[str, Any]]:
    for name in ROWS:
        row: dict[str, Any] = {"row": name, "evaluations": 0, "generations": None, "climbers": settings.climbers}
        for experiment in (e for e in EXPERIMENTS if e.row == name and e.name in found):
            one, place = found[experiment.name], experiment.place
            row["evaluations"] += one.evaluations
            row["generations"] = len(one.scores) - 1
            row[f"{place}_mean"] = float(one.final.mean()) if one.final.size else None
            row[f"{place}_max"] = float(one.final.max()) if one.final.size else None
            if experiment.name in played.again:
                row[f"{place}_max_again"] = spread(played.again[experiment.name])
        row[COMBINED] = _mean(row.get("flat_max"), row.get("hill_max"))
        row["one_design"] = best_on_both(
            {e.place: played.elsewhere[e.name] for e in EXPERIMENTS if e.row == name and e.name in played.elsewhere}
        )
        yield {**row, "published": dict(TABLE.get(name, {}))}


def _by_hand(played: Played) -> Iterator[dict[str, Any]]:
    gaits = {name: {place: spread(copies[place]) for place in PLACES} for name, copies in played.by_hand.items()}
    if gaits:
        rolling, inching = gaits.values()
        gaits[CHANGING] = {FLAT: rolling[FLAT], HILL: inching[HILL]}
    for name, places in gaits.items():
        speeds = {place: places[place]["mean"] for place in PLACES}
        combined = _mean(*speeds.values())
        one = None if name == CHANGING or combined is None else {"combined": combined, **speeds, "found_on": None}
        yield {
            "row": name,
            "evaluations": sum(int(places[place]["copies"] or 0) for place in PLACES),
            "generations": None,
            **{f"{place}_max": speeds[place] for place in PLACES},
            **{f"{place}_max_again": places[place] for place in PLACES},
            COMBINED: combined,
            "one_design": one,
            "published": dict(TABLE[name]),
        }


def best_on_both(elsewhere: Mapping[str, Floats]) -> dict[str, Any] | None:
    """The design that is fastest in the mean of both terrains.

    Args:
        elsewhere: by the terrain on which designs were found, their speeds there and on the other one, shape (2, n).

    Returns:
        Its speeds and where it was found; None if there is none that did not fail.
    """
    best: dict[str, Any] | None = None
    for place, (own, other) in elsewhere.items():
        means = np.nan_to_num((own + other) / 2, nan=-np.inf)
        index = int(np.argmax(means))
        if np.isfinite(means[index]) and (best is None or means[index] > best["combined"]):
            speeds = (own, other) if place == FLAT else (other, own)
            flat, hill = (float(values[index]) for values in speeds)
            best = {"combined": float(means[index]), FLAT: flat, HILL: hill, "found_on": place}
    return best


def tests(found: Mapping[str, Found]) -> list[dict[str, Any]]:
    """Rolling on the hill, in both readings, against the experiment in which all was free and random: Welch's t-test.

    The authors tested this pair so. Positive t and differences say that the open experiment found faster designs. Where
    both search the same variables, climber n of one draws the same random numbers for them as climber n of the other,
    which the test does not know: ``paired`` is the mean difference of such pairs, with its 95 % bootstrap interval;
    None elsewhere, and of other numbers of climbers.
    """
    if OPEN not in found:
        return []
    open_scores, results = found[OPEN].final, []
    for experiment in EXPERIMENTS[-2:]:
        if experiment.name not in found:
            continue
        control = found[experiment.name].final
        if min(len(control), len(open_scores)) > 1:
            test, size = welch(control, open_scores), effect(control, open_scores)
            alike = experiment.free == PARTS
            paired = _paired(found[experiment.name].scores[-1], found[OPEN].scores[-1]) if alike else None
            results.append(
                {
                    "control": experiment.name,
                    "open": OPEN,
                    "climbers": [len(control), len(open_scores)],
                    "welch": asdict(test),
                    "effect": asdict(size),
                    "paired": paired,
                }
            )
    return results


def _paired(control: Floats, open_scores: Floats) -> dict[str, float] | None:
    """How climbers differ from their counterparts, where neither has failed."""
    if len(control) != len(open_scores):
        return None
    differences = (open_scores - control)[~np.isnan(open_scores + control)]
    if not differences.size:
        return None
    low, high = mean_band(differences)
    return {
        "climbers": len(differences),
        "difference": float(differences.mean()),
        "low": float(low),
        "high": float(high),
    }


def curve(scores: Floats) -> dict[str, list[float | None]]:
    """Mean, its 95 % bootstrap band, and maximum of climbers over generations; scores of shape (G + 1, C).

    In each generation the climbers count that have found anything by then; None where none has.
    """
    points = [_spread(row[~np.isnan(row)]) for row in scores]
    return {name: [point[name] for point in points] for name in ("mean", "low", "high", "max")}


def _spread(scores: Floats) -> dict[str, float | None]:
    if not scores.size:
        return dict.fromkeys(("mean", "low", "high", "max"))
    low, high = mean_band(scores)
    return {"mean": float(scores.mean()), "low": float(low), "high": float(high), "max": float(scores.max())}


def _mean(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else (a + b) / 2
