"""Pictures of the study of interference: beneficial mutations, curves over generations, paths of champions.

Source: dissertation, chapter 2, figures "raw", "best" and "trace".
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.figures import COLOURS, PAGE, figure, logarithmic, save_arrays
from optim.experiments.tables import write_table
from optim.measures.statistics import mean_band
from optim.plots.curves import draw_band
from optim.studies.chapter2.champions import Champions, typical
from optim.studies.chapter2.settings import ROBOTS, Interference, Treatment
from taichi_sim.base.arrays import Arrays, Floats

MOST_POINTS = 20_000  # of a panel; more are as dense
PATHS = dict(zip(ROBOTS, ("#D55E00", "#009E73", "#0072B2"), strict=True))
SHADES = ("#e8f3e8", "#f7ecec")  # better in both environments; better in one and worse in the other


def _layout(treatments: Sequence[Treatment]) -> tuple[list[str], list[str]]:
    """Rows and columns of panels."""
    rows = list(dict.fromkeys(treatment.row for treatment in treatments))
    return rows, [robot for robot in ROBOTS if any(treatment.robot == robot for treatment in treatments)]


@contextmanager
def _grid_of_treatments(
    treatments: Sequence[Treatment], path: Path, size: tuple[float, float], labels: tuple[str, str]
) -> Iterator[tuple[Any, dict[Treatment, Any]]]:
    """A figure with a panel each treatment: robots above the columns, ways to combine environments beside the rows."""
    rows, columns = _layout(treatments)
    shape: Any = {"nrows": len(rows), "ncols": len(columns), "sharex": True, "sharey": True}
    with figure(path, *size, letters="", **shape) as (drawn, panels):
        yield drawn, {each: panels[rows.index(each.row), columns.index(each.robot)] for each in treatments}
        for axes, robot in zip(panels[0], columns, strict=True):
            axes.set_title(robot)
        for axes, row in zip(panels[:, -1], rows, strict=True):
            axes.annotate(row, (1.04, 0.5), xycoords="axes fraction", rotation=-90, va="center")
        drawn.supxlabel(labels[0], fontsize=8)
        drawn.supylabel(labels[1], fontsize=8)


def draw_changes(mutations: Mapping[Treatment, tuple[Floats, NDArray[np.int32]]], path: Path) -> None:
    """Beneficial mutations in two environments, a panel each treatment, coloured by generation; numbers as ``.npz``."""
    rows, columns = _layout(list(mutations))
    reach = 1.05 * max(1.0, *(np.abs(changes).max(initial=0.0) for changes, _ in mutations.values()))
    latest = max(1, *(int(born.max(initial=0)) for _, born in mutations.values()))
    size = 0.9 + 1.75 * len(columns), 0.5 + 1.65 * len(rows)
    labels = "nearer to the light in the first environment [m]", "in the second [m]"
    marks: Any = {"s": 3, "lw": 0, "vmin": 0, "vmax": latest, "cmap": "viridis", "rasterized": True, "zorder": 2}
    arrays: Arrays = {}
    with _grid_of_treatments(list(mutations), path, size, labels) as (drawn, panels):
        points: Any = None
        for treatment, (changes, born) in mutations.items():
            axes, name = panels[treatment], f"{treatment.robot}_{treatment.row}"
            arrays |= {f"{name}_change": changes, f"{name}_generation": born}
            axes.fill_between([0, reach], 0, reach, color=SHADES[0], lw=0)
            axes.fill_between([-reach, 0], 0, reach, color=SHADES[1], lw=0)
            axes.fill_between([0, reach], -reach, 0, color=SHADES[1], lw=0)
            axes.plot([-reach, reach], [-reach, reach], color="0.75", lw=0.5, zorder=1)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
            chosen = np.linspace(0, len(born) - 1, min(len(born), MOST_POINTS)).astype(int)
            points = axes.scatter(*changes[chosen].T, c=born[chosen], **marks)
        drawn.colorbar(points, ax=list(drawn.axes), label="generation", fraction=0.03, aspect=40)
    save_arrays(path.with_suffix(".npz"), arrays)


def draw_curves(curves: Mapping[Treatment, Floats], path: Path) -> None:
    """Worst distance and fitness over generations: means of runs with 95 % bands; a column each robot."""
    rows, columns = _layout(list(curves))
    shape: Any = {"nrows": 1 + len(rows), "ncols": len(columns), "sharex": True, "sharey": "row"}
    with figure(path, PAGE, 1.0 + 1.25 * (1 + len(rows)), letters="", **shape) as (_, panels):
        for treatment, values in curves.items():
            row, column = rows.index(treatment.row), columns.index(treatment.robot)
            for n, axes in enumerate((panels[0, column], panels[1 + row, column])):
                low, high = mean_band(values[..., n])
                colour, generations = COLOURS[row % len(COLOURS)], np.arange(values.shape[1])
                mean = values[..., n].mean(axis=0)
                draw_band(axes, generations, mean, low, high, colour=colour, label=treatment.row)
        panels[0, 0].set_ylabel("worst distance [m]")
        panels[0, 0].set_ylim(bottom=0)
        for axes, name in zip(panels[1:, 0], rows, strict=True):
            axes.set_ylabel(f"best fitness, {name}")
            _scale_by_decades(axes)
        for axes, robot in zip(panels[0], columns, strict=True):
            axes.set_title(robot)
        for axes in panels[-1]:
            axes.set_xlabel("generation")
        panels[0, -1].legend()


def _scale_by_decades(axes: Any) -> None:
    """A logarithmic scale whose few labels are plain numbers, also within a decade."""
    from matplotlib.ticker import LogLocator

    logarithmic(axes, "y")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1,) if high > 30 * low else (1, 2, 5) if high > 4 * low else "all"))


def draw_traces(champions: Mapping[Treatment, Champions], settings: Interference, path: Path) -> None:
    """Paths of a typical champion of each treatment, from above, with the lights; numbers as CSV.

    Typical is the champion with the median worst distance (the better of two).
    """
    from matplotlib.ticker import MultipleLocator

    rows, columns = _layout(list(champions))
    data: list[tuple[Any, ...]] = []
    chosen = {treatment: typical(seen) for treatment, seen in champions.items()}
    every = np.concatenate([settings.lights, *(seen.paths[chosen[t]].reshape(-1, 2) for t, seen in champions.items())])
    low, high = np.nanmin(every, axis=0) - 1, np.nanmax(every, axis=0) + 1
    width, height = high - low
    size = PAGE, 0.6 + (6.2 / len(columns) * height / width + 0.15) * len(rows)
    with _grid_of_treatments(list(champions), path, size, ("x [m]", "y [m]")) as (_, panels):
        for treatment, seen in champions.items():
            axes, run, colour = panels[treatment], chosen[treatment], PATHS[treatment.robot]
            for n, ((x, y), line) in enumerate(zip(settings.lights, seen.paths[run], strict=True)):
                axes.plot(x, y, "*", color="#E69F00", ms=10, mec="0.3", mew=0.4, zorder=3)
                axes.plot(*line.T, color=colour, lw=0.8, ls=("-", "--", "-.", ":")[n % 4])
                axes.plot(*line[-1], "o", color=colour, ms=3)
                moments = zip(seen.times.tolist(), *line.T.tolist(), seen.light[run, n].tolist(), strict=True)
                data += [(treatment.row, treatment.robot, run, n, *moment) for moment in moments]
            axes.plot(0, 0, "s", color="black", ms=3, zorder=3)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.yaxis.set_major_locator(MultipleLocator(5))
    header = ("fitness", "robot", "run", "environment", "time", "x", "y", "light")
    write_table(path.with_suffix(".csv.gz"), header, data)
