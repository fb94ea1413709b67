"""Width, height and curvature of the inflatable robot at different core pressures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from robots.inflatable import simulation
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.view import shape
from robots.view.scene import HUES, INK
from taichi_sim.base.arrays import Floats

PRESSURES = tuple(1000.0 * kilopascals for kilopascals in range(13))  # the range of the published search space [Pa]
IDLE = GaitSchedule(np.zeros((10, 1), bool), repeats=1)


@dataclass(frozen=True, eq=False)
class ShapeCurves:
    """Shapes of idle robots at several core pressures, after the core has been inflated.

    Attributes:
        pressures: pressures of the core [Pa], shape (K,).
        width: width of the skin, across the pouch [m], shape (K,).
        height: height of the skin [m], shape (K,).
        ratio: width per height, shape (K,).
        curvature: mean curvature of the skins [1/m], shape (K,); see ``shape.curvature``.
    """

    pressures: Floats
    width: Floats
    height: Floats
    ratio: Floats
    curvature: Floats


def shape_curves(
    pressures: Sequence[float] = PRESSURES,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    precision: str = "f32",
    threads: int | None = None,
) -> ShapeCurves:
    """Inflate idle robots on flat ground and measure their shapes; values of robots that diverge are NaN.

    Args:
        pressures: pressures of the core [Pa].
        geometry: shape and materials of the robots.
        actuation: how they are inflated; ``settle_steps`` is replaced by 1, as nothing moves in their gaits.
        precision: "f32" or "f64".
        threads: CPU threads; all cores by default.

    Raises:
        ValueError: for values that are not allowed.
    """
    if not len(pressures):
        raise ValueError("pressures: there are none; give at least one")
    designs = [InflatableDesign(pressure, 0.0, IDLE) for pressure in pressures]
    still = replace(actuation, settle_steps=1)
    result = simulation.simulate(
        designs, geometry=geometry, actuation=still, precision=precision, threads=threads, record_every=1
    )
    measures = (shape.width, shape.height, shape.ratio, shape.curvature)
    curves = [np.array([measure(result, robot) for robot in range(len(designs))]) for measure in measures]
    return ShapeCurves(np.asarray(pressures, float), *curves)


def shape_picture(curves: ShapeCurves) -> Figure:
    """Draw curves over pressure: width and height, their ratio, and the curvature of the skins."""
    figure = Figure(figsize=(8.0, 2.5), facecolor="white", layout="constrained")
    size, ratio, bend = figure.subplots(1, 3)
    kilopascals = curves.pressures / 1000
    for values, name, colour, above in ((curves.width, "width", HUES[3], 5), (curves.height, "height", HUES[0], -13)):
        size.plot(kilopascals, 100 * values, "o-", ms=3, lw=1.4, color=colour)
        size.annotate(
            name,
            (kilopascals[-1], 100 * values[-1]),
            (0, above),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=colour,
        )
    size.set_ylim(0, None)
    ratio.plot(kilopascals, curves.ratio, "o-", ms=3, lw=1.4, color=HUES[2])
    ratio.axhline(1.0, color=INK, lw=0.7, ls=(0, (3, 3)))
    bend.plot(kilopascals, curves.curvature, "o-", ms=3, lw=1.4, color=HUES[1])
    titles = ("size of the skin [cm]", "width per height", "mean curvature of the skins [1/m]")
    for axes, title in zip((size, ratio, bend), titles, strict=True):
        axes.set_title(title, fontsize=9, color=INK, loc="left")
        axes.set_xlabel("pressure of the core [kPa]", fontsize=8, color=INK)
        axes.tick_params(labelsize=7, labelcolor=INK)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
