"""The figure of co-optimisation, from its tables: environments solved, and homeostasis, against evaluations.

Source: dissertation, chapter 4, figure "neurips_cooptimization".
"""

from pathlib import Path

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, legend_above, letter, logarithmic
from optim.experiments.tables import read_table
from optim.plots.curves import draw_band
from optim.studies.chapter4.co_optimisation import ARMS


def draw(folder: Path) -> None:
    """Write ``co-optimisation.png`` beside the tables."""
    _, solved = read_table(folder / "environments-solved.csv")
    _, distances = read_table(folder / "homeostasis.csv.gz")
    with figure(folder / "co-optimisation.png", PAGE, 2.8, ncols=3) as (drawn, panels):
        for number, (arm, (label, _)) in enumerate(ARMS.items()):
            colour = COLOURS[number]
            rows = np.array([row[1:] for row in solved if row[0] == arm], float)
            draw_band(panels[0, 0], *rows[:, :4].T, colour=colour, label=label)
            for axes, signals in zip(panels[0, 1:], ("raw", "normalised"), strict=True):
                for solutions, style in (("solved", "-"), ("all", ":")):
                    chosen = [row[3:] for row in distances if row[:3] == [arm, signals, solutions]]
                    if not chosen:
                        continue
                    values = np.array(chosen, float)
                    axes.plot(values[:, 0], values[:, 5], style, color=colour)
        panels[0, 0].set(ylabel="environments solved", ylim=(0, 4.05), yticks=range(5))
        panels[0, 1].set_ylabel("median DTW distance [1/m$^2$]")
        panels[0, 2].set_ylabel("median DTW distance, normalised")
        for axes in panels.flat:
            axes.set_xlabel("evaluations")
        for axes in panels[0, 1:]:
            logarithmic(axes, "y")
        arms = panels[0, 0].get_legend_handles_labels()[0]
        kinds = (("solving all", "-"), ("all reported", ":"))
        legend_above(drawn, [*arms, *(panels[0, 1].plot([], [], f"k{style}", label=k)[0] for k, style in kinds)])
        letter(panels)
