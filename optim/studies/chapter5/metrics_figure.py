"""Heat maps of learnability and interference over bodies of the soft robot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import PAGE, figure, letter

METRICS = {"M_L": "learnability $M_L$", "M_CI": "resistance to\ninterference $M_{CI}$"}


def draw(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """A row for each metric, a column for each threshold; pressure across, orientation upwards.

    A body has no M_CI, "none", where no gait succeeds anywhere.

    Args:
        rows: see ``optim.studies.chapter5.metrics.rows_of``.
        path: of the picture.
    """
    pressures, orientations, thresholds = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("pressure", "orientation", "threshold")
    )
    height = 2 * (0.9 + 0.32 * len(orientations))
    with figure(path, PAGE, height, nrows=2, ncols=len(thresholds), sharex=True, sharey=True) as (drawn, panels):
        for line, (metric, title) in zip(panels, METRICS.items(), strict=True):
            most = max((row[metric] for row in rows if row[metric] is not None), default=0.0) or 1.0
            for axes, threshold in zip(line, thresholds, strict=True):
                here = [row for row in rows if row["threshold"] == threshold]
                values = np.array([row[metric] for row in here], float).reshape(len(pressures), len(orientations)).T
                image = axes.imshow(values, origin="lower", aspect="auto", cmap="cividis", vmin=0.0, vmax=most)
                for (y, x), value in np.ndenumerate(values):
                    text = "none" if np.isnan(value) else f"{value:.2g}"
                    axes.annotate(
                        text,
                        (x, y),
                        ha="center",
                        va="center",
                        fontsize=6,
                        color="white" if value < most / 2 else "black",
                    )
                axes.set_xticks(range(len(pressures)), [f"{pressure / 1e3:g}" for pressure in pressures])
                axes.set_yticks(range(len(orientations)), [f"{orientation:g}" for orientation in orientations])
            drawn.colorbar(image, ax=line.tolist(), label=title)
        for axes, threshold in zip(panels[0], thresholds, strict=True):
            least = next((row["flat_least"], row["hill_least"]) for row in rows if row["threshold"] == threshold)
            axes.annotate(
                f"{threshold}: {least[0]:g}, {least[1]:g} BL/s",
                (0.5, 1.02),
                xycoords="axes fraction",
                ha="center",
                va="bottom",
                fontsize=7,
            )
        for axes in panels[-1]:
            axes.set_xlabel("core pressure [kPa]")
        for axes in panels[:, 0]:
            axes.set_ylabel("orientation [degrees]")
        letter(panels)
