"""A body as the tables that kernels read: integers shared by a batch, constants per robot, voxels in engine order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sim.ground.relief import GroundTables
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.laws.enclosure import closed_surface
from taichi_sim.lattice.laws.fluid import displaced_volumes, outer_sides
from taichi_sim.lattice.materials import (
    BEAM_COLUMNS,
    CONSTANT_COLUMNS,
    DAMP_MINUS,
    DAMP_PLUS,
    Material,
    beam_constants,
    channel_values,
    voxel_constants,
)
from taichi_sim.lattice.program import EVENT, QUANTITY_COUNT, LatticeProgram
from taichi_sim.lattice.stages import columns, memory


@dataclass(frozen=True, eq=False)
class Tables:
    """Integer tables of a topology (columns in ``stages``) and constants of its robots.

    Attributes:
        link, voxel, surface: flat integer tables of links, voxels and surface voxels.
        rest: pairs of groups and axis of the rest lengths, shape (R, 3).
        link_ends: voxels of each link, engine order, shape (L, 2).
        surface_voxels: the surface voxels, engine order, shape (S,).
        square, corner: flat integer tables of the squares of a closed surface under pressure, and of their corners,
            voxel by voxel; empty without a fluid, but for bodies with several chambers.
        excluded: bit matrix of pairs of surface voxels that never collide, shape (S, ceil(S / 32)).
        start: start positions [m], engine order, shape (V, 3).
        group: group of each voxel, engine order, shape (V,).
        group_region: region of each group, shape (G,).
        group_material: material of each group, shape (G,).
        beam_materials: materials at the "-" and the "+" end of each beam, shape (C, 2).
        constant: voxel constants, shape (B, G, 9).
        beam: beam constants, shape (B, C, 9).
        channel: channels at the start, shape (B, 25 G, 4).
        gauges: number of voxels whose strain is kept: those with faces under pressure, all with Poisson's effect.
        poisson: whether any robot has a material with Poisson's effect.
        squares: number of squares of that surface.
        fluid: whether there is a fluid around the robots.
        balanced: whether links keep angular momentum on dry ground, too.
        ground: uneven ground, or None.
    """

    link: np.ndarray
    voxel: np.ndarray
    rest: np.ndarray
    link_ends: np.ndarray
    group: np.ndarray
    surface: np.ndarray
    surface_voxels: np.ndarray
    square: np.ndarray
    corner: np.ndarray
    excluded: np.ndarray
    start: np.ndarray
    group_region: np.ndarray
    group_material: np.ndarray
    beam_materials: np.ndarray
    constant: np.ndarray
    beam: np.ndarray
    channel: np.ndarray
    gauges: int
    poisson: bool
    squares: int
    fluid: bool
    balanced: bool
    ground: GroundTables | None = None

    @property
    def medium(self) -> columns.Medium:
        """What surrounds the robots."""
        ground = self.ground
        water = bool(ground and ground.water)
        return columns.Medium(self.fluid, ground is not None, water, self.prints > 0, self.balanced)

    @property
    def prints(self) -> int:
        """Number of voxels whose print in the ground is kept: all, where it yields."""
        return len(self.group) if self.ground and self.ground.granular else 0

    def shared(
        self, plan: np.ndarray, constants: tuple[float, float, float], dtype: type, put: Callable[[np.ndarray], Any]
    ) -> columns.Shared:
        """What kernels get; ``put`` brings it to where they run; the constants are time step, edge and gravity."""
        names = ("link", "voxel", "rest", "square", "corner", "surface", "excluded")
        tables = {name: put(getattr(self, name)) for name in names}
        step, edge, gravity = constants
        tables["start"] = put(self.start.astype(dtype))
        if self.ground is not None:
            tables["relief"] = put(self.ground.numbers(dtype))
        return columns.Shared(put(plan), **tables, time_step=step, edge=edge, gravity=gravity)

    def layout(self, forces: tuple[int, int]) -> memory.Memory:
        """The memory of a robot of these tables; items and width of FORCE are the driver's choice."""
        surface, groups = len(self.surface_voxels), len(self.group_region)
        rows = (
            (len(self.group), memory.VOXEL_WIDTH),
            (len(self.link_ends), memory.LINK_WIDTH),
            (self.gauges, memory.STRAIN_WIDTH),
            (self.prints, memory.PRINT_WIDTH),
            (groups * QUANTITY_COUNT, memory.CHANNEL_WIDTH),
            (surface, 3),
            (1, 2),
            (groups, memory.CURRENT_WIDTH),
            (groups, CONSTANT_COLUMNS),
            (self.beam.shape[1], BEAM_COLUMNS),
            (len(self.rest), memory.REST_WIDTH),
            (surface, 3),
            forces,
            (self.squares, memory.PRESSED_WIDTH),
        )
        return memory.Memory.of(rows)

    def initial_sections(self) -> tuple[tuple[int, np.ndarray], ...]:
        """Sections of the memory that the tables fill, with values of shape (B, items, components)."""
        return (memory.CONSTANT, self.constant), (memory.BEAM, self.beam), (memory.CHANNEL, self.channel)

    def plan(self, layout: memory.Memory, floor: bool, self_contact: bool) -> np.ndarray:
        """The integers that tell kernels where sections lie, how many items there are and what is switched on."""
        no_pairs = 0
        counts = [len(a) for a in (self.group, self.link_ends, self.group_region, self.rest, self.surface_voxels)]
        switches = floor, self_contact, self.poisson, self.fluid
        # In the order of their places in ``memory``.
        grid = self.ground.grid if self.ground else ()
        plan = [*layout.starts, *counts, no_pairs, layout.state_slots, *switches, self.squares, *grid]
        return np.array(plan, np.int32)


