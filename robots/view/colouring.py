"""Colours of a motion's nodes: by material, channel, strain, contact or friction."""

import colorsys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from robots.view.colour_names import BEAMS, COLOURS, listed
from robots.view.motion import Motion
from robots.view.scene import HUES, PURPLES, SKY, YELLOW, Colour, pale
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.short_text import printable
from taichi_sim.lattice.topology import Topology

STRAINS = LinearSegmentedColormap.from_list("strains", ["#08519c", "#4f9bd0", "#d3cec4", "#e2703a", "#a50f15"])
PERCENTILE = 99  # of the absolute strains, at the end of the colour scale
PLAIN: Colour = (0.84, 0.82, 0.78)
FLOOR, ITSELF, BOTH = (0.0, 0.45, 0.70), (0.84, 0.37, 0.0), (0.48, 0.25, 0.55)
OF_CHANNELS: tuple[Colour, ...] = (*HUES, *PURPLES, SKY, YELLOW)
UNDRIVEN: Colour = (0.62, 0.62, 0.62)
SEEN_THROUGH = 0.22  # opacity of voxels that nothing drives
MOST_NAMED, LETTERS = 10, 16  # names in a legend of channels, and of one of them
GRIPS, SLIDES = (0.48, 0.25, 0.55), (0.90, 0.62, 0.0)


@dataclass(frozen=True)
class Colouring:
    """Colours of a motion's nodes in every frame, with their legend.

    Attributes:
        name: one of ``robots.view.colour_names.COLOURS``.
        of: function from the number of a frame to the colours of its nodes: red, green, blue, 0 to 1, shape (N, 3).
        key: legend: names and colours.
        limit: absolute strain at both ends of the colour scale; 0 if the colours do not show strains.
        opacity: of the nodes, from 0 to 1, shape (N,); None if all are opaque.
        inner: faces within the skin that are shown, too: cube and side, shape (M, 2); None if there are none.
    """

    name: str
    of: Callable[[int], Floats]
    key: tuple[tuple[str, Colour], ...] = ()
    limit: float = 0.0
    opacity: Floats | None = None
    inner: Ints | None = None

    @property
    def has_key(self) -> bool:
        """Whether there is a legend or a colour scale to draw."""
        return bool(self.key or self.limit)


def colouring(motion: Motion, name: str = "material", frames: Sequence[int] = ()) -> Colouring:
    """Choose the colours of a motion's nodes.

    Material: the nodes' own colours, pale where the channel that they show is low. Channel: which channel drives a
    voxel; voxels that nothing drives are grey, and those within shine through them. Strain: the mean strain of the
    links of each voxel. Contact: whether voxels touch the floor, other voxels of the same robot, or both. Friction:
    which feet are commanded to grip and which to slide. Beams: material, with the scale of the strains of the links.

    Args:
        motion: motion to colour.
        name: one of ``robots.view.colour_names.COLOURS``.
        frames: numbers of the frames that share one scale of strains; all by default.

    Raises:
        ValueError: for other names, and for colours that this robot does not support.
    """
    if name not in COLOURS:
        raise ValueError(f"colour: {name!r} is not allowed; give {listed(COLOURS)}")
    lattice = motion.lattice
    if name == "material":
        return _material(motion)
    if lattice is None:
        raise ValueError(f"colour: {name} is not allowed for {motion.name}, which has no lattice; give material")
    if name == "channel":
        return _channel(motion, lattice.body.topology)
    if name == "friction":
        return _friction(motion)
    if name == "contact":
        colours = np.array([PLAIN, FLOOR, ITSELF, BOTH])

        def contact(frame: int) -> Floats:
            return colours[lattice.part([frame]).contacts()[0]]

        return Colouring(name, contact, (("touches the floor", FLOOR), ("touches itself", ITSELF), ("both", BOTH)))
    part = lattice.part(frames) if len(frames) else lattice
    if name == BEAMS:
        return replace(_material(motion), name=name, limit=strain_limit(part.strains()))
    limit = strain_limit(part.voxel_strains())

    def strain(frame: int) -> Floats:
        return STRAINS(0.5 + 0.5 * lattice.part([frame]).voxel_strains()[0] / limit)[:, :3]

    return Colouring(name, strain, limit=limit)


