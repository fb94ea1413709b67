"""Reports of a calibration: a document for JSON, a table and a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.calibration.fit import Calibration
from optim.calibration.look import listed
from optim.calibration.misfit import TOO_LARGE
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from robots.calibration import UNITS, Experiment

HANDY = {"[m]": ("[mm]", 1e3), "[m/s]": ("[mm/s]", 1e3), "[Pa]": ("[kPa]", 1e-3)}  # units of the pictures
MEASURED: Any = {"fmt": "o", "ms": 3, "color": COLOURS[7], "lw": 0.8, "label": "measured", "zorder": 3}
COLUMNS, HEIGHT = 4, 1.9  # panels in a row; height of a row [in]


def document(found: Calibration, geometry: str, weight: str = "published") -> dict[str, Any]:
    """Return a calibration as a dictionary for JSON, which ``robots.calibration.load_calibration`` can read."""
    fitted = {
        name: {
            "before": getattr(found.before, name),
            "after": getattr(found.after, name),
            "unit": UNITS[name],
            "relative_standard_error": float(error),
            "interval_95": [float(low), float(high)],
            "part_of_variance_by_chaos": float(chaos),
            "at_bound": name in found.at_bound,
        }
        for name, error, (low, high), chaos in zip(
            found.names, found.uncertainty.errors, found.intervals, found.uncertainty.chaos, strict=True
        )
    }
    return {
        "geometry": geometry,
        **({} if weight == "published" else {"weight": weight}),
        "properties": vars(found.after),
        "fitted": fitted,
        "correlation": found.uncertainty.correlation.tolist(),
        "misfit_before": _finite(found.misfit[0]),
        "misfit_after": _finite(found.misfit[1]),
        "noise": found.uncertainty.noise,
        "warnings": warnings(found),
    }


def warnings(found: Calibration) -> list[str]:
    """Reasons to distrust the numbers, one line each."""
    lines = [f"{name} ended at a bound: its error means little; widen --bounds {name}" for name in found.at_bound]
    lines += [
        f"the data hardly tell {name}, whose interval is what was known before; add experiments that scatter less"
        for name in found.hardly_told
    ]
    if found.rival is not None:
        lines.append(
            f"another minimum is about as likely, {listed(found.names, found.rival)}: intervals are of the one found; "
            "add experiments that tell them apart"
        )
    lines += [f"{line}; check it, or leave it out" for line in found.outliers]
    if found.uncertainty.noise > TOO_LARGE:
        size = f"{found.uncertainty.noise:.1f} standard deviations"
        lines.append(f"the residuals are {size}: the model misses something, or the deviations are too small")
    return lines


def table(found: Calibration) -> str:
    """Format properties, intervals and correlations as a table, followed by warnings."""
    rows = [f"{'property':<16}{'before':>10}{'after':>10}{'error':>8}  {'95 % interval':<26}{'correlation'}"]
    for row, (name, error, (low, high)) in enumerate(
        zip(found.names, found.uncertainty.errors, found.intervals, strict=True)
    ):
        before, after = (f"{getattr(p, name):.4g}" for p in (found.before, found.after))
        interval = f"{low:.4g} to {high:.4g} {UNITS[name]}"
        others = " ".join(f"{value:5.2f}" for value in found.uncertainty.correlation[row, : row + 1])
        rows.append(f"{name:<16}{before:>10}{after:>10}{100 * error:>6.1f} %  {interval:<26}{others}")
    rows.append(
        f"residuals (root mean square): {found.misfit[0]:.3g} standard deviations before, {found.misfit[1]:.3g} after"
    )
    return "\n".join(rows + [f"warning: {line}" for line in warnings(found)])


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def save_calibration(experiments: Sequence[Experiment], predictions: ArrayLike, path: Path) -> None:
    """Plot each experiment in a panel: its measurements, and its predictions before and after the fit, shape (2, N)."""
    parts = np.split(np.asarray(predictions), np.cumsum([len(e.values) for e in experiments])[:-1], axis=1)
    columns = min(COLUMNS, len(experiments))
    rows = -(-len(experiments) // columns)
    shape: Any = {"nrows": rows, "ncols": columns, "letters": False}
    with figure(path, PAGE * columns / COLUMNS, HEIGHT * rows + 0.3, **shape) as (drawn, panels):
        for axes in panels.flat[len(experiments) :]:
            axes.set_visible(False)
        for axes, experiment, (before, after) in zip(panels.flat, experiments, parts, strict=False):
            whole = not np.isfinite(experiment.at).all()  # values of whole gaits have no time
            xlabel, along = ("number", 1.0) if whole else _handy(experiment.axis)
            ylabel, up = _handy(experiment.quantity)
            at = np.arange(1.0, len(before) + 1) if whole else along * experiment.at
            order = np.argsort(at)
            noise = None if experiment.deviations is None else up * experiment.deviations
            handles = [
                axes.errorbar(at, up * experiment.values, noise, **MEASURED),
                *axes.plot(at[order], up * before[order], ".--", ms=3, color=COLOURS[1], label="before"),
                *axes.plot(at[order], up * after[order], ".-", ms=3, color=COLOURS[0], label="after"),
            ]
            axes.set_title(experiment.title, fontsize=7)
            axes.set(xlabel=xlabel, ylabel=ylabel)
        legend_above(drawn, handles)


def _handy(label: str) -> tuple[str, float]:
    """Label with a more readable unit, and the factor that converts numbers to this unit."""
    for unit, (handy, factor) in HANDY.items():
        if label.endswith(unit):
            return label.replace(unit, handy), factor
    return label, 1.0
