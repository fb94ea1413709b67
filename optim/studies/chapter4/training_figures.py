"""The picture of training: evaluations until success against what a sweep says of the body.

Source: dissertation, chapter 4, figure "neurips_evolution_correlation".
"""

from pathlib import Path

from optim.experiments.figures import COLOURS, PAGE, figure, letter
from optim.experiments.tables import write_table
from optim.studies.chapter3.sweep_table import SweepTable
from optim.studies.chapter4.training_table import TrainingTable, metric_correlations

NAMES = {
    "random": "random search",
    "generating-set": "generating set search",
    "nes": "natural evolution strategy",
    "de": "differential evolution",
}
SYMBOLS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$"}


def save_training(table: TrainingTable, sweep: SweepTable, path: Path) -> None:
    """A column for each method, a row for each metric; a point for each body, the mean of its runs. Beside it: CSV."""
    part, means = sweep.rows(table.designs), table.evaluations.mean(axis=2)
    found = {(c.method, c.metric): c.found for c in metric_correlations(table, part) if c.over == "bodies"}
    width = PAGE * max(len(table.methods), 2) / len(NAMES)
    with figure(path, width, 3.6, nrows=2, ncols=len(table.methods), sharex="row", sharey=True) as (_, panels):
        for row, (metric, values) in zip(panels, part.metrics.items(), strict=True):
            for axes, method, mean in zip(row, table.methods, means, strict=True):
                axes.scatter(values, mean, s=5, color=COLOURS[0], alpha=0.4, linewidths=0, rasterized=True)
                axes.set_xlabel(SYMBOLS[metric])
                correlation = found[method, metric]
                if correlation.r is not None:
                    p = "p < 0.001" if correlation.p < 0.001 else f"p = {correlation.p:.3f}"
                    axes.annotate(
                        f"$r = {correlation.r:.2f}$, {p}",
                        (0.97, 0.95),
                        xycoords="axes fraction",
                        ha="right",
                        va="top",
                        fontsize=7,
                    )
            row[0].set_ylabel("mean evaluations")
        for axes, method in zip(panels[0], table.methods, strict=True):
            axes.annotate(
                NAMES.get(method, method), (0.5, 1.02), xycoords="axes fraction", ha="center", va="bottom", fontsize=7
            )
        letter(panels)
    columns = (table.designs.tolist(), *(values.tolist() for values in part.metrics.values()), *means.tolist())
    write_table(path.with_suffix(".csv"), ("design", *part.metrics, *table.methods), zip(*columns, strict=True))