def strain_limit(strains: Floats) -> float:
    """Strain at the ends of the colour scale: a high percentile of the absolute strains, rounded to two digits."""
    return max(float(f"{np.percentile(np.abs(strains), PERCENTILE):.1e}"), 1e-4)


def _material(motion: Motion) -> Colouring:
    full = np.array([node.colour for node in motion.nodes])

    def material(frame: int) -> Floats:
        return faded(full, _levels(motion, frame, [node.channel for node in motion.nodes])[:, None])

    return Colouring("material", material)


def _channel(motion: Motion, topology: Topology) -> Colouring:
    driving = np.array([-1 if node.channel is None else node.channel for node in motion.nodes])
    numbers = np.unique(driving[driving >= 0]).tolist()
    if not numbers:
        raise ValueError(f"colour: channel is not allowed for {motion.name}, which nothing drives; give material")
    hues = OF_CHANNELS
    if len(numbers) > len(hues):
        hues = tuple(colorsys.hls_to_rgb(n / len(numbers), 0.4 + 0.2 * (n % 2), 0.7) for n in range(len(numbers)))
    colours = np.tile(UNDRIVEN, (len(driving), 1))
    for number, hue in zip(numbers, hues, strict=False):
        colours[driving == number] = hue
    names = [printable(motion.channels[number].name) for number in numbers]
    short = [name if len(name) <= LETTERS else f"{name[: LETTERS - 1]}…" for name in names]
    key = list(zip(short, hues, strict=False))
    if len(key) > MOST_NAMED:
        key[MOST_NAMED - 1 :] = [(f"{len(key) - MOST_NAMED + 1} more", PLAIN)]
    undriven = driving < 0
    if undriven.any():
        key.append(("not driven", UNDRIVEN))
    opacity = np.where(undriven, SEEN_THROUGH, 1.0)
    inner = _sides_between(driving, topology)
    return Colouring("channel", lambda frame: colours, tuple(key), opacity=opacity, inner=inner)


def _sides_between(driving: Ints, topology: Topology) -> Ints:
    """Sides of driven voxels towards voxels that another channel drives, or none: voxel and side, shape (M, 2)."""
    links, axes = topology.links, topology.link_axes
    apart = driving[links[:, 0]] != driving[links[:, 1]]
    sides = np.concatenate([np.column_stack([links[apart, end], 2 * axes[apart] + 1 - end]) for end in (0, 1)])
    return np.asarray(sides[driving[sides[:, 0]] >= 0])


def faded(colours: Floats, level: Floats) -> Floats:
    """Colours, shape (..., 3), faded by a level, shape (..., 1): pale at 0, full at 1."""
    return level * colours + (1 - level) * pale(colours)


def _friction(motion: Motion) -> Colouring:
    of_feet = np.array([node.foot is not None for node in motion.nodes])
    if not of_feet.any():
        raise ValueError(f"colour: friction is not allowed for {motion.name}, which has no feet that grip and slide")

    def friction(frame: int) -> Floats:
        grips = _levels(motion, frame, [node.foot for node in motion.nodes])[:, None] > 0.5
        return np.where(of_feet[:, None], np.where(grips, GRIPS, SLIDES), PLAIN)

    return Colouring("friction", friction, (("foot grips", GRIPS), ("foot slides", SLIDES)))


def _levels(motion: Motion, frame: int, numbers: Sequence[int | None]) -> Floats:
    """Levels of channels in a frame, given by their numbers, from 0 to 1, shape (N,); 1 for None."""
    levels = [*(channel.levels(motion.times[frame]) for channel in motion.channels), 1.0]
    return np.array([levels[-1 if number is None else number] for number in numbers])
