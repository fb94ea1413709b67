"""``morpholab measure``: the published numbers of vehicles, other robots, and going on."""

import json

import numpy as np
import pytest

from optim import cli
from optim.commands.measure import COMMAND
from optim.measures import learnability, resistance
from robots.braitenberg import VehicleBody, sweep

pytestmark = pytest.mark.kernels

CLOSE = ["--success", "closest <= 0.075"]


def measured(capsys, *words: str) -> dict:
    assert cli.main(["measure", *words, "--threads", "1", "--quiet", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_grid_of_weights_is_a_sweep(capsys, tmp_path):
    """With 121 values it gives the published 26 of 1830, and M_L of 0.1036; here with fewer."""
    for design in (162, 6553):
        words = "--robot", "vehicle", "--design", str(design), *CLOSE, "--grid", "21"
        found = measured(capsys, *words, "--out", str(tmp_path / str(design)))
        overlap = sweep([VehicleBody.published(design)], weights=21, threads=1)[0]
        assert found["learnability"]["value"] == learnability(overlap)
        assert found["resistance"]["value"] == resistance(overlap)
        assert found["learnability"]["of"] == 441 and len(found["each"]) == 4


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
    from optim.experiments.body_metrics import Measuring, controllers_of
    from optim.space import Space
    from robots.braitenberg.offered import VehicleRobot

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
