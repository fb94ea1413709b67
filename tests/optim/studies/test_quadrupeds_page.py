"""The page of measured quadrupeds tells what its committed data has."""

import csv
import gzip
import math
import re
from pathlib import Path

import pytest
from scipy import stats

from optim.experiments.data import Data

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = (DOCS / "quadrupeds-measured.md").read_text()
DATA = DOCS / "data" / "interference" / "at-3000"
ROBOTS = "legged", "wheeled", "whegged"
DIGITS = {"M1": (2, 2), "M2": (1, 1), "M3": (2, 2), "M4": (1, 1)}  # of our values, and of published ones


def defined(file):
    path = Data(DATA).path(file)
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return [row for row in csv.DictReader(text.splitlines()) if row["definition"] == "defined"]


def interval(row):
    """Student's 95 % interval of a mean over runs."""
    mean, runs = float(row["mean"]), int(row["runs"])
    half = stats.t.ppf(0.975, runs - 1) * float(row["deviation"]) / math.sqrt(runs)
    return mean, mean - half, mean + half


@pytest.mark.parametrize("fitness", ["min", "sum", "product"])
def test_tables_of_all_generations_are_those_of_the_data(fitness):
    """A last digit may differ by one, as the digits of decimals do that end in five."""
    lines = PAGE.split(f"| by {fitness} | legged | published |")[1].split("\n\n")[0].splitlines()[2:]
    told = {line.split("|")[1].split()[0]: [cell.strip() for cell in line.split("|")[2:-1]] for line in lines}
    assert list(told) == list(DIGITS)
    for row in defined("tables.csv"):
        if row["fitness"] != fitness:
            continue
        ours, published = told[row["measure"]][2 * ROBOTS.index(row["robot"]) :][:2]
        numbers = [float(each) for each in re.findall(r"[\d.]+", ours)]
        own, others = (0.51 * 10.0**-digits for digits in DIGITS[row["measure"]])
        assert numbers == pytest.approx(interval(row), abs=own), row
        assert float(published) == pytest.approx(float(row["published"]), abs=others), row


def test_as_many_published_means_lie_in_the_intervals_as_it_says():
    inside = 0
    for row in defined("tables.csv"):
        _, low, high = interval(row)
        inside += low <= float(row["published"]) <= high
    assert f"{inside} of the 36 published means" in PAGE


def test_as_many_pairs_differ_as_it_says():
    pairs = [row for row in defined("tests.csv") if row["measure"] == "M1"]
    differ = sum(float(row["p_bonferroni"]) < 0.05 for row in pairs)
    assert f"Of the {len(pairs)} pairs of treatments that share a robot or a fitness, {differ} differ in M1" in PAGE
