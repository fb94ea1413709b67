"""Draw a lattice as beams, coloured by their strains, with arrows for the pressure on its faces.

Source: Powers 2021 dissertation, ch. 5, supplementary figure "The simulated robot could switch between round and flat
shapes, as modeled by a shape-changing lattice", panels a and c.
"""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection

from robots.view.colouring import STRAINS
from robots.view.lattice_states import LatticeStates
from robots.view.scene import SHADOW, Camera, Colour, shadow
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ARROW: Colour = (0.13, 0.45, 0.25)
LONGEST = 1.6  # length of the arrow of the largest force, in voxel edges


def draw_beams(
    axes: "Axes",
    states: LatticeStates,
    frame: int,
    camera: Camera,
    level: float | None,
    limit: float,
) -> None:
    """Draw the links of a lattice as beams between voxel centres, and pressure forces as arrows.

    Nearer beams are drawn later; arrows of faces that point away from the viewer are drawn first.

    Args:
        axes: to draw on, in metres on paper.
        states: frames of the lattice.
        frame: number of the frame to draw.
        camera: camera that looks at them.
        level: z of the ground [m]; None if there is no ground for shadows.
        limit: strain at the end of the colour scale.
    """
    now = states.part([frame])
    ends, strains = now.positions[0][states.body.topology.links], now.strains()[0]
    order = np.argsort(ends.mean(axis=1) @ camera.toward, kind="stable")
    ends, strains = ends[order], strains[order]
    if level is not None:
        fallen = shadow(ends, camera, level, states.relief)
        axes.add_collection(LineCollection(list(fallen), colors=[SHADOW], linewidths=0.8, zorder=1.0))
    lines, colours = camera.project(ends), STRAINS(0.5 + 0.5 * strains / limit)
    axes.add_collection(LineCollection(list(lines), colors=colours, linewidths=0.9, zorder=2.5))
    _draw_arrows(axes, now, camera)


def arrows(states: LatticeStates, frame: int) -> tuple[Floats, Floats]:
    """Start and end points of the pressure arrows [m], shape (N, 3) each; N is 0 without pressure."""
    starts, forces = states.pressure_forces(frame)
    largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
    if not largest:
        return np.empty((0, 3)), np.empty((0, 3))
    return starts, starts + forces * LONGEST * states.body.voxel_size / largest


def _draw_arrows(axes: "Axes", now: LatticeStates, camera: Camera) -> None:
    """Draw pressure arrows from the middles of faces; those that point away from the viewer are pale."""
    starts, tips = arrows(now, 0)
    if not len(starts):
        return
    width = 0.14 * now.body.voxel_size
    for front in (False, True):
        which = ((tips - starts) @ camera.toward > 0) == front
        shafts, heads = _flat_arrows(camera.project(starts[which]), camera.project(tips[which]), width)
        colour = [ARROW] if front else [[0.4 + 0.6 * c for c in ARROW]]
        axes.add_collection(LineCollection(list(shafts), colors=colour, linewidths=0.6, zorder=2.0 + front))
        axes.add_collection(PolyCollection(list(heads), facecolors=colour, edgecolors="none", zorder=2.0 + front))


def _flat_arrows(starts: Floats, tips: Floats, width: float) -> tuple[Floats, Floats]:
    """Outlines of arrows on paper: their shafts, shape (N, 2, 2), and their heads, shape (N, 3, 2)."""
    along = tips - starts
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-30
    aside = along[:, ::-1] * [-1.0, 1.0]
    neck = tips - 3 * width * along
    return np.stack([starts, neck], axis=1), np.stack([tips, neck + width * aside, neck - width * aside], axis=1)
