"""Pictures and charts of the inflatable robot."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from motions import QUICK, STILL, TINY, posed

from robots.inflatable import INCHING, ROLLING, InflatableActuation, InflatableDesign, InflatableResult
from robots.inflatable.view.picture import inflatable_picture, save_motion_picture
from robots.inflatable.view.schedule_chart import draw_schedule
from robots.view import scene
from robots.world import Terrain


def test_a_chart_has_a_coloured_cell_for_every_bit():
    axes = Figure().add_subplot()
    draw_schedule(axes, INCHING.schedule)
    (cells,) = axes.collections
    off = np.isclose(cells.get_facecolor()[:, :3], scene.GROUND).all(axis=1)
    assert (~off).sum() == INCHING.schedule.played.sum() and off.size == INCHING.schedule.played.size
    assert axes.get_xlim() == (0, 16) and all(x % 1 == 0 for x in axes.get_xticks())
    assert [label.get_text() for label in axes.get_yticklabels()][0:9:8] == ["bladder 1", "foot 1"]


@pytest.mark.kernels
def test_the_picture_of_a_gait(tmp_path):
    for name, design, terrain in (("roll", ROLLING, Terrain()), ("inch", INCHING, Terrain(15.0))):
        path = tmp_path / f"{name}.png"
        result = save_motion_picture(design, terrain, path, geometry=TINY, actuation=QUICK, frames=4)
        assert result.status[0] == "ok" and len(result.frames.times) >= 4
        assert path.read_bytes().startswith(b"\x89PNG") and 20_000 < path.stat().st_size < 500_000
    figure = inflatable_picture(result, INCHING, Terrain(15.0), actuation=QUICK, frames=4)
    (title,) = figure.texts
    assert "BL/s up a slope of 15°; core at 0 kPa, heading 90°" in title.get_text()
    again = tmp_path / "again.png"
    save_motion_picture(INCHING, Terrain(15.0), again, geometry=TINY, actuation=QUICK, frames=4)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.kernels
def test_the_shortest_gait_has_a_picture(tmp_path):
    actuation = InflatableActuation(hold_steps=20, settle_steps=2)
    design = InflatableDesign(0.0, 0.0, STILL)
    save_motion_picture(design, Terrain(), tmp_path / "a.png", geometry=TINY, actuation=actuation)
    assert (tmp_path / "a.png").exists()


def test_the_picture_of_a_robot_that_diverged():
    frames = posed([(0.02 * i, 0, 0) for i in range(6)]).frames
    frames.positions[3:] = np.nan
    nothing = np.array([np.nan])
    status = np.array(["diverged"])
    numbers = nothing, nothing, nothing, status, nothing[:, None], np.array([50])
    result = InflatableResult(*numbers, 1e-4, frames, TINY.body, np.zeros((1, 2)))
    figure = inflatable_picture(result, ROLLING, Terrain())
    assert figure.texts[0].get_text().startswith("diverged on flat ground")
    assert len(figure.axes[0].texts) == 3 + 1  # the poses before, and the scale bar
    frames.positions[:] = np.nan
    assert inflatable_picture(result, ROLLING, Terrain()).texts[0].get_text().startswith("diverged")


def test_a_picture_needs_two_poses(tmp_path):
    with pytest.raises(ValueError, match=r"^frames: 1 is not allowed; give a whole number, at least 2$"):
        save_motion_picture(ROLLING, Terrain(), tmp_path / "a.png", geometry=TINY, frames=1)
    assert not any(tmp_path.iterdir())


@pytest.mark.long
def test_simulating_needs_no_matplotlib_and_pictures_neither_pyplot_nor_torch():
    program = (
        "import sys, robots.inflatable, robots.inflatable.view.shape\n"
        "print('matplotlib' in sys.modules)\n"
        "import robots.inflatable.view.picture\n"
        "print('matplotlib.pyplot' in sys.modules, 'torch' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert out.split() == ["False", "False", "False"]
