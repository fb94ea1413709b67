"""Colours of a motion's nodes: by material, strain, contact or friction."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from robots.view.motion import Channel, Colour, Motion
from robots.view.scene import pale
from taichi_sim.base.arrays import Floats

COLOURINGS = ("material", "strain", "contact", "friction")
STRAINS = LinearSegmentedColormap.from_list("strains", ["#08519c", "#4f9bd0", "#d3cec4", "#e2703a", "#a50f15"])
PERCENTILE = 99  # of the sizes of strains that the colours tell apart
PLAIN: Colour = (0.84, 0.82, 0.78)
FLOOR, ITSELF, BOTH = (0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.48, 0.25, 0.55)
GRIPS, SLIDES = (0.48, 0.25, 0.55), (0.90, 0.62, 0.0)
FOOT = re.compile(r"foot \d+")


@dataclass(frozen=True)
class Colouring:
    """Colours of a motion's nodes in every frame, with their legend.

    Attributes:
        of: the colours of the nodes in a frame: red, green, blue from 0 to 1, shape (N, 3).
        key: legend: names of colours.
        limit: strain, of either sign, at the ends of the colour scale; 0 if the colours do not show strains.
    """

    of: Callable[[int], Floats]
    key: tuple[tuple[str, Colour], ...] = ()
    limit: float = 0.0


def colouring(motion: Motion, name: str = "material", frames: Sequence[int] = ()) -> Colouring:
    """Choose the colours of a motion's nodes.

    Material: the nodes' own, pale where the channel that they show is low. Strain: the mean of the strains of the
    links of each voxel. Contact: which voxels touch the floor, and which others of the same robot. Friction: which
    feet are told to grip and which to slide.

    Args:
        motion: to colour.
        name: "material", "strain", "contact" or "friction".
        frames: that have one scale of strains; all by default.

    Raises:
        ValueError: for other names, and colours that need what this robot does not have.
    """
    if name not in COLOURINGS:
        raise ValueError(f"colour: {name!r} is not allowed; give {', '.join(COLOURINGS)} or beams")
    if name == "material":
        return _material(motion)
    if motion.lattice is None:
        raise ValueError(f"colour: {name} is not allowed for {motion.name}, which has no lattice; give material")
    if name == "friction":
        return _friction(motion)
    lattice = motion.lattice
    if name == "contact":
        colours = np.array([PLAIN, FLOOR, ITSELF, BOTH])

        def contact(frame: int) -> Floats:
            now = lattice.part(np.array([frame]))
            return colours[now.on_floor()[0] + 2 * now.on_itself()[0]]

        return Colouring(contact, (("touches the floor", FLOOR), ("touches itself", ITSELF), ("both", BOTH)))
    part = lattice if not len(frames) else lattice.part(np.array(frames))
    limit = strain_limit(part.voxel_strains())

    def strain(frame: int) -> Floats:
        strains = lattice.part(np.array([frame])).voxel_strains()[0]
        return STRAINS(0.5 + 0.5 * strains / limit)[:, :3]

    return Colouring(strain, limit=limit)


def strain_limit(strains: Floats) -> float:
    """Strain at the ends of the colour scale: a high percentile of the absolute strains, rounded to two digits."""
    return max(float(f"{np.percentile(np.abs(strains), PERCENTILE):.1e}"), 1e-4)


def level(channel: Channel, times: Floats) -> Floats:
    """Values of a channel at some times [s], scaled so that its smallest value is 0 and its largest is 1."""
    values = np.log(channel.values) if channel.logarithmic else channel.values
    low, high = (0.0, 1.0) if channel.switch else (values.min(), values.max())
    if channel.switch:
        now = values[np.clip(np.searchsorted(channel.times, times, side="right") - 1, 0, len(values) - 1)]
    else:
        now = np.interp(times, channel.times, values)
    return (now - low) / (high - low) if high > low else np.ones_like(now)


def _material(motion: Motion) -> Colouring:
    full = np.array([node.colour for node in motion.nodes])
    faint = np.array([pale(colour) for colour in full])
    shown = np.array([-1 if node.channel is None else node.channel for node in motion.nodes])

    def material(frame: int) -> Floats:
        levels = [float(level(channel, motion.times[[frame]])[0]) for channel in motion.channels]
        weight = np.array([*levels, 1.0])[shown][:, None]
        return weight * full + (1 - weight) * faint

    return Colouring(material)


def _friction(motion: Motion) -> Colouring:
    feet = [n for n, channel in enumerate(motion.channels) if FOOT.fullmatch(channel.name)]
    if not feet:
        raise ValueError(f"colour: friction is not allowed for {motion.name}, which has no feet that grip and slide")
    shown = np.array([-1 if node.channel not in feet else node.channel for node in motion.nodes])
    colours = np.array([SLIDES, GRIPS])

    def friction(frame: int) -> Floats:
        grips = np.array([level(channel, motion.times[[frame]])[0] > 0.5 for channel in motion.channels], int)
        return np.where(shown[:, None] >= 0, colours[grips[shown]], PLAIN)

    return Colouring(friction, (("foot grips", GRIPS), ("foot slides", SLIDES)))