def build_tables(
    bodies: Sequence[LatticeBody], time_step: float, fluid: bool = False, ground: GroundTables | None = None
) -> Tables:
    """Tables of robots whose bodies share voxels, links, regions and material indices but not material values."""
    body = bodies[0]
    topology, order = body.topology, body.topology.order
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    kinds = np.stack([body.material_index, body.regions], axis=1)  # type: ignore[list-item]
    groups, group_of = np.unique(kinds, axis=0, return_inverse=True)
    links, axes = topology.links, topology.link_axes
    beam_pairs, beam_of = np.unique(body.material_index[links].reshape(-1, 2), axis=0, return_inverse=True)
    rest_keys = np.column_stack([group_of[links].reshape(-1, 2), axes])
    rests, rest_of = np.unique(rest_keys, axis=0, return_inverse=True)
    ends = place[links].reshape(-1, 2)
    wet = fluid or bool(ground and ground.water)
    closed = wet or body.has_chambers
    squares = place[closed_surface(body)] if closed else np.zeros((0, columns.SQUARE_COLUMNS), int)
    outer = wet or bool(ground and ground.granular)
    voxel_table, strain_count = _voxel_table(body, order, place, group_of, squares, _has_poisson(bodies), outer, closed)
    shell = place[topology.surface]
    surface = np.column_stack([shell * memory.VOXEL_WIDTH, group_of[order][shell] * CONSTANT_COLUMNS])
    h = body.voxel_size

    def of_robots(table: Callable[[tuple[Material, ...]], Any]) -> np.ndarray:
        """A table of each robot's materials; robots that share a body share its table."""
        found = {id(each): np.array(table(each.materials)) for each in {id(b): b for b in bodies}.values()}
        return np.array([found[id(each)] for each in bodies])

    beam = of_robots(lambda m: [beam_constants(m[a], m[b], h, time_step, body.is_published) for a, b in beam_pairs])
    beam = beam.reshape(len(bodies), -1, BEAM_COLUMNS)
    return Tables(
        link=_link_table(ends, axes, beam_of, rest_of, beam),
        voxel=voxel_table.ravel(),
        rest=_int_table(rests, 3),
        link_ends=ends,
        group=group_of[order],
        surface=_int_table(surface, columns.SURFACE_COLUMNS).ravel(),
        surface_voxels=shell,
        square=_int_table(squares, columns.SQUARE_COLUMNS).ravel(),
        corner=_int_table(np.argsort(squares, axis=None, kind="stable") * 3, 1).ravel(),
        excluded=_bit_matrix(topology.excluded),
        start=body.start_positions[order],
        group_region=groups[:, 1].copy(),
        group_material=groups[:, 0].copy(),
        beam_materials=beam_pairs,
        constant=of_robots(lambda materials: [voxel_constants(materials[m], h) for m, _ in groups]),
        beam=beam,
        channel=of_robots(lambda materials: _initial_channels([materials[m] for m, _ in groups])),
        gauges=strain_count,
        poisson=_has_poisson(bodies),
        squares=len(squares),
        fluid=fluid,
        balanced=body.is_balanced,
        ground=ground,
    )


