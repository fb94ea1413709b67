"""Plots of a gradient check: errors and cosines of slopes over the step size."""

from pathlib import Path

from optim.measures.gradient_trust import AGREES, TRUSTED, GradientReport


def save_gradient_check(report: GradientReport, path: Path) -> None:
    """Write a picture of errors and cosines over the step size, with a line for each horizon."""
    from matplotlib.figure import Figure

    from robots.view.picture import save_picture

    figure = Figure(figsize=(10, 3.8), layout="constrained")
    error, exact, smooth = figure.subplots(1, 3, sharex=True)
    for number, horizon in enumerate(report.horizons):
        colour = f"C{number}"
        error.loglog(report.steps, horizon.errors, "o-", color=colour, label=horizon.name)
        exact.semilogx(report.steps, horizon.exact_cosines, "o-", color=colour)
        smooth.semilogx(report.steps, horizon.smoothed_cosines, "o-", color=colour)
    error.axhline(TRUSTED, color="0.6", linestyle=":")
    error.set_title("relative error of the exact gradient", fontsize=9)
    error.legend(fontsize=8, frameon=False)
    smooth.axvline(report.smoothing, color="0.6", linestyle=":")
    for axes, title in ((exact, "exact gradient"), (smooth, "smoothed gradient")):
        axes.set_title(f"cosine of {title} and differences", fontsize=9)
        axes.set_ylim(-1.05, 1.05)
        axes.axhline(AGREES, color="0.6", linestyle=":")
    for axes in (error, exact, smooth):
        axes.set_xlabel("step [ranges of the variables]", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    save_picture(figure, path)
