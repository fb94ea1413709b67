"""Design under uncertainty on the command line."""

import json

import pytest
from articulated_files import CRAWLER
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


def test_the_best_gait_is_judged_on_draws_that_the_search_never_saw(morpholab, simulator, tmp_path):
    code, out, _ = morpholab(f"codesign {SEARCH} --generations 1 --out runs/a --json")
    assert code == 0 and "robust.json" in json.loads(out)["files"]
    seen = {terrain for call in simulator.calls[:-1] for terrain in call.terrain}
    assert len(seen) == 4 and len(simulator.calls[-1].terrain) == 64 and not seen & set(simulator.calls[-1].terrain)
    found = json.loads((tmp_path / "runs/a/robust.json").read_text())
    told = found["terrains"]["hill:9"]
    assert found["risk"] == "cvar:0.25" and (told["draws"], told["share"], told["failed"]) == (64, 0.25, 0)
    assert told["worst"] <= told["cvar"] <= told["mean"] and told["mean_low"] < told["mean"] < told["mean_high"]


def test_simulate_tells_mean_deviation_tail_and_worst(morpholab, simulator):
    line = "simulate --gait rolling --slope 9 --uncertain friction=20%,slope=1 --draws 8"
    code, out, _ = morpholab(line)
    assert code == 0 and "speed over 8 held-out draws: mean " in out and "CVaR 0.2 " in out and "worst " in out
    (call,) = simulator.calls
    assert len(call.terrain) == 8 and all(8 <= terrain.slope <= 10 for terrain in call.terrain)
    simulator.diverges = lambda design, terrain: terrain.slope > 9
    code, out, _ = morpholab(f"{line} --json")
    assert code == 1 and json.loads(out)["failed"] > 0 and "mean" not in json.loads(out)


def test_summary_comparison_and_report_tell_of_held_out_draws(morpholab, simulator, tmp_path):
    for name, options in (("a", ""), ("b", "--seed 1"), ("c", "--seed 3 --climbers 4")):
        code, out, _ = morpholab(f"codesign {SEARCH} --generations 1 --out runs/{name} {options}")
        assert code == 0 and "hill:9: speed over 64 held-out draws: CVaR 0.25 " in out and "worst " in out
    code, out, _ = morpholab("compare runs/a runs/b runs/c")
    assert code == 0 and "hill:9, cvar (2 runs): " in out and "hill:9, worst (1 run): " in out
    code, out, _ = morpholab("compare runs/a runs/b runs/c --json")
    found = json.loads(out)["held_out"]
    robust = [json.loads((tmp_path / f"runs/{name}/robust.json").read_text())["terrains"]["hill:9"] for name in "abc"]
    means = [one["value"] for one in found if one["name"] == "mean"]
    assert sorted(means) == sorted([(robust[0]["mean"] + robust[1]["mean"]) / 2, robust[2]["mean"]])
    alone = [one for one in found if one["low"] is None]
    assert [(one["name"], one["runs"]) for one in alone] == [("worst", 1)] and alone[0]["high"] is None
    assert all(one["low"] <= one["value"] <= one["high"] for one in found if one not in alone)
    code, out, error = morpholab("report runs/a --out a.html --no-player")
    assert code == 0, error
    page = (tmp_path / "a.html").read_text()
    assert "The best design over held-out draws" in page and "CVaR 0.25" in page
    assert morpholab("report runs/a runs/b runs/c --no-player --out all.html")[0] == 0
    assert "Best designs over draws that no search saw" in (tmp_path / "all.html").read_text()
    (tmp_path / "runs/a/robust.json").write_text('{"terrains": {"hill:9": {"failed": 0}}}')
    assert morpholab("report runs/a --no-player --out later.html")[0] == 0
    assert "over held-out draws" not in (tmp_path / "later.html").read_text()


def test_runs_of_another_risk_are_not_compared(morpholab, simulator):
    for name, risk in (("a", "mean"), ("b", "worst")):
        line = f"codesign {SEARCH.replace('cvar:0.25', risk)} --generations 0 --out runs/{name}"
        assert morpholab(line)[0] == 0
    code, _, error = morpholab("compare runs/a runs/b")
    assert code == 2 and "are judged differently (risk null and" in error and error.count("\n") == 1


@pytest.mark.parametrize(("risk", "first"), [("worst", "worst "), ("cvar:0.3", "CVaR 0.3 "), ("mean", "mean ")])
def test_what_the_risk_names_is_told_first(morpholab, simulator, risk, first):
    code, out, _ = morpholab(f"simulate --gait rolling --slope 9 --uncertain slope=1 --draws 8 --risk {risk}")
    assert code == 0 and f"held-out draws: {first}" in out and out.count("95 % interval") == 2


def test_levels_and_timing_of_bladders_are_drawn(morpholab, simulator):
    code, _, _ = morpholab("simulate --gait rolling --uncertain levels=5%,timing=5% --draws 8")
    (call,) = simulator.calls
    levels = {float(level) for design in call.designs for level in design.schedule.inflation.ravel() if level}
    assert code == 0 and len(levels) > 8 and all(0.95 <= level <= 1 for level in levels)