def _has_poisson(bodies: Sequence[LatticeBody]) -> bool:
    return any(m.poissons_ratio > 0 for body in bodies for m in body.materials)


def _int_table(rows: np.ndarray, columns: int) -> np.ndarray:
    """Rows as int32; a table without rows gets one, as kernels cannot take empty arrays."""
    return np.ascontiguousarray(rows.reshape(-1, columns) if len(rows) else np.zeros((1, columns)), np.int32)


def _link_table(
    ends: np.ndarray, axes: np.ndarray, beam_of: np.ndarray, rest_of: np.ndarray, beams: np.ndarray
) -> np.ndarray:
    table = np.zeros((len(ends), columns.LINK_COLUMNS), np.int32)
    table[:, [columns.LINK_MINUS, columns.LINK_PLUS]] = ends * memory.VOXEL_WIDTH
    table[:, columns.LINK_BEAM], table[:, columns.LINK_REST] = beam_of * BEAM_COLUMNS, rest_of * memory.REST_WIDTH
    for column, turn in ((columns.LINK_ALONG, 0), (columns.LINK_SIDE_1, 1), (columns.LINK_SIDE_2, 2)):
        table[:, column] = (axes + turn) % 3
    alike = (beams[:, :, DAMP_MINUS] == beams[:, :, DAMP_PLUS]).all(axis=0)
    table[:, columns.LINK_SYMMETRIC] = alike[beam_of]
    table[:, [columns.LINK_FIRST, columns.LINK_SECOND]] = ends
    return _int_table(table, columns.LINK_COLUMNS).ravel()


def _voxel_table(
    body: LatticeBody,
    order: np.ndarray,
    place: np.ndarray,
    group_of: np.ndarray,
    squares: np.ndarray,
    poisson: bool,
    wet: bool,
    closed: bool,
) -> tuple[np.ndarray, int]:
    topology, count = body.topology, len(order)
    table = np.full((count, columns.VOXEL_COLUMNS), -1, np.int32)
    table[:, columns.GROUP] = group_of[order] * CONSTANT_COLUMNS
    table[:, columns.CHANNELS] = group_of[order] * columns.CHANNELS_PER_GROUP
    table[place[topology.surface], columns.SURFACE_SLOT] = np.arange(len(topology.surface))
    table[:, columns.SIDE_LINK : columns.SIDE_LINK + 6] = topology.side_links[order]
    table[:, columns.FIXED] = body.fixed[order] @ (1 << np.arange(6))  # type: ignore[index]
    first = np.searchsorted(place[topology.links[:, 0]], np.arange(count + 1))
    table[:, columns.FIRST_LINK], table[:, columns.END_LINK] = first[:-1], first[1:]
    normals = body.pressure_normals[order]  # type: ignore[index]
    table[:, columns.NORMAL : columns.NORMAL + 3] = normals
    feels = (normals != 0).any(axis=1) & (not closed)  # else pressure acts on the squares
    table[:, columns.FEELS_PRESSURE] = feels
    table[:, columns.WET] = 0
    if wet:
        displaced = np.rint(displaced_volumes(body.voxels) * columns.VOLUME).astype(int)
        sides = outer_sides(body.voxels) @ (1 << np.arange(6))
        table[:, columns.WET] = (sides + columns.BEHIND_WET * displaced)[order]
    ends = np.cumsum(np.bincount(squares.ravel(), minlength=count))
    table[1:, columns.FIRST_CORNER], table[:, columns.END_CORNER] = ends[:-1], ends
    table[0, columns.FIRST_CORNER] = 0
    gauged = np.flatnonzero(feels | poisson)
    table[gauged, columns.GAUGE] = np.arange(len(gauged)) * memory.STRAIN_WIDTH
    return table, len(gauged)


