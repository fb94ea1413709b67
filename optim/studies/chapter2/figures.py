"""Pictures of the study of interference: beneficial mutations, curves over generations, paths of champions.

Source: dissertation, chapter 2, figures "raw", "best" and "trace".
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, figure, logarithmic, save_arrays
from optim.experiments.tables import Record, column, select, write_records
from optim.plots.curves import draw_band
from optim.studies.chapter2.curves import Mutations
from optim.studies.chapter2.settings import ROBOTS, ROWS, Lights, Place
from taichi_sim.base.arrays import Arrays, Floats

MOST_POINTS = 20_000  # of a panel; more are as dense
PATHS = dict(zip(ROBOTS, ("#D55E00", "#009E73", "#0072B2"), strict=True))
TALLEST = 3.0  # height of a panel of paths per width
LARGEST_CHANGE = 1e4  # m, of a distance from the light in a file
KNOWN = f"{', '.join(ROBOTS)} and {'; '.join(ROWS)}"  # robots and rows
SHADES = ("#e8f3e8", "#f7ecec")  # better in both environments; better in one and worse in the other


def _layout(places: Iterable[Place]) -> tuple[list[str], list[str]]:
    """Rows and columns of panels."""
    rows, robots = zip(*places, strict=True)
    return list(dict.fromkeys(rows)), [robot for robot in ROBOTS if robot in robots]


def _outermost(panels: NDArray[Any], kept: NDArray[np.bool_]) -> tuple[list[Any], list[Any]]:
    """Leave other panels blank; number, and give, the lowest of each column and the leftmost of each row."""
    for axes in panels[~kept]:
        axes.set_axis_off()
    lowest = [column[shown][-1] for column, shown in zip(panels.T, kept.T, strict=True)]
    leftmost = [row[shown][0] for row, shown in zip(panels, kept, strict=True)]
    for axes in lowest:
        axes.tick_params(labelbottom=True)
    for axes in leftmost:
        axes.tick_params(labelleft=True)
    return lowest, leftmost


@contextmanager
def _grid_of_treatments(
    places: Sequence[Place], path: Path, size: tuple[float, float], labels: tuple[str, str]
) -> Iterator[tuple[Any, dict[Place, Any]]]:
    """A figure with a panel each treatment: robots above the columns, ways to combine environments beside the rows."""
    rows, columns = _layout(places)
    shape: Any = {"nrows": len(rows), "ncols": len(columns), "sharex": True, "sharey": True}
    with figure(path, *size, letters="", **shape) as (drawn, panels):
        yield drawn, {(row, robot): panels[rows.index(row), columns.index(robot)] for row, robot in places}
        _outermost(panels, np.array([[(row, robot) in places for robot in columns] for row in rows]))
        for axes, robot in zip(panels[0], columns, strict=True):
            axes.set_title(robot)
        for axes, row in zip(panels[:, -1], rows, strict=True):
            axes.annotate(row, (1.04, 0.5), xycoords="axes fraction", rotation=-90, va="center")
        drawn.supxlabel(labels[0], fontsize=8)
        drawn.supylabel(labels[1], fontsize=8)


def draw_changes(mutations: Mapping[Place, Mutations], path: Path) -> None:
    """Beneficial mutations in two environments, a panel each treatment, coloured by generation.

    Their numbers are written as ``.npz``, to the millimetre.
    """
    shown = {place: (np.round(changes.astype(float), 3), born) for place, (changes, born) in mutations.items()}
    rows, columns = _layout(shown)
    reach = 1.05 * max(1.0, *(np.abs(changes).max(initial=0.0) for changes, _ in shown.values()))
    latest = max(1, *(int(born.max(initial=0)) for _, born in shown.values()))
    size = 0.9 + 1.75 * len(columns), 0.5 + 1.65 * len(rows)
    labels = "nearer to the light in the first environment [m]", "in the second [m]"
    marks: Any = {"s": 3, "lw": 0, "vmin": 0, "vmax": latest, "cmap": "viridis", "rasterized": True, "zorder": 2}
    with _grid_of_treatments(list(shown), path, size, labels) as (drawn, panels):
        points: Any = None
        for place, (changes, born) in shown.items():
            axes = panels[place]
            axes.fill_between([0, reach], 0, reach, color=SHADES[0], lw=0)
            axes.fill_between([-reach, 0], 0, reach, color=SHADES[1], lw=0)
            axes.fill_between([0, reach], -reach, 0, color=SHADES[1], lw=0)
            axes.plot([-reach, reach], [-reach, reach], color="0.75", lw=0.5, zorder=1)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
            chosen = np.linspace(0, len(born) - 1, min(len(born), MOST_POINTS)).astype(int)
            points = axes.scatter(*changes[chosen].T, c=born[chosen], **marks)
        drawn.colorbar(points, ax=list(drawn.axes), label="generation", fraction=0.03, aspect=40)
    arrays: Arrays = {}
    for (row, robot), (changes, born) in shown.items():
        arrays |= {f"{robot}_{row}_change": changes.astype(np.float32), f"{robot}_{row}_generation": born}
    save_arrays(path.with_suffix(".npz"), arrays)


def read_changes(data: Data, file: str) -> dict[Place, Mutations]:
    """Read the numbers of :func:`draw_changes`; raises ValueError for what is no mutation in two environments."""
    places = [name.removesuffix("_change") for name in data.array_names(file) if name.endswith("_change")]
    arrays = data.arrays(file, [f"{place}_{kind}" for place in places for kind in ("change", "generation")])
    found = dict[Place, Mutations]()
    for place in places:
        name, born = f"{place}_change", f"{place}_generation"
        robot, _, row = place.partition("_")
        changes, generations = arrays[name], arrays[born]
        if row not in ROWS or robot not in ROBOTS:
            raise ValueError(f"{data.folder / file}: {name} is of no treatment; give robot_row of {KNOWN}")
        whole = changes.dtype.kind == "f" and changes.ndim == 2 and changes.shape[1] == 2
        if not whole or not (np.abs(changes) <= LARGEST_CHANGE).all():
            told = f"{name} has shape {changes.shape} of {changes.dtype}"
            raise ValueError(f"{data.folder / file}: {told}; give two numbers up to {LARGEST_CHANGE:g} m in each row")
        if generations.dtype.kind not in "iu" or generations.shape != changes.shape[:1] or not _counts(generations):
            told = f"{born} has shape {generations.shape} of {generations.dtype}"
            raise ValueError(f"{data.folder / file}: {told}; give a generation from 0 on for each row of {name}")
        found[row, robot] = changes.astype(float), generations.astype(np.int32)
    if not found:
        raise ValueError(f"{data.folder / file}: has no mutations")
    return found


def _counts(generations: NDArray[Any]) -> bool:
    """Whether all are from 0 to the largest that mutations have."""
    return bool(((generations >= 0) & (generations <= np.iinfo(np.int32).max)).all())


def draw_curves(curves: Mapping[Place, Floats], path: Path) -> None:
    """Worst distance and fitness over generations: means of runs with 95 % bands, (2, 3, G); a column each robot."""
    rows, columns = _layout(curves)
    shape: Any = {"nrows": 1 + len(rows), "ncols": len(columns), "sharex": True, "sharey": "row"}
    with figure(path, PAGE, 1.0 + 1.25 * (1 + len(rows)), letters="", **shape) as (_, panels):
        for (name, robot), bands in curves.items():
            row, column = rows.index(name), columns.index(robot)
            for (mean, low, high), axes in zip(bands, (panels[0, column], panels[1 + row, column]), strict=True):
                colour = COLOURS[row % len(COLOURS)]
                draw_band(axes, np.arange(len(mean)), mean, low, high, colour=colour, label=name)
        kept = np.array([[(row, robot) in curves for robot in columns] for row in rows])
        lowest, (first, *others) = _outermost(panels, np.vstack([kept.any(axis=0), kept]))
        first.set_ylabel("worst distance [m]")
        first.set_ylim(bottom=0)
        for axes, name in zip(others, rows, strict=True):
            axes.set_ylabel(f"best fitness, {name}")
            if any(np.isfinite(bands[1, 0]).any() for (row, _), bands in curves.items() if row == name):
                _scale_by_decades(axes)
        for axes, robot in zip(panels[0], columns, strict=True):
            axes.set_title(robot)
        for axes in lowest:
            axes.set_xlabel("generation")
        lines = {
            label: line for axes in panels[0] for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        panels[0, 0].legend([lines[name] for name in rows], rows)


def _scale_by_decades(axes: Any) -> None:
    """Scale an axis by logarithms, with a few labels that are plain numbers, also within a decade."""
    from matplotlib.ticker import LogLocator

    logarithmic(axes, "y")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1,) if high > 30 * low else (1, 2, 5) if high > 4 * low else "all"))


def draw_traces(traces: Sequence[Record], lights: Lights, path: Path) -> None:
    """Paths of a typical champion of each treatment, from above, with the lights; numbers as CSV."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    places = list(dict.fromkeys((row["fitness"], row["robot"]) for row in traces))
    rows, columns = _layout(places)
    every = np.concatenate([lights, _positions(traces)])
    low, high = np.nanmin(every, axis=0) - 1, np.nanmax(every, axis=0) + 1
    width, height = high - low
    size = PAGE, 0.6 + (6.2 / len(columns) * min(height / width, TALLEST) + 0.15) * len(rows)
    with _grid_of_treatments(places, path, size, ("x [m]", "y [m]")) as (_, panels):
        for row, robot in places:
            axes, own = panels[row, robot], select(traces, fitness=row, robot=robot)
            for n, (x, y) in enumerate(lights):
                line = _positions(select(own, environment=n))
                axes.plot(x, y, "*", color="#E69F00", ms=10, mec="0.3", mew=0.4, zorder=3)
                axes.plot(*line.T, color=PATHS[robot], lw=0.8, ls=("-", "--", "-.", ":")[n % 4])
                axes.plot(*line[-1], "o", color=PATHS[robot], ms=3)
            axes.plot(0, 0, "s", color="black", ms=3, zorder=3)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            axes.yaxis.set_major_locator(MultipleLocator(5) if height < 100 else MaxNLocator(5))
    write_records(path.with_suffix(".csv.gz"), traces)


def _positions(traces: Sequence[Record]) -> Floats:
    """Positions in rows, (F, 2) [m]."""
    return np.column_stack([column(traces, "x"), column(traces, "y")])
