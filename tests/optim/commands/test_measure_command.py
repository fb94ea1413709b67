"""``morpholab measure``: the published numbers of vehicles, other robots, runs of climbers, and going on."""

import json

import numpy as np
import pytest
from scipy import stats

from optim import cli
from optim.commands.measure import COMMAND
from optim.experiments.body_metrics import Measuring, felt_by
from optim.measures import learnability, resistance
from robots.braitenberg import VehicleBody, sweep

pytestmark = pytest.mark.kernels

CLOSE = ["--success", "closest <= 0.075"]


def measured(capsys, *words: str) -> dict:
    assert cli.main(["measure", *words, "--threads", "1", "--quiet", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_grid_of_weights_is_a_sweep(capsys, tmp_path):
    """Each controller succeeds where the table of the sweep says."""
    for design in (162, 6553):
        words = "--robot", "vehicle", "--design", str(design), *CLOSE, "--grid", "21"
        found = measured(capsys, *words, "--out", str(tmp_path / str(design)))
        overlap = sweep([VehicleBody.published(design)], weights=21, threads=1)[0]
        assert found["learnability"]["value"] == learnability(overlap)
        assert found["resistance"]["value"] == resistance(overlap)
        assert found["learnability"]["of"] == 441 and len(found["each"]) == 4


def test_homeostasis_of_a_grid_is_not_that_of_its_corner():
    """The first that succeed lie side by side; controllers that are drawn are in no order, and stay the first."""
    points = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), indexing="ij"), axis=-1).reshape(-1, 2)
    drawn = felt_by(points, Measuring(grid=40, seed=1))
    assert len(np.unique(drawn, axis=0)) == 20 and (np.ptp(drawn, axis=0) > 25).all()
    assert np.array_equal(drawn, felt_by(points, Measuring(grid=40, seed=1)))
    assert not np.array_equal(drawn, felt_by(points, Measuring(grid=40, seed=2)))
    assert np.array_equal(felt_by(points, Measuring()), points[:20])
    assert np.array_equal(felt_by(points[:20], Measuring(grid=40)), points[:20])


def test_the_published_grid_gives_the_published_numbers(capsys, tmp_path):
    """Dissertation, chapter 4: 26 of 1830 controllers of design 6553; M_L and M_CI of design 162."""
    words = "--robot", "vehicle", *CLOSE, "--grid", "121", "--out"
    found = measured(capsys, *words, str(tmp_path / "6553"), "--design", "6553")
    assert (found["resistance"]["count"], found["resistance"]["of"]) == (26, 1830)
    found = measured(capsys, *words, str(tmp_path / "162"), "--design", "162")
    assert (found["learnability"]["of"], round(found["learnability"]["value"], 4)) == (121**2, 0.1036)
    assert round(found["resistance"]["value"], 4) == 0.6486


