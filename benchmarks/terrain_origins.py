"""Draw from where terrains, props and lights count, seen from above: ``python benchmarks/terrain_origins.py``."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from robots.lattice_robot.props import placed
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "terrain-origins.webp"
EDGE, CELLS = 0.01, (6, 4, 2)  # of the voxels [m]
FILE = 0.16, 0.1  # lengths of an array of heights [m]
BEGINS = 0.07  # START of stairs [m]
PROP = Terrain.parse("flat+box:0.02,0.03,0.02,0.08,0.03").props or ()
GROUND, PLACED, EARTH = "#1f6f8b", "#b5531c", "#e9e4d8"


def main() -> None:
    """Draw a robot of voxels on an array of heights, stairs that begin, and a box."""
    body = body_from_array([[[1] * CELLS[2]] * CELLS[1]] * CELLS[0], Material(1e5, 1e3), EDGE)
    both = placed(body, PROP, np.array([1.0, 0.0, 0.0]), {})
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axes = figure.add_subplot()
    corner = -FILE[0] / 2, -FILE[1] / 2
    axes.add_patch(Rectangle(corner, *FILE, facecolor=EARTH, edgecolor=GROUND, ls=":"))
    axes.text(corner[0] + 0.003, -corner[1] - 0.007, "array of FILE.npy", color=GROUND)
    starts = both.body.start_positions + both.shift
    for number, (x, y, _) in enumerate(starts):
        colour = "0.75" if number < body.voxel_count else "#e3b795"
        axes.add_patch(Rectangle((x - EDGE / 2, y - EDGE / 2), EDGE, EDGE, facecolor=colour, edgecolor="white"))
    axes.axvline(BEGINS, color=GROUND, ls="--")
    axes.text(BEGINS + 0.002, corner[1] - 0.012, "stairs:...,START", color=GROUND)
    middle = starts[: body.voxel_count].mean(axis=0)
    axes.annotate("", (BEGINS, -0.03), (0, -0.03), arrowprops={"arrowstyle": "->", "color": GROUND})
    axes.text(0.03, -0.028, "START", color=GROUND)
    box = middle[0] + PROP[0].x, middle[1] + PROP[0].y
    axes.plot([middle[0], box[0], box[0]], [middle[1], middle[1], box[1]], color=PLACED)
    axes.text(box[0] - 0.02, middle[1] + 0.002, "X", color=PLACED)
    axes.text(box[0] + 0.002, middle[1] + 0.006, "Y", color=PLACED)
    axes.plot(0, 0, "o", color=GROUND, label="origin of the robot: centre of its first voxel")
    axes.plot(*middle[:2], "s", color=PLACED, label="middle of the robot: mean of its voxels' centres")
    axes.set(xlabel="x, ahead of the origin [m]", ylabel="y, to the left [m]", aspect="equal")
    axes.set(xlim=(-0.09, 0.14), ylim=(-0.07, 0.075))
    axes.set_xticks(np.arange(-0.05, 0.13, 0.05))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False, fontsize="small")
    figure.savefig(FIGURE, dpi=120, pil_kwargs={"lossless": True})


if __name__ == "__main__":
    main()