def test_gaits_are_designed_in_water_where_drives_are_uncertain(morpholab, simulator, tmp_path):
    line = (
        "codesign --terrain water --encoding graded --columns 2 --climbers 2 --geometry small --generations 1 --quiet"
    )
    code, out, error = morpholab(f"{line} --uncertain levels=5%,timing=5% --draws 3 --out runs/a")
    assert code == 0, error
    assert "water: speed over 64 held-out draws: mean " in out
    code, _, error = morpholab(f"{line} --uncertain levels=5%,friction=5% --draws 3 --out runs/b")
    told = "uncertain: friction=0.05,levels=0.05 is not allowed in water, which has no ground; leave out friction\n"
    assert code == 2 and told in error and not (tmp_path / "runs/b").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--risk worst", "risk: worst is not allowed without --uncertain"),
        ("--draws 8", "draws: 8 is not allowed without --uncertain"),
        ("--uncertain slope=1 --draws 1001", "draws: 1001 is not allowed; give a whole number, at most 1000"),
        ("--uncertain slope=1 --judge", "judge: it is not allowed with --uncertain"),
        ("--uncertain mud=1", "uncertain: 'mud' is unknown"),
    ],
)
def test_bad_options_of_a_simulation_get_one_line(morpholab, simulator, options, message):
    code, _, error = morpholab(f"simulate --gait rolling {options}")
    assert code == 2 and message in error and error.count("\n") == 1 and not simulator.calls


def test_a_robot_without_the_quantity_is_refused_in_one_line(morpholab):
    code, _, error = morpholab("simulate --robot walker --uncertain friction=10% --draws 3")
    assert code == 2 and "walker has no friction to draw" in error and error.count("\n") == 1
    code, _, error = morpholab("simulate --robot walker --uncertain levels=10% --draws 3")
    assert code == 2 and "walker has no actuators to draw" in error and error.count("\n") == 1


FREEFORM = "--robot freeform --shape 3,2,2 --cycles 1 --frequency 12 --settling 0.02 --threads 1 --quiet --seed 2"
FREEFORM_UNKNOWN = "--uncertain friction=20%,slope=1 --uncertain levels=5%,timing=5% --risk worst --draws 3"


@pytest.mark.kernels
@pytest.mark.parametrize(
    "method", ["genetic --set population=4", pytest.param("gradient --climbers 2", marks=pytest.mark.slow)]
)
def test_freeform_robots_are_designed_under_uncertainty_and_resume_to_the_bit(morpholab, tmp_path, method):
    line = f"codesign {FREEFORM} {FREEFORM_UNKNOWN} --method {method}"
    code, out, error = morpholab(f"{line} --generations 2 --out runs/a")
    assert code == 0, error
    assert "flat: speed over 64 held-out draws: worst " in out
    assert morpholab(f"{line} --generations 1 --out runs/b")[0] == 0
    assert morpholab("codesign --resume --generations 2 --out runs/b --quiet --threads 1")[0] == 0
    assert log(tmp_path / "runs/a") == log(tmp_path / "runs/b")
    assert 'risk = "worst"' in (tmp_path / "runs/a/config.toml").read_text()


@pytest.mark.kernels
def test_robots_of_files_are_designed_for_slopes_that_are_uncertain(morpholab, tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    line = "codesign --robot crawler.xml --duration 0.1 --uncertain slope=2 --draws 2 --generations 1 --climbers 2"
    code, out, error = morpholab(f"{line} --out runs/a --quiet")
    assert code == 0 and "flat: speed over 64 held-out draws: mean " in out, error


@pytest.mark.slow
@pytest.mark.kernels
def test_a_search_that_meets_few_draws_at_a_time_resumes_to_the_bit(morpholab, tmp_path):
    line = f"codesign {FREEFORM} --uncertain friction=20%,slope=1 --draws 3 --method stochastic"
    settings = "--set candidates=2 --set moves=4 --set judging=2"
    code, out, error = morpholab(f"{line} {settings} --generations 8 --out runs/a")
    assert code == 0, error
    assert "flat: speed over 64 held-out draws: mean " in out
    assert morpholab(f"{line} {settings} --generations 3 --out runs/b")[0] == 0
    assert morpholab("codesign --resume --generations 8 --out runs/b --quiet --threads 1")[0] == 0
    assert log(tmp_path / "runs/a") == log(tmp_path / "runs/b")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            "--uncertain friction=20% --risk worst --method stochastic",
            "minibatch_size: 1 is not allowed with worst of several draws; give at least 2",
        ),
        (
            "--uncertain sliding=10%",
            "sliding=0.1 is not allowed; freeform robot has no sliding feet to draw",
        ),
        ("--draws 4", "draws: 4 is not allowed without uncertain"),
        ("--risk worst", "risk: worst is not allowed without uncertain"),
        (
            "--uncertain slope=5 --terrain hill:44",
            "slope=5.0 is not allowed on hill:44, as draws would be steeper than 45",
        ),
        ("--uncertain slope=1 --terrain water", "uncertain: slope=1.0 is not allowed in water, which has no ground"),
    ],
)
def test_bad_options_of_other_robots_get_one_line(morpholab, options, message):
    code, _, error = morpholab(f"codesign {FREEFORM} {options} --out runs/x")
    assert code == 2 and message in error and error.count("\n") == 1
