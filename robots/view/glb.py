"""Write motions as GLB files with an animation, for Blender, three.js and other programs.

Source: glTF 2.0 Specification, Khronos Group 2021: sections 3.6 (accessors), 3.11 (animations), 4.4 (GLB).
"""

import json
import struct
from os import PathLike
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from robots.view.motion import BALL, LIGHT_COLOUR, Motion
from robots.view.scene import GROUND, Colour
from robots.view.uneven import is_plain, node_tints, nodes, relief_around, triangles
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.base.files import new_path, write_bytes
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid, Sphere

FLOAT, UNSIGNED_SHORT = 5126, 5123  # component types of accessors
ARRAY, INDICES = 34962, 34963  # targets of buffer views
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
GAMMA = 2.2  # exponent between screen colours and linear colours


def save_glb(motion: Motion, path: str | PathLike[str], *, rate: float | None = None) -> int:
    """Write a motion as a GLB file.

    The root node, named after the motion, rotates z up to y up and tilts the ground to its slope. Its children are a
    node for each node of the motion, with translation, rotation and scale over time, one for each light, and one for
    uneven ground. Equal solids of one colour share a mesh.

    Args:
        motion: motion to write.
        path: path of the file, which must not exist yet.
        rate: maximum number of frames per second [Hz]; all frames by default.

    Returns:
        Bytes written.

    Raises:
        ValueError: if the file exists, or a value is not allowed.
    """
    new_path(path)
    if rate is not None:
        interval = 1 / number("rate", rate, 1e-6, unit="Hz")
        apart = float(np.diff(motion.times).mean()) if len(motion.times) > 1 else interval
        motion = motion.every(max(1, round(interval / apart)))
    content = _glb(motion)
    write_bytes(path, content)
    return len(content)


