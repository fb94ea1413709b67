"""The comparison with published gaits, of a made-up file: which families are replayed, on which slopes."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import published_gaits
from benchmarks.published_gaits import LACKING, draw, evaluate, table


def made(family, count=5):
    """Rows of a family: climber, generation, heading, pressure, f, phi, distance."""
    return [[n, n, 45.0, 1000.0 * n, [n % 9] * 10, [0] * 10, 0.1 * n + len(family)] for n in range(count)]


@pytest.fixture
def played(monkeypatch):
    """Slopes and headings that were simulated; distances are those that the pressures of :func:`made` tell."""
    seen = []

    def simulate(designs, terrain, **_):
        seen.extend((terrain.slope, design.orientation) for design in designs)
        return SimpleNamespace(distance=np.array([design.pressure / 1e4 for design in designs]))

    monkeypatch.setattr(published_gaits, "simulate", simulate)
    return seen


def test_every_family_of_the_file_is_replayed_on_its_slope(tmp_path, played):
    """Those in which heading is free, too, like any."""
    names = ("control_flat", "control_hill", "orientation_shape_control_hill")
    path = tmp_path / "gaits.json"
    path.write_text(json.dumps({"about": "made up", **{name: made(name) for name in names}}))
    rows = draw(path, 7, seed=1)
    assert [family for family, _ in rows] == [names[0]] * 3 + [names[1]] * 2 + [names[2]] * 2
    distances = evaluate(rows, "f32", copies=2)
    assert played == [(0.0, 45.0)] * 6 + [(15.0, 45.0)] * 8
    assert np.allclose(distances, [[row[3] / 1e4] * 2 for _, row in rows])
    page, passes = table(rows, distances, "f32", 1)
    assert "7 evaluations of the published experiment, drawn with seed 1 from 3 of its 6 families," in page
    assert LACKING in page and not passes  # families are told apart by a length that was not simulated


def test_a_page_of_all_families_lacks_none(tmp_path, played):
    names = [f"{free}_{place}" for free in ("control", "shape_control", "all") for place in ("flat", "hill")]
    path = tmp_path / "gaits.json"
    path.write_text(json.dumps({name: made(name) for name in names}))
    rows = draw(path, 12, seed=1)
    page, _ = table(rows, evaluate(rows, "f32", copies=1), "f32", 1)
    assert "from 6 of its 6 families" in page and LACKING not in page
