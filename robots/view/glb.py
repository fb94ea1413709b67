"""Motions as GLB files with an animation, for Blender, three.js and others.

Source: glTF 2.0 Specification, Khronos Group 2021: sections 3.6 (accessors), 3.11 (animations), 4.4 (GLB).
"""

import json
import struct
from os import PathLike
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from robots.view.motion import BALL, LIGHT_COLOUR, Colour, Ground, Motion, product
from robots.view.scene import GROUND
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.base.files import new_path, write_bytes
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid, Sphere

FLOAT, UNSIGNED_SHORT = 5126, 5123  # types of numbers
ARRAY, INDICES = 34962, 34963  # what numbers are for
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
Z_UP_TO_Y_UP = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])


def save_glb(motion: Motion, path: str | PathLike[str], *, rate: float | None = None) -> int:
    """Write a motion as a GLB file.

    A node named after the motion turns z up to y up, and the ground to its slope; below it are a node for each node of
    the motion, with translation, rotation and scale over time, and one for each light. Solids share their meshes.

    Args:
        motion: to write.
        path: path of the file, which must not exist yet.
        rate: most frames a second [Hz]; all frames by default.

    Returns:
        Bytes written.

    Raises:
        ValueError: for a file that exists, or values that are not allowed.
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
    file = _File()
    upright = product(Z_UP_TO_Y_UP, motion.ground.upright)
    file.nodes.append({"name": motion.name, "rotation": _gltf_order(upright).tolist(), "children": []})
    times = file.accessor((motion.times - motion.times[0]).astype(np.float32), bounds=True)
    for n, node in enumerate(motion.nodes):
        tracks = {
            "translation": motion.translation[:, n],
            "rotation": _gltf_order(motion.rotation[:, n]),
            "scale": motion.scale[:, n],
        }
        file.add_node(node.name, file.mesh(node.solid, node.colour), times, tracks)
    for n, place in enumerate(motion.lights):
        still = {"translation": place[None], "scale": np.full((1, 3), 2 * motion.light_radius)}
        file.add_node(f"light {n + 1}", file.mesh(BALL, LIGHT_COLOUR), times, still)
    return file.content(motion.ground)


def _gltf_order(rotation: Floats) -> Floats:
    """Quaternions (w, x, y, z) in the order of glTF, (x, y, z, w)."""
    return np.roll(rotation, -1, axis=-1)


class _File:
    """Builder of a GLB file: collects nodes, meshes and numbers, then gives the content."""

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = []
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._shapes: dict[Solid, dict[str, Any]] = {}
        self._painted: dict[tuple[Solid, Colour], int] = {}
        self._paints: dict[Colour, int] = {}

    def accessor(self, values: NDArray[Any], target: int | None = None, bounds: bool = False) -> int:
        """Add an array of float32 or uint16, one element a row, and return the number of its accessor."""
        rows = values.reshape(len(values), -1)
        self._binary.extend(b"\0" * (-len(self._binary) % 4))
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": values.nbytes}
        self._views.append(view if target is None else {**view, "target": target})
        self._binary.extend(np.ascontiguousarray(values).tobytes())
        kind = FLOAT if values.dtype == np.float32 else UNSIGNED_SHORT
        accessor = {
            "bufferView": len(self._views) - 1,
            "componentType": kind,
            "count": len(rows),
            "type": WIDTHS[rows.shape[1]],
        }
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def mesh(self, solid: Solid, colour: Colour) -> int:
        """Add a mesh of a solid in a colour, and return its number; meshes of equal solids share their arrays."""
        if (solid, colour) not in self._painted:
            if solid not in self._shapes:
                self._shapes[solid] = self._shape(solid)
            primitive = {**self._shapes[solid], "material": self._material(colour)}
            self._meshes.append({"name": type(solid).__name__.lower(), "primitives": [primitive]})
            self._painted[solid, colour] = len(self._meshes) - 1
        return self._painted[solid, colour]

    def _shape(self, solid: Solid) -> dict[str, Any]:
        form = _surface(solid)
        return {
            "attributes": {
                "POSITION": self.accessor(np.asarray(form.vertices, np.float32), ARRAY, bounds=True),
                "NORMAL": self.accessor(np.asarray(form.vertex_normals, np.float32), ARRAY),
            },
            "indices": self.accessor(np.asarray(form.faces, np.uint16).ravel(), INDICES),
        }

    def _material(self, colour: Colour) -> int:
        if colour not in self._paints:
            linear = [float(c**2.2) for c in colour]  # glTF's colours are linear, ours as screens show them
            surface = {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
            self._materials.append({"pbrMetallicRoughness": surface})
            self._paints[colour] = len(self._materials) - 1
        return self._paints[colour]

    def add_node(self, name: str, mesh: int, times: int, tracks: dict[str, Floats]) -> None:
        """Add a node below the root, with its animation; tracks that never change only set its pose."""
        number = len(self.nodes)
        self.nodes[0]["children"].append(number)
        self.nodes.append({"name": name, "mesh": mesh} | {track: v[0].tolist() for track, v in tracks.items()})
        for track, values in tracks.items():
            if (values == values[0]).all():
                continue
            output = self.accessor(values.astype(np.float32))
            self._samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
            target = {"node": number, "path": track}
            self._channels.append({"sampler": len(self._samplers) - 1, "target": target})

    def content(self, ground: Ground) -> bytes:
        """Bytes of the complete file."""
        extras = {"ground_level": ground.level, "ground_colour": list(GROUND)}
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "morpholab"},
            "scene": 0,
            "scenes": [{"nodes": [0]} | ({"extras": extras} if ground.solid else {})],
            "nodes": self.nodes,
            "meshes": self._meshes,
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._binary)}],
        }
        if self._channels:
            document["animations"] = [{"name": "motion", "samplers": self._samplers, "channels": self._channels}]
        text = json.dumps(document, separators=(",", ":")).encode()
        chunks = [
            (b"JSON", text + b" " * (-len(text) % 4)),
            (b"BIN\0", bytes(self._binary) + b"\0" * (-len(self._binary) % 4)),
        ]
        body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in chunks)
        return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def _surface(solid: Solid) -> trimesh.Trimesh:
    """Triangle mesh of a centred solid; boxes do not share vertices between sides, so their edges stay sharp."""
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
