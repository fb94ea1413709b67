"""Design under uncertainty on the command line."""

import pytest
from run_products import log, products

SEARCH = (
    "--terrain hill:9 --encoding graded --columns 2 --climbers 3 --geometry small --steps 60000 --seed 2 --quiet "
    "--uncertain friction=20% --uncertain slope=2 --risk cvar:0.25 --draws 4"
)


@pytest.mark.usefixtures("simulator")
def test_a_search_under_risk_resumes_to_the_bit(morpholab, tmp_path):
    assert morpholab(f"codesign {SEARCH} --generations 3 --out runs/a")[0] == 0
    assert morpholab(f"codesign {SEARCH} --generations 1 --out runs/b")[0] == 0
    assert morpholab("codesign --resume --generations 3 --out runs/b --quiet")[0] == 0
    ours, theirs = (products(tmp_path / "runs" / name) for name in "ab")
    assert ours["best.json"] == theirs["best.json"]
    assert [line["best"] for line in log(tmp_path / "runs/a")] == [line["best"] for line in log(tmp_path / "runs/b")]
    config = (tmp_path / "runs/a/config.toml").read_text()
    assert 'uncertain = "friction=0.2,slope=2.0"' in config and 'risk = "cvar:0.25"' in config
    code, _, error = morpholab("codesign --resume --risk worst --out runs/b --quiet")
    assert code == 2 and "problem.risk" in error


@pytest.mark.usefixtures("simulator")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--risk worst", "risk: worst is not allowed without uncertain"),
        ("--uncertain mud=1", "uncertain: 'mud' is unknown"),
        ("--uncertain friction=150%", "uncertain: friction=150% is not allowed; give 0% to 100%"),
        ("--uncertain slope=1 --risk cvar:0", "risk: 'cvar:0' is not allowed"),
    ],
)
def test_bad_options_of_a_search_get_one_line(morpholab, options, message):
    code, _, error = morpholab(f"codesign --terrain flat --geometry small --generations 1 --out new --quiet {options}")
    assert code == 2 and message in error and error.count("\n") == 1