def _bit_matrix(flags: np.ndarray) -> np.ndarray:
    """Rows of booleans packed into int32 words, lowest bit first."""
    words = -(-flags.shape[1] // 32) or 1
    padded = np.zeros((max(len(flags), 1), words * 32), bool)
    padded[: len(flags), : flags.shape[1]] = flags
    return np.packbits(padded, axis=1, bitorder="little").view(np.int32)


def _initial_channels(materials: list[Material]) -> np.ndarray:
    channels = np.zeros((len(materials), QUANTITY_COUNT, memory.CHANNEL_WIDTH))
    for place in (memory.BASE, memory.VALUE):
        channels[:, :, place] = [channel_values(material) for material in materials]
    return channels.reshape(-1, memory.CHANNEL_WIDTH)


@dataclass(frozen=True, eq=False)
class PackedProgram:
    """A program as kernels read it.

    Attributes:
        marks: (step, target) of each event, sorted by robot and step; a target below 0 records snapshot -target - 1.
        values: (base, rate) of each event.
        first: first mark of each robot, and one past the last, shape (B + 1,).
        source: number of the program's event that each came from, -1 for snapshots.
        lengths: shape (B,).
        slots: snapshots per robot, S.
    """

    marks: np.ndarray
    values: np.ndarray
    source: np.ndarray
    first: np.ndarray
    lengths: np.ndarray
    slots: int


def pack_program(program: LatticeProgram, group_region: np.ndarray) -> PackedProgram:
    """Sort a program's events and address groups instead of regions.

    Raises:
        ValueError: if an event names a region that the body lacks.
    """
    events = program.events
    limit = int(group_region.max()) + 1
    if len(events) and events["region"].max() >= limit:
        raise ValueError(f"events: region {events['region'].max()} is unknown; the body has 0..{limit - 1}")
    parts, sources = [], []
    for group, region in enumerate(group_region):
        (chosen,) = np.nonzero(events["region"] == region)
        part = events[chosen]
        part["region"] = group * QUANTITY_COUNT + part["quantity"]
        parts.append(part)
        sources.append(chosen)
    robot, slot = np.nonzero(program.snapshots >= 0)
    poses = np.zeros(len(robot), EVENT)
    poses["robot"], poses["step"], poses["region"] = robot, program.snapshots[robot, slot], -1 - slot
    parts.append(poses)
    sources.append(np.full(len(robot), -1))
    marks, source = np.concatenate(parts), np.concatenate(sources)
    order = np.lexsort((marks["step"], marks["robot"]))  # stable: the last event of a step wins
    marks, source = marks[order], source[order]
    first = np.searchsorted(marks["robot"], np.arange(program.robot_count + 1))
    pairs = np.stack([marks["step"], marks["region"]], axis=1)
    values = np.stack([marks["value"], marks["rate"]], axis=1)
    if not len(marks):
        pairs, values, source = np.zeros((1, 2)), np.zeros((1, 2)), np.full(1, -1)
    return PackedProgram(
        pairs.astype(np.int32),
        values,
        source,
        first.astype(np.int32),
        program.lengths.astype(np.int32),
        program.snapshots.shape[1],
    )
