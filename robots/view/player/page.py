"""Build the HTML page of the player: motions, three.js and the program that plays them."""

import base64
import gzip
import html
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from robots.view.motion import Channel, GroundPlane, Motion, Skin, diameter
from robots.view.player.packing import Packed, pack
from robots.view.uneven import cut, is_plain, node_tints
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.short_text import printable
from taichi_sim.lattice.faces import FACE_CORNERS
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid

MOST_MOTIONS = 4
PROGRAM = ("decode.js", "poses.js", "solids.js", "skin.js", "relief.js", "stage.js", "timeline.js", "player.js")
FAR = 5.0  # lengths of the robot; the camera follows robots that travel farther
MOST_VALUES = 2000  # of a channel in the chart


def page(motions: Motion | Sequence[Motion], title: str = "") -> str:
    """Build the HTML page of a player.

    Args:
        motions: one, or up to four to see side by side.
        title: above them.

    Raises:
        ValueError: for no motions or too many of them.
    """
    several = [motions] if isinstance(motions, Motion) else list(motions)
    if not 1 <= len(several) <= MOST_MOTIONS:
        raise ValueError(f"motions: {len(several)} are not allowed; give one, or up to {MOST_MOTIONS}")
    packed = [pack(motion) for motion in several]
    about = [_about(motion, poses) for motion, poses in zip(several, packed, strict=True)]
    data = "\n".join(
        f'<script id="motion-{n}" type="application/octet-stream">{base64.b64encode(poses.data).decode()}</script>'
        for n, poses in enumerate(packed)
    )
    parts = {
        "title": html.escape(printable(title)),
        "style": _file("player.css"),
        "about": _in_script(about),
        "data": data,
        "three": f"/*\n{_file('LICENSE.three')}*/\n{_file('three.min.js.gz')}",
        "program": "\n".join(_file(name) for name in PROGRAM),
    }
    return re.sub(r"{{(\w+)}}", lambda place: parts[place[1]], _file("page.html"))


