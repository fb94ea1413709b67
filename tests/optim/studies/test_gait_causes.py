"""The table of what gaits live on, weight of bladders or friction of the floor, and what the page says of it."""

import runpy
from pathlib import Path

import pytest

from optim.experiments.tables import column, read_records, select

ROOT = Path(__file__).parents[3]
SCRIPT = runpy.run_path(str(ROOT / "benchmarks/gait_causes.py"))
ROWS = read_records(ROOT / "docs/data/gait-causes.csv")


def test_the_page_has_the_table_of_the_committed_speeds():
    page = (ROOT / "docs/hill-gait.md").read_text()
    for part in SCRIPT["table_of"](ROWS).strip().split("\n\n"):
        assert part in page


def test_every_gait_was_played_as_often_under_every_condition():
    for name, slope in SCRIPT["CASES"]:
        own = select(ROWS, gait=name, slope=slope)
        conditions = [(row["weight"], row["floor"], row["copy"]) for row in own]
        assert len(set(conditions)) == len(conditions) == len(SCRIPT["WEIGHTS"]) * len(SCRIPT["FRICTION"]) * 5


def speed(gait, slope, weight, floor):
    return column(select(ROWS, gait=gait, slope=slope, weight=weight, floor=floor), "speed").mean()


@pytest.mark.parametrize("gait", ["inching", "both-genetic", "hill-cma", "hill-program"])
def test_no_climber_climbs_with_weight_alone_nor_on_wood_alone(gait):
    assert -0.011 < speed(gait, 15, "physical", "published") < 0.004
    assert speed(gait, 15, "published", "wood") < -0.1


def test_the_fastest_on_the_flat_loses_nothing():
    usual = speed("flat-genetic", 0, "published", "published")
    for weight in SCRIPT["WEIGHTS"]:
        for floor in SCRIPT["FRICTION"]:
            assert speed("flat-genetic", 0, weight, floor) > 0.96 * usual


@pytest.mark.parametrize(
    ("gait", "on_wood", "by_weight", "by_both"), [("inching", 0.8, 0.5, 0.86), ("rolling", 0.25, 0.01, 0.8)]
)
def test_the_page_tells_what_inching_and_rolling_lose(gait, on_wood, by_weight, by_both):
    usual = speed(gait, 0, "published", "published")
    found = [speed(gait, 0, *one) for one in (("published", "wood"), ("physical", "published"), ("physical", "wood"))]
    assert [1 - each / usual for each in found] == pytest.approx([on_wood, by_weight, by_both], abs=0.02)
