"""Write motions as recordings for the Rerun viewer: bodies in space, with plots of their channels.

Source: Rerun, "Types" of the reference of its SDK (rerun.io/docs/reference/types): Mesh3D, Transform3D, Scalars,
SeriesLines.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

from robots.view.colouring import faded
from robots.view.glb import surface
from robots.view.mesh import boxes, joined_corners
from robots.view.motion import BALL, LIGHT_COLOUR, Channel, Motion
from robots.view.scene import GROUND, HUES, INK, Colour
from robots.view.uneven import node_tints, nodes, relief_around, triangles
from taichi_sim.base.arrays import Bytes, Floats, Ints
from taichi_sim.base.files import new_path, write_bytes
from taichi_sim.base.foreign import needing
from taichi_sim.lattice.faces import FACE_CORNERS, rotate

if TYPE_CHECKING:
    import rerun
    import rerun.blueprint

APPLICATION = "morpholab"
TIMELINE = "time"
WORLD, SCENE, SERIES = "world", "world/scene", "series"  # in the scene the ground is level, in the world gravity is
AT_ONCE = 4_000_000  # bytes of vertices in a block of frames
SHADES = 64.0  # steps of a normal; rounded numbers compress, and light does not show it
MARGIN = 0.5  # of ground around all places, in lengths of the robot
EYE = 0.68 * np.array([-0.5, -1.0, 0.6])  # from what is seen to the viewer, in its length: along the way, left, up
VOXEL = re.compile(r"voxel \d+(, )?")
LINE, DARK = (0.65, 0.65, 0.65), 0.4  # colour of lines that would not be seen on the viewer's dark plots
Places = NDArray[np.float32]


def need_rerun() -> None:
    """Check that recordings can be written.

    Raises:
        ValueError: if rerun-sdk is missing.
    """
    with needing("rerun", "rerun-sdk", "rerun"):
        import rerun.blueprint  # noqa: F401


def save_rerun(motion: Motion, path: str | PathLike[str]) -> int:
    """Write a motion as a recording for the Rerun viewer; this needs rerun-sdk.

    Lattices are meshes whose vertices move, one for each colour; other parts are constant meshes with poses over
    time. The timeline ``time`` has the times of the motion [s]. Channels are time series, and so are, for lattices,
    the strains of links and the number of voxels on the ground.

    Args:
        motion: motion to write.
        path: path of the file, which must not exist yet.

    Returns:
        Bytes written.

    Raises:
        ValueError: if the file exists, or rerun-sdk is missing.
    """
    new_path(path)
    need_rerun()
    content = _content(motion)
    write_bytes(path, content)
    return len(content)


def _content(motion: Motion) -> bytes:
    """Content of the file. Nothing is sent over a network: the recording stays in memory until it is drained."""
    import rerun

    # No time of writing, and an identity derived from the content, so that equal motions give equal recordings.
    stream = rerun.RecordingStream(APPLICATION, recording_id=_identity(motion), send_properties=False)
    memory = stream.memory_recording()
    strict = rerun.strict_mode()
    rerun.set_strict_mode(True)  # otherwise data that cannot be recorded are left out with a warning
    try:
        channels = _grouped((*motion.channels, *felt(motion)))
        stream.send_blueprint(_blueprint(motion, channels), make_active=False, make_default=True)
        stream.send_recording_name(motion.name)
        stream.log(WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        turn = rerun.Quaternion(xyzw=np.roll(motion.ground.upright, -1))
        stream.log(SCENE, rerun.Transform3D(quaternion=turn), static=True)
        (_add_parts if motion.skin is None else _add_skin)(stream, motion)
        _add_ground(stream, motion)
        for n, place in enumerate(motion.lights, start=1):
            ball = surface(BALL)  # without normals it is bright on all sides
            vertices = place + 2 * motion.light_radius * np.asarray(ball.vertices)
            mesh = rerun.Mesh3D(
                vertex_positions=vertices, triangle_indices=ball.faces, albedo_factor=_bytes(LIGHT_COLOUR)
            )
            stream.log(f"{SCENE}/light_{n}", mesh, static=True)
        for group, rows in channels.items():
            _add_series(stream, group, rows)
        return bytes(memory.drain_as_bytes())
    finally:
        rerun.set_strict_mode(strict)
        stream.disconnect()


def _identity(motion: Motion) -> str:
    """Identifier of the recording, derived from its content."""
    digest = hashlib.sha256(motion.name.encode())
    looks = repr([node.colour for node in motion.nodes]), repr(motion.ground), *(each.name for each in motion.channels)
    digest.update("/".join(looks).encode())
    for values in (
        *(motion.times, motion.translation, motion.rotation, motion.scale, motion.lights),
        *(each.values for each in motion.channels),
    ):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:32]


def _add_parts(stream: "rerun.RecordingStream", motion: Motion) -> None:
    """Add nodes as meshes with poses over time."""
    import rerun

    for n, name in enumerate(_distinct([node.name for node in motion.nodes])):
        node, path = motion.nodes[n], rerun.new_entity_path([*SCENE.split("/"), name])
        form, scale = surface(node.solid), motion.scale[:, n]
        grows = bool((scale != scale[0]).any())
        size = np.ones(3) if grows else scale[0]  # a constant size is part of the mesh
        normals = np.asarray(form.vertex_normals) / size
        mesh = rerun.Mesh3D(
            vertex_positions=np.asarray(form.vertices) * size,
            vertex_normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
            triangle_indices=form.faces,
        )
        stream.log(path, mesh, static=True)
        _add_colour(stream, path, motion, node.colour, node.channel)
        # Every row has the whole pose, because the viewer does not keep parts of earlier rows.
        pose = {"translation": motion.translation[:, n], "quaternion": np.roll(motion.rotation[:, n], -1, axis=-1)}
        if grows:
            pose["scale"] = scale
        stream.send_columns(path, [_times(motion.times)], rerun.Transform3D.columns(**pose))


def _add_skin(stream: "rerun.RecordingStream", motion: Motion) -> None:
    """Add the surface of a lattice: a mesh for each colour, whose vertices move."""
    import rerun

    meshes = []
    for path, corners, colour, channel in skin_parts(motion):
        points, vertices = np.unique(corners, return_inverse=True)
        quads = vertices.reshape(corners.shape)
        indices = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        stream.log(path, rerun.Mesh3D.from_fields(triangle_indices=indices), static=True)
        _add_colour(stream, path, motion, colour, channel)
        meshes.append((path, points))
    for first, places, normals in _moving(motion):
        times = _times(motion.times[first : first + len(places)])
        for path, points in meshes:
            columns = rerun.Mesh3D.columns(
                vertex_positions=places[:, points].reshape(-1, 3), vertex_normals=normals[:, points].reshape(-1, 3)
            )
            stream.send_columns(path, [times], columns.partition([len(points)] * len(places)))


def skin_parts(motion: Motion) -> Iterator[tuple[str, Ints, Colour, int | None]]:
    """Parts of the surface of a lattice that have one colour: entity, corners, colour and the channel it shows.

    Corners are numbers of the points that ``mesh.joined_corners`` computes, four for each face, shape (M, 4).
    """
    import rerun

    assert motion.skin is not None
    cubes, sides = motion.skin.faces.T
    corners = motion.skin.knots[cubes[:, None], FACE_CORNERS[sides]]
    looks = [(node.colour, node.channel) for node in motion.nodes]
    kinds = list(dict.fromkeys(looks[cube] for cube in cubes))
    kind_of = np.array([kinds.index(looks[cube]) for cube in cubes])
    examples = [motion.nodes[cubes[np.argmax(kind_of == kind)]] for kind in range(len(kinds))]
    names = [
        VOXEL.sub("", node.name).strip() or ("body" if node.channel is None else motion.channels[node.channel].name)
        for node in examples
    ]
    for kind, name in enumerate(_distinct(names)):
        yield rerun.new_entity_path([*SCENE.split("/"), name]), corners[kind_of == kind], *kinds[kind]


def _moving(motion: Motion) -> Iterator[tuple[int, Places, Places]]:
    """Points of the surface of a lattice, block by block: first frame, places [m] and normals, shape (B, K, 3)."""
    assert motion.skin is not None
    knots, (cubes, sides) = motion.skin.knots, motion.skin.faces.T
    corners = knots[cubes[:, None], FACE_CORNERS[sides]]
    count = int(knots.max()) + 1
    block = max(1, AT_ONCE // (12 * count))
    for first in range(0, len(motion.times), block):
        frames = range(first, min(first + block, len(motion.times)))
        places, normals = (np.empty((len(frames), count, 3), np.float32) for _ in range(2))
        for row, frame in enumerate(frames):
            points = joined_corners(boxes(motion, frame), knots)
            a, b, c, d = points[corners].swapaxes(0, 1)
            faced = np.repeat(np.cross(c - a, d - b), 4, axis=0)
            total: Floats = np.stack([np.bincount(corners.ravel(), along, count) for along in faced.T], axis=-1)
            unit = total / (np.linalg.norm(total, axis=1, keepdims=True) + 1e-30)
            places[row], normals[row] = points, np.round(SHADES * unit) / SHADES
        yield first, places, normals


def _add_colour(
    stream: "rerun.RecordingStream", path: str, motion: Motion, colour: Colour, channel: int | None
) -> None:
    """Add the colour of a mesh: pale where the channel that it shows is low."""
    import rerun

    if channel is None:
        stream.log(path, rerun.Mesh3D.from_fields(albedo_factor=_bytes(colour)), static=True)
        return
    shown = _bytes(faded(np.array(colour), motion.channels[channel].levels(motion.times)[:, None]))
    changes = np.append(True, (np.diff(shown.astype(int), axis=0) != 0).any(axis=1))
    columns = rerun.Mesh3D.columns(albedo_factor=shown[changes])
    stream.send_columns(path, [_times(motion.times[changes])], columns)


def _add_ground(stream: "rerun.RecordingStream", motion: Motion) -> None:
    """Add the ground: its shape around the motion, or a rectangle of its plane; nothing in a fluid."""
    import rerun

    relief, whole, tints = relief_around(motion), motion.ground.relief, np.ones(3)
    if relief is not None and whole is not None:
        places, faces, tints = nodes(relief, motion.ground.level), triangles(relief), node_tints(relief, whole)
    elif motion.ground.solid:
        (x, y), (right, far) = _ends(motion)[:, :2]
        level = motion.ground.level
        places = np.array([[x, y, level], [right, y, level], [right, far, level], [x, far, level]])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
    else:
        return
    mesh = rerun.Mesh3D(
        vertex_positions=places,
        vertex_normals=trimesh.Trimesh(places, faces, process=False).vertex_normals,
        triangle_indices=faces,
        vertex_colors=np.broadcast_to(_bytes(tints * np.array(GROUND)), places.shape),
    )
    stream.log(f"{SCENE}/ground", mesh, static=True)


def _ends(motion: Motion) -> Floats:
    """Smallest and largest coordinates of everything visible, with a margin around it [m], shape (2, 3)."""
    places = np.concatenate([motion.translation.reshape(-1, 3), motion.lights])
    margin = MARGIN * float(np.ptp(motion.translation[0], axis=0).max()) + float(motion.scale.max()) / 2
    return np.stack([places.min(axis=0) - margin, places.max(axis=0) + margin])


def felt(motion: Motion) -> tuple[Channel, ...]:
    """Channels of a lattice's state: axial strains of its links, and the number of voxels that touch the ground."""
    if motion.lattice is None:
        return ()
    frames = [motion.lattice.part([frame]) for frame in range(len(motion.times))]
    strains = 100 * np.array([[s.min(), s.mean(), s.max()] for s in (each.strains() for each in frames)])
    names = ("smallest strain", "mean strain", "largest strain")
    rows = [
        Channel(name, "%", motion.times, values, colour)
        for name, values, colour in zip(names, strains.T, (HUES[3], INK, HUES[0]), strict=True)
    ]
    if not motion.ground.solid:
        return tuple(rows)
    touching = np.array([each.on_floor().sum() for each in frames], float)
    return (*rows, Channel("voxels on the ground", "voxels", motion.times, touching, HUES[2]))


