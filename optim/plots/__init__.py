"""Plots of the results of runs and studies, on matplotlib axes."""

from optim.plots.curves import draw_band, draw_best, draw_curves, draw_run, draw_share_solved, save_curves
from optim.plots.fronts import add_bar, draw_elites, draw_front, draw_points
from optim.plots.gradient_trust import save_gradient_check
from robots.view.vehicle_charts import OVERLAP_COLOURS, add_overlap_bar, draw_overlap, draw_paths

__all__ = [
    "OVERLAP_COLOURS",
    "add_bar",
    "add_overlap_bar",
    "draw_band",
    "draw_best",
    "draw_curves",
    "draw_elites",
    "draw_front",
    "draw_overlap",
    "draw_paths",
    "draw_points",
    "draw_run",
    "draw_share_solved",
    "save_curves",
    "save_gradient_check",
]