def _in_script(document: Any) -> str:
    """JSON for a script element; no text in it can end the element or, as ``<!--<script`` does, hide its end."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


@cache
def _file(name: str) -> str:
    """Text of a file beside this module, which may be compressed."""
    content = resources.files(__package__).joinpath(name).read_bytes()
    return (gzip.decompress(content) if name.endswith(".gz") else content).decode()


def _about(motion: Motion, packed: Packed) -> dict[str, Any]:
    """Describe a motion, apart from its poses, as a dictionary for JSON."""
    solids = list(dict.fromkeys(node.solid for node in motion.nodes))
    colours = list(dict.fromkeys(node.colour for node in motion.nodes))
    return {
        "name": motion.name,
        "frames": packed.frames,
        "nodes": packed.nodes,
        "steps": packed.steps,
        "planes": packed.planes,
        "times": _list(motion.times - motion.times[0], 6),
        "upright": motion.ground.y_up.tolist(),
        "solids": [_solid(solid) for solid in solids],
        "colours": [_list(np.array(colour), 4) for colour in colours],
        "solid_of": [solids.index(node.solid) for node in motion.nodes],
        "colour_of": [colours.index(node.colour) for node in motion.nodes],
        "channel_of": [node.channel for node in motion.nodes],
        "path": _list(motion.path, 5),
        "channels": [_channel(channel, motion.times[0]) for channel in motion.channels],
        "readouts": [n for n, channel in enumerate(motion.channels) if channel.read_out],
        "lights": _list(motion.lights, 4),
        "light_radius": motion.light_radius,
        "skin": None if motion.skin is None else _skin(motion.skin),
        **_view(motion),
    }


def _view(motion: Motion) -> dict[str, Any]:
    """Describe the first view of a motion and the ground below it, for JSON."""
    heading = np.deg2rad(motion.ground.heading)
    along = np.array([np.cos(heading), np.sin(heading)])
    gone = (motion.path[-1] - motion.path[0])[:2]
    straight = motion.ground.slope or motion.ground.heading or motion.ground.relief is not None
    if not straight and np.linalg.norm(gone) > 1e-3:
        along = gone / np.linalg.norm(gone)
    reach = motion.scale.max(axis=(0, 2))[:, None] / 2 * [diameter(node.solid) for node in motion.nodes]
    size = 2 * float((np.linalg.norm(motion.translation[0] - motion.path[0], axis=1) + reach[:, 0]).max())
    places = np.concatenate([motion.path, motion.lights])
    frame = np.stack([along, [-along[1], along[0]]])
    on_ground = places[:, :2] @ frame.T
    margin = 0.7 * size
    grid = _grid(max(size / 4, np.ptp(on_ground, axis=0).max() / 40))
    first = np.floor((on_ground.min(axis=0) - margin) / grid) * grid
    last = np.ceil((on_ground.max(axis=0) + margin) / grid) * grid
    return {
        "along": along.tolist(),
        "size": size,
        "follow": bool(np.linalg.norm(motion.path - motion.path[0], axis=1).max() > FAR * size),
        "ground": {
            "solid": motion.ground.solid,
            "level": motion.ground.level,
            "middle": ((first + last) / 2 @ frame).tolist(),
            "size": (last - first).tolist(),
            "grid": grid,
            "label": f"{grid:g} m" if grid >= 1 else f"{100 * grid:g} cm",
            **_relief(motion.ground, np.stack([first, last]), frame),
        },
    }


def _relief(ground: GroundPlane, ends: Floats, frame: Floats) -> dict[str, Any]:
    """Describe the visible part of uneven ground for JSON; empty for a plane.

    Args:
        ground: the ground.
        ends: limits of the visible ground along the rows of ``frame`` [m], shape (2, 2).
        frame: unit vectors along the heading and to its left, shape (2, 2).
    """
    if ground.relief is None:
        return {}
    corners = np.array([[ends[i, 0], ends[j, 1]] for i in (0, 1) for j in (0, 1)]) @ frame
    part = cut(ground.relief, corners.min(axis=0), corners.max(axis=0))
    told = {
        "heights": _list(part.heights.ravel(), 5),
        "counts": list(part.heights.shape),
        "spacing": part.spacing,
        "origin": list(part.origin),
    }
    if not is_plain(part):
        told["tints"] = _list(node_tints(part, ground.relief).ravel(), 3)
    return {"relief": told}


def _grid(length: float) -> float:
    """Nearest length of the form 1, 2 or 5 times a power of ten [m], for the spacing of grid lines."""
    power = 10 ** np.floor(np.log10(length))
    return float(power * min((1, 2, 5, 10), key=lambda digit: abs(np.log(digit * power / length))))


def _skin(skin: Skin) -> dict[str, Any]:
    """Describe a skin for JSON: its points, and for each face the cube and the points at its corners."""
    cubes, sides = skin.faces.T
    return {
        "knots": skin.knots.tolist(),
        "count": int(skin.knots.max()) + 1,
        "cubes": cubes.tolist(),
        "corners": skin.knots[cubes[:, None], FACE_CORNERS[sides]].tolist(),
    }


def _solid(solid: Solid) -> dict[str, Any]:
    if isinstance(solid, Box):
        return {"kind": "box", "size": np.asarray(solid.size, float).tolist()}
    length = {"length": solid.length} if isinstance(solid, Capsule) else {}
    return {"kind": type(solid).__name__.lower(), "radius": solid.radius, **length}


def _channel(channel: Channel, start: float) -> dict[str, Any]:
    kept = np.arange(len(channel.times)) if channel.switch else _telling(channel.values)
    times, values = channel.times[kept] - start, channel.values[kept]
    if channel.switch:  # repeated values need not be stored
        told = np.flatnonzero(np.diff(values, prepend=np.nan) != 0) if len(times) > 200 else np.arange(len(times))
        times, values = times[told], values[told]
    digits = 6 - int(np.floor(np.log10(max(np.abs(values).max(), 1e-9))))
    told_values = [float(f"{v:.5g}") for v in values] if channel.logarithmic else _list(values, digits)
    return {
        "name": channel.name,
        "unit": channel.unit,
        "times": _list(times, 6),
        "values": told_values,
        "range": [min(told_values), max(told_values)],
        "colour": _list(np.array(channel.colour), 4),
        "switch": channel.switch,
        "logarithmic": channel.logarithmic,
    }


def _telling(values: Floats) -> Ints:
    """Places of the values that a chart needs: of many, the least and the greatest of each stretch, and both ends."""
    if len(values) <= MOST_VALUES:
        return np.arange(len(values))
    stretches = np.array_split(np.arange(len(values)), MOST_VALUES // 2 - 1)
    extremes = [places[[values[places].argmin(), values[places].argmax()]] for places in stretches]
    return np.unique(np.concatenate([[0], *extremes, [len(values) - 1]]))


def _list(values: Floats, digits: int) -> Any:
    return np.round(values, digits).tolist()