def _grouped(channels: Sequence[Channel]) -> dict[str, list[Channel]]:
    """Channels by the view that shows them: switches in one, others by their units."""
    groups = dict[str, list[Channel]]()
    for channel in channels:
        group = "on and off" if channel.switch else f"in {channel.unit}" if channel.unit else "without unit"
        groups.setdefault(group, []).append(channel)
    return groups


def _add_series(stream: "rerun.RecordingStream", group: str, channels: Sequence[Channel]) -> None:
    """Add channels as series of numbers below the entity of their group."""
    import rerun

    for name, channel in zip(_distinct([channel.name for channel in channels]), channels, strict=True):
        path = rerun.new_entity_path([SERIES, group, name])
        line = rerun.SeriesLines(
            colors=_bytes(LINE if max(channel.colour) < DARK else channel.colour),
            names=f"{name} [{channel.unit}]" if channel.unit else name,
            interpolation_mode="StepAfter" if channel.switch else "Linear",
        )
        stream.log(path, line, static=True)
        stream.send_columns(path, [_times(channel.times)], rerun.Scalars.columns(scalars=channel.values))


def _blueprint(motion: Motion, channels: dict[str, list[Channel]]) -> "rerun.blueprint.Blueprint":
    """Lay out the viewer: the robot at the left, a plot for each group of channels at the right."""
    import rerun
    import rerun.blueprint as layout

    upright = motion.ground.upright
    ends = _ends(motion)
    middle, reach = ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0]))
    turn = np.deg2rad(motion.ground.heading)
    frame = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    middle, eye = rotate(upright, np.stack([middle, middle + reach * EYE @ frame]))
    space = layout.Spatial3DView(
        origin=WORLD,
        name=motion.name,
        line_grid=layout.LineGrid3D(visible=False),
        eye_controls=layout.EyeControls3D(position=eye, look_target=middle, eye_up=(0, 0, 1)),
    )
    plots = [
        layout.TimeSeriesView(origin=rerun.new_entity_path([SERIES, group]), name=_title(group, rows))
        for group, rows in channels.items()
    ]
    parts = [space, layout.Vertical(*plots)] if plots else [space]
    shown = layout.Horizontal(*parts, column_shares=[3, 2][: len(parts)])
    return layout.Blueprint(shown, layout.TimePanel(timeline=TIMELINE, state="collapsed"), collapse_panels=True)


def _title(group: str, channels: Sequence[Channel]) -> str:
    names = ", ".join(channel.name for channel in channels)
    return f"{names} [{channels[0].unit}]" if len(channels) == 1 and channels[0].unit else group


def _times(times: Floats) -> "rerun.TimeColumn":
    import rerun

    return rerun.TimeColumn(TIMELINE, duration=times)


def _distinct(names: Sequence[str]) -> list[str]:
    """Make names distinct by appending numbers to repeated ones."""
    found = list[str]()
    for name in names:
        again = (f"{name} {n}" for n in range(2, len(names) + 2))
        found.append(next(each for each in (name, *again) if each not in found))
    return found


def _bytes(colour: Floats | Colour) -> Bytes:
    return np.round(255 * np.asarray(colour)).astype(np.uint8)