def test_it_goes_on_where_it_was(capsys, tmp_path):
    """Parts that are lost are computed again, to the same numbers; other settings are refused."""
    words = ["--robot", "vehicle", "--design", "162", *CLOSE, "--controllers", "300", "--climbers", "4"]
    words += ["--generations", "12", "--out", str(tmp_path / "a")]
    found = measured(capsys, *words)
    assert found["mutations"]["changes"] >= 1 and found["felt"]["controllers"] > 2
    assert found["felt"]["low"] <= found["felt"]["distance"] <= found["felt"]["high"]
    for name in ("controllers1", "climb12"):
        (lost,) = (tmp_path / "a").glob(f"{name}-*.npz")
        lost.unlink()
    assert measured(capsys, *words) == found == json.loads((tmp_path / "a" / "metrics.json").read_text())
    (short,) = (tmp_path / "a").glob("controllers0-*.npz")
    np.savez(short, succeeded=np.ones((3, 4), bool))  # of fewer controllers than were to be tried
    assert cli.main(["measure", *words, "--threads", "1", "--quiet", "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out) == found and "as good as missing (succeeded: shape (3, 4) is not allowed" in told.err
    assert cli.main(["measure", *words, "--seed", "1", "--quiet"]) == 2
    assert "of other settings" in capsys.readouterr().err


def climbing(runs: int) -> list[str]:
    words = ["--robot", "vehicle", "--design", "162", *CLOSE, "--controllers", "20", "--climbers", "2"]
    return [*words, "--generations", "12", "--runs", str(runs)]


def test_runs_of_climbers_have_means_with_intervals(capsys, tmp_path):
    """Student's t of the runs in ``metrics.json``; each run has random numbers of its own."""
    out = ["--out", str(tmp_path / "out")]
    measured(capsys, *climbing(4), *out)
    found = json.loads((tmp_path / "out" / "metrics.json").read_text())["mutations"]
    runs = found["runs"]
    assert len({run["worst"] for run in runs}) == len(runs) == 4
    assert found["changes"] == sum(run["changes"] for run in runs)
    for name in ("worst", "angle", "length", "share"):
        values = [run[name] for run in runs if run[name] is not None]
        low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), stats.sem(values))
        told = found[name]
        assert (told["value"], told["low"], told["high"]) == pytest.approx((np.mean(values), low, high))
        assert told["counted"] == len(values) >= 2
    assert cli.main(["measure", *climbing(4), *out, "--threads", "1", "--quiet"]) == 0
    worst = found["worst"]
    told = f"M1 {worst['value']:.4g} ({worst['low']:.4g} to {worst['high']:.4g}) of the bound missing, M2 "
    said = capsys.readouterr().out
    assert f", {found['changes']} of the champions of 4 runs: {told}" in said


def test_what_is_missing_to_a_bound_of_0_has_a_unit(capsys, tmp_path):
    """There are no parts of 0 m."""
    words = "--robot", "vehicle", "--controllers", "4", "--climbers", "2", "--generations", "1", "--threads", "1"
    for n, (bound, told) in enumerate(((0, "m missing, M2 "), (9, "of the bound missing, M2 "))):
        out = "--out", str(tmp_path / str(n))
        assert cli.main(["measure", *words, "--success", f"closest <= {bound}", *out, "--quiet"]) == 0
        (line,) = [each for each in capsys.readouterr().out.splitlines() if "M1 " in each]
        assert line.partition("M1 ")[2].partition(" ")[2].startswith(told)


def test_more_runs_go_on(capsys, tmp_path):
    """A folder of one run, as all were before there were several, takes more; so does one whose work was killed."""
    one = measured(capsys, *climbing(1), "--out", str(tmp_path / "a"))["mutations"]
    assert one["worst"] == {"value": one["runs"][0]["worst"], "low": None, "high": None, "counted": 1}
    assert "runs" not in json.loads((tmp_path / "a" / "measures.json").read_text())
    kept = {path.name: path.read_bytes() for path in (tmp_path / "a").glob("*.npz")}
    assert len([name for name in kept if name.startswith("climb")]) == 3 and not any("run" in name for name in kept)
    several = measured(capsys, *climbing(3), "--out", str(tmp_path / "a"))
    assert several["mutations"]["runs"][0] == one["runs"][0]
    assert all((tmp_path / "a" / name).read_bytes() == content for name, content in kept.items())
    at_once = measured(capsys, *climbing(3), "--out", str(tmp_path / "b"))
    assert at_once["mutations"] == several["mutations"]
    for path in (*(tmp_path / "b").glob("run1climb12-*"), *(tmp_path / "b").glob("run2*"), tmp_path / "b/metrics.json"):
        path.unlink()  # as a kill in the second run leaves it
    assert measured(capsys, *climbing(3), "--out", str(tmp_path / "b")) == at_once
    assert measured(capsys, *climbing(1), "--out", str(tmp_path / "b"))["mutations"] == one


def test_the_first_run_has_the_random_numbers_of_the_only_one():
    """Folders of before go on: these are seed, generation and purpose, and of further runs their number."""
    from optim.experiments.body_metrics import Climb, Environments, Tries
    from optim.space import Space
    from robots.braitenberg.robot import VehicleRobot
    from robots.tasks import Success
    from taichi_sim.base.compute import Compute

    robot = VehicleRobot(VehicleBody.published(162))
    space, close = Space(tuple(robot.parameters)), (Success.parse("closest <= 0.075"),)
    tries = Tries(robot, Environments(robot.worlds, (close,) * 4), Compute(threads=1))
    first, second = (Climb(space, tries, Measuring(climbers=3, seed=7, runs=2), run) for run in range(2))
    assert np.array_equal(first.first()["points"], space.sample(np.random.default_rng((7, 0, 1)), 3))
    assert np.array_equal(second.first()["points"], space.sample(np.random.default_rng((7, 0, 1, 1)), 3))
    assert (first.name(10), second.name(10)) == ("climb10", "run1climb10")


def test_runs_without_mutations_are_left_out_of_means(capsys, tmp_path):
    """A single mutation helps in some runs only; of how many a mean is, is told."""
    words = ["--robot", "vehicle", "--design", "6553", *CLOSE, "--controllers", "2", "--climbers", "1"]
    words += ["--generations", "1", "--runs", "8", "--out", str(tmp_path / "out")]
    found = measured(capsys, *words)["mutations"]
    some = sum(run["changes"] > 0 for run in found["runs"])
    assert 2 <= some < 8 and [run["angle"] is None for run in found["runs"]].count(False) == some
    assert [found[name]["counted"] for name in ("worst", "angle", "length", "share")] == [8, some, some, some]
    assert cli.main(["measure", *words, "--threads", "1", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert f" degrees in {some} runs, M3 " in said and "missing in" not in said and "nan" not in said


def test_quadrupeds_and_bounds_of_their_own(capsys, tmp_path):
    """Environments are places of the light; each may ask for something else."""
    words = ["--robot", "legged", "--looks", "40", "--environments", "9,0", "--environments", "0,9"]
    words += [
        "--success",
        "light >= 0",
        "--success",
        "approach >= 100",
        "--controllers",
        "6",
        "--out",
        str(tmp_path / "q"),
    ]
    found = measured(capsys, *words)
    assert [each["count"] for each in found["each"]] == [6, 0]
    assert found["learnability"]["count"] == 0 and found["felt"] is None and found["mutations"] is None


def test_lattice_robots(capsys, tmp_path):
    """Walkers on planes; what diverges succeeds nowhere."""
    words = ["--robot", "soft-quadruped", "--environments", "flat", "--environments", "hill:5"]
    words += ["--success", "speed >= -10", "--controllers", "3", "--precision", "f32", "--out", str(tmp_path / "s")]
    found = measured(capsys, *words)
    assert [each["count"] for each in found["each"]] == [3, 3] and found["environments"] == ["flat", "hill:5"]


def test_lattice_robots_that_feel(capsys, tmp_path):
    """Soft ones have climbers and a homeostasis distance, too."""
    words = ["--robot", "feeling-quadruped", "--environments", "flat", "--environments", "hill:5"]
    words += ["--success", "speed >= -10", "--controllers", "2", "--climbers", "2", "--generations", "1"]
    found = measured(capsys, *words, "--runs", "2", "--precision", "f32", "--out", str(tmp_path / "s"))
    assert found["learnability"]["count"] == 2
    assert found["felt"]["controllers"] == 2 and 0 < found["felt"]["distance"] < np.inf
    mutations = found["mutations"]
    assert mutations["worst"]["counted"] == 2 and mutations["changes"] >= 1
    assert all(run["worst"] < 0 for run in mutations["runs"])  # they keep so low a bound
    assert all(0 <= run["angle"] <= 180 for run in mutations["runs"] if run["changes"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([*CLOSE, "--grid", "1"], "argument --grid: "),
        (["--success", "speed >= 1"], "success: 'speed' is unknown; choose one of approach, closest, solved"),
        (CLOSE * 2, "success: 2 are not allowed for 4 environments; give one, or one each"),
        ([*CLOSE, "--environments", "7"], "environment: '7' is not allowed; give a whole number from 1 to 4"),
        (["--success", "fast"], "argument --success: 'fast' is not allowed; give MEASURE >= NUMBER"),
        ([*CLOSE, "--grid", "2000"], "grid: 2000 values of 2 variables are too many"),
        ([*CLOSE, "--controller", "1,1"], "robot: nothing of vehicle 162 is free, so it has no controllers"),
        ([*CLOSE, "--runs", "3"], "runs: 3 is not allowed without climbers"),
        ([*CLOSE, "--grid", "3", "--controllers", "9"], "controllers: 9 is not allowed beside --grid"),
    ],
)
def test_bad_input(capsys, tmp_path, words, message):
    """One line, and no folder."""
    out = tmp_path / "out"
    try:
        code = cli.main(["measure", "--robot", "vehicle", "--design", "162", *words, "--out", str(out)])
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2 and message in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.kernels
def test_what_none_succeeds_in_has_no_number(capsys, tmp_path):
    """M_CI of no controllers, and M2 to M4 of no mutations; and what a controller is made of is told."""
    words = "measure --robot vehicle --success closest<=1e-9 --controllers 2 --climbers 2 --generations 1 --json"
    assert cli.main([*words.split(), "--quiet", "--out", str(tmp_path / "out")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["learnability"]["value"] == 0 and found["resistance"]["of"] == 0
    assert [found["resistance"][name] for name in ("value", "low", "high")] == [None] * 3
    words = words.replace(" --json", "")
    assert cli.main([*words.split(), "--quiet", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "2 controllers, each with values of its own of l1x, l1y, l2x, l2y, w1, w2" in told
    assert "M_CI, of those that succeed in any: none" in told and "nan" not in told


def test_controllers_of_a_seed_are_always_the_same(tmp_path):
    """Whatever their number: the first are those of fewer."""
    from optim.experiments.body_metrics import controllers_of
    from optim.space import Space
    from robots.braitenberg.robot import VehicleRobot

    space = Space(tuple(VehicleRobot(VehicleBody.published(162)).parameters))
    few, many = (np.concatenate(controllers_of(space, Measuring(count, seed=3))) for count in (256, 600))
    assert np.array_equal(few, many[:256]) and len(many) == 600


def test_a_robot_is_required(capsys, tmp_path):
    """The usual one has a gait, of which nothing is free."""
    assert cli.main(["measure", "--success", "speed >= 0.1", "--out", str(tmp_path / "none")]) == 2
    error = capsys.readouterr().err
    assert "robot: measure needs one of which something is free; give --robot, such as pouch, feeling-quadr" in error
    assert error.count("\n") == 1 and not (tmp_path / "none").exists()
    told = next(option.help for option in COMMAND.options if option.name == "robot")
    assert "(required)" in told and "default" not in told