def _glb(motion: Motion) -> bytes:
    """Content of the file."""
    numbers = _Numbers()
    seen = _seen(motion)
    looks = list(dict.fromkeys((solid, colour) for _, solid, colour, _ in seen))
    shapes = {solid: _shape(numbers, solid) for solid, _ in looks}
    colours = list(dict.fromkeys(colour for _, colour in looks))
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "morpholab"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": motion.name, "rotation": motion.ground.y_up.tolist(), "children": []}],
        "meshes": [
            {
                "name": type(solid).__name__.lower(),
                "primitives": [{**shapes[solid], "material": colours.index(colour)}],
            }
            for solid, colour in looks
        ],
        "materials": [_material(colour) for colour in colours],
    }
    if motion.ground.solid:
        document["scenes"][0]["extras"] = {"ground_level": motion.ground.level, "ground_colour": list(GROUND)}
    times = numbers.add((motion.times - motion.times[0]).astype(np.float32), bounds=True)
    samplers, channels = list[Any](), list[Any]()
    for node, (name, solid, colour, tracks) in enumerate(seen, start=1):
        first = {track: values[0].tolist() for track, values in tracks.items()}
        document["nodes"][0]["children"].append(node)
        document["nodes"].append({"name": name, "mesh": looks.index((solid, colour)), **first})
        for track, values in tracks.items():
            if (values != values[0]).any():  # otherwise the node's own pose is enough
                output = numbers.add(values.astype(np.float32))
                channels.append({"sampler": len(samplers), "target": {"node": node, "path": track}})
                samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
    _add_ground(document, numbers, motion)
    if channels:
        document["animations"] = [{"name": "motion", "samplers": samplers, "channels": channels}]
    document |= {"accessors": numbers.accessors, "bufferViews": numbers.views}
    document["buffers"] = [{"byteLength": len(numbers.binary)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    body = _chunk(b"JSON", text, b" ") + _chunk(b"BIN\0", bytes(numbers.binary), b"\0")
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def _add_ground(document: dict[str, Any], numbers: "_Numbers", motion: Motion) -> None:
    """Add uneven ground as the last node, darker where friction is larger; a plane is given by its level alone."""
    relief, whole = relief_around(motion), motion.ground.relief
    if relief is None or whole is None:
        return
    places = nodes(relief, motion.ground.level).astype(np.float32)
    attributes = {"POSITION": numbers.add(places, ARRAY, bounds=True)}  # no normals: flat shading
    if not is_plain(relief):
        attributes["COLOR_0"] = numbers.add((node_tints(relief, whole) ** GAMMA).astype(np.float32), ARRAY)
    indices = numbers.add(triangles(relief).astype(np.uint16).ravel(), INDICES)
    primitive = {"attributes": attributes, "indices": indices, "material": len(document["materials"])}
    document["materials"].append(_material(GROUND))
    document["nodes"][0]["children"].append(len(document["nodes"]))
    document["nodes"].append({"name": "ground", "mesh": len(document["meshes"])})
    document["meshes"].append({"name": "ground", "primitives": [primitive]})


def _seen(motion: Motion) -> list[tuple[str, Solid, Colour, dict[str, Floats]]]:
    """Name, solid, colour and pose over time of all visible solids: nodes, then lights."""
    rotation = np.roll(motion.rotation, -1, axis=-1)  # glTF's order is (x, y, z, w)
    tracks = [
        {"translation": motion.translation[:, n], "rotation": rotation[:, n], "scale": motion.scale[:, n]}
        for n in range(len(motion.nodes))
    ]
    nodes = [(node.name, node.solid, node.colour, track) for node, track in zip(motion.nodes, tracks, strict=True)]
    ball = np.full((1, 3), 2 * motion.light_radius)
    lights: list[tuple[str, Solid, Colour, dict[str, Floats]]] = [
        (f"light {n}", BALL, LIGHT_COLOUR, {"translation": place[None], "scale": ball})
        for n, place in enumerate(motion.lights, start=1)
    ]
    return nodes + lights


class _Numbers:
    """The binary part of a GLB file, with the buffer views and accessors that describe it."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], target: int | None = None, bounds: bool = False) -> int:
        """Add an array of float32 or uint16, one element per row, and return the number of its accessor."""
        rows = values.reshape(len(values), -1)
        self.binary.extend(b"\0" * (-len(self.binary) % 4))
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": values.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.binary.extend(np.ascontiguousarray(values).tobytes())
        kind, width = FLOAT if values.dtype == np.float32 else UNSIGNED_SHORT, WIDTHS[rows.shape[1]]
        accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(rows), "type": width}
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _shape(numbers: _Numbers, solid: Solid) -> dict[str, Any]:
    """Attributes and indices of a solid's mesh, which its meshes of all colours share."""
    form = surface(solid)
    return {
        "attributes": {
            "POSITION": numbers.add(np.asarray(form.vertices, np.float32), ARRAY, bounds=True),
            "NORMAL": numbers.add(np.asarray(form.vertex_normals, np.float32), ARRAY),
        },
        "indices": numbers.add(np.asarray(form.faces, np.uint16).ravel(), INDICES),
    }


def _material(colour: Colour) -> dict[str, Any]:
    linear = [float(c**GAMMA) for c in colour]  # glTF's colours are linear, ours are screen colours
    surface = {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
    return {"pbrMetallicRoughness": surface}


def _chunk(kind: bytes, data: bytes, filler: bytes) -> bytes:
    data += filler * (-len(data) % 4)
    return struct.pack("<I", len(data)) + kind + data


def surface(solid: Solid) -> trimesh.Trimesh:
    """Triangle mesh of a centred solid; the sides of a box share no vertices, so that its edges look sharp."""
    if isinstance(solid, Box):
        form = trimesh.creation.box(extents=np.asarray(solid.size, float))
        form.unmerge_vertices()
        return form
    if isinstance(solid, Capsule):
        form = trimesh.creation.capsule(height=solid.length, radius=solid.radius, count=[12, 16])
        form.apply_translation(-form.bounds.mean(axis=0))
        return form
    assert isinstance(solid, Sphere)
    return trimesh.creation.icosphere(subdivisions=2, radius=solid.radius)
