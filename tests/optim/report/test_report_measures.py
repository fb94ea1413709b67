"""Pages of what a robot's body does to learning, and what other commands say of its folder."""

import json
import re

import pytest

pytestmark = pytest.mark.kernels

MEASURE = "measure --robot vehicle --design 162 --success 'closest <= 0.075' --grid 5 --quiet --threads 1 --out m"


def test_measures_of_a_body_have_a_page(morpholab, tmp_path):
    """Shares, M1 to M4 and senses; the folder was called one without a run."""
    assert morpholab(f"{MEASURE} --climbers 2 --generations 2 --runs 2")[0] == 0
    found = json.loads((tmp_path / "m/metrics.json").read_text())
    code, out, error = morpholab("report m --out page.html --json --quiet")
    assert (code, error) == (0, "")
    document, page = json.loads(out), (tmp_path / "page.html").read_text()
    assert document == document | {"kind": "measures", "controllers": 25, "environments": 4, "climbers": 2}
    assert document["metrics"] == {name: value for name, value in found.items() if name != "folder"}
    shown = {float(value) for value in re.findall(r'<data value="([^"]+)"', page)}
    shares = [found["learnability"], found["resistance"], *found["each"], found["mutations"]["worst"]]
    assert shown >= {share[name] for share in shares for name in ("value", "low", "high") if share[name] is not None}
    for text in ("M_L", "M_CI", "M1, missing to the bound", "closest &lt;= 0.075", *found["environments"]):
        assert text in page, text
    code, _, error = morpholab("compare m")
    said = "run: m holds no run; m is a study, of which `morpholab report` makes a page"
    assert code == 2 and error.strip().endswith(said)
    (tmp_path / "m/metrics.json").write_text("{}")
    code, _, error = morpholab("report m --out other.html")
    assert code == 2 and "m/metrics.json: 'environments' is missing" in error and error.count("\n") == 1
    (tmp_path / "m/metrics.json").unlink()
    code, _, error = morpholab("report m --out other.html")
    assert code == 2 and "run: m has measures that are not complete; run their command to the end" in error


def test_a_page_without_climbers(morpholab, tmp_path):
    """M_L and M_CI alone; shares of nothing are dashes."""
    assert morpholab(MEASURE.replace("0.075", "0.00000001"))[0] == 0
    assert morpholab("report m --out page.html --quiet")[0] == 0
    page = (tmp_path / "page.html").read_text()
    assert "M_CI" in page and "M1" not in page and "Homeostasis" not in page
