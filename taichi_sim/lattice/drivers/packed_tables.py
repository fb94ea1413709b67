"""The tables of a body for the packed driver: classes of lanes, places of neighbours, and what is spread to whom."""

from itertools import product
from typing import Any

import numpy as np

from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import aligned
from taichi_sim.lattice.drivers.packed_lanes import BY_LANE, FORCE_WIDTH, Lanes
from taichi_sim.lattice.drivers.packs import Packs, Reach, lay_out
from taichi_sim.lattice.materials import BEAM_COLUMNS, CONSTANT_COLUMNS
from taichi_sim.lattice.program import QUANTITY_COUNT, Quantity
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.tables import Tables

MOST_MASKS = 4  # groups of a row that are summed under masks, rather than lane by lane
FAR = 1e6  # m: where those are who belong to nobody
# Quantities that sizes follow from, and forces and damping: the first, and the one after the last.
SIZING = (Quantity.SCALE, Quantity.TEMPERATURE + 1)
LOADING = (Quantity.GLOBAL_DAMPING, Quantity.MOMENT)


class PackedTables:
    """Tables of a topology whose voxels lie in packs.

    Packs whose lanes have equal groups are one *class*: what the stages read of a group, they find once a class, in the
    sections CONSTANT, CURRENT and CHANNEL of the vector memory; BEAM and REST have classes of link packs likewise.

    Attributes:
        layout, scalars: the vector memory, and that of groups, of which the sections of groups are used.
        backward: the vector memory on the way back, where every voxel has its own cotangents of forces.
        packs: where voxels and links lie.
        voxel, link: tables of packs and link packs, with the columns of those of voxels and links.
        classes, beams, rests: group, slot of the beam and slot of the rest length in each lane of a class, -1 without.
        lanes: what kernels get.
    """

    def __init__(self, tables: Tables, places: np.ndarray, real: Real) -> None:
        """Lay out a body; ``places`` are those of its voxels on the lattice, engine order, shape (V, 3)."""
        self.tables, self.real = tables, real
        self.packs: Packs = lay_out(tables, places, real.width)
        whole = tables.layout(forces=(1, 1)).rows
        self.group_packs = -(-len(tables.group_region) // real.width)
        of_groups = {
            memory.CHANNEL: self.group_packs * QUANTITY_COUNT,
            memory.CURRENT: self.group_packs,
            memory.CONSTANT: self.group_packs,
            memory.REST: -(-len(tables.rest) // real.width),
        }
        self.scalars = memory.Memory.of((of_groups.get(section, 0), w) for section, (_, w) in enumerate(whole))
        packs, given = self.packs, tables.voxel.reshape(-1, columns.VOXEL_COLUMNS)
        links = tables.link.reshape(-1, columns.LINK_COLUMNS)
        group = np.where(packs.voxel >= 0, tables.group[packs.voxel], -1)
        beam = np.where(packs.link >= 0, links[packs.link, columns.LINK_BEAM], -1)
        rest = np.where(packs.link >= 0, links[packs.link, columns.LINK_REST], -1)
        rest = np.where(rest >= 0, rest, rest.max(axis=1, keepdims=True))  # no length is zero
        (self.classes, class_of), (self.beams, beam_of), (self.rests, rest_of) = map(_classes, (group, beam, rest))
        self.has_gauge = given[:, columns.GAUGE] >= 0
        gauges = int(self._any(self.has_gauge).sum())
        squares = -(-tables.squares // real.width)
        counts = {
            memory.VOXEL: len(packs.voxel) + 1,  # the last one is nobody's
            memory.LINK: len(packs.link),
            memory.STRAIN: gauges,
            memory.PRINT: len(packs.voxel) if tables.prints else 0,
            memory.CHANNEL: len(self.classes) * QUANTITY_COUNT,
            memory.LISTED: len(packs.voxel),
            memory.CURRENT: len(self.classes),
            memory.CONSTANT: len(self.classes),
            memory.BEAM: len(self.beams),
            memory.REST: len(self.rests),
            memory.CONTACT: len(packs.voxel),
            memory.PRESSED: squares + 1 if squares else 0,  # the last one gives no force, as the last link pack
        }
        rows = [(counts.get(section, count), width) for section, (count, width) in enumerate(whole)]
        forwards, backwards = (len(packs.link) + 1, FORCE_WIDTH), (len(packs.voxel) + 1, 6)
        ahead, behind = rows[: memory.FORCE], rows[memory.FORCE + 1 :]
        self.layout = memory.Memory.of([*ahead, forwards, *behind])
        self.backward = memory.Memory.of([*ahead, backwards, *behind])
        self.squares = squares
        self.voxel = self._voxel_table(given, class_of)
        self.link = self._link_table(links, beam_of, rest_of)
        self.lanes = self._lanes(given)

    def plan(self, layout: memory.Memory, switches: tuple[bool, bool]) -> np.ndarray:
        """The plan of the vector memory, or of one laid out alike."""
        plan = self.tables.plan(layout, *switches)
        plan[memory.STATE_SLOTS] = self.state_slots
        plan[memory.VOXELS], plan[memory.LINKS] = len(self.packs.voxel), len(self.packs.link)
        plan[memory.SQUARES] = self.squares
        return plan

    @property
    def state_slots(self) -> int:
        """Slots of the state in the vector memory; channels are in that of groups."""
        return self.layout.starts[memory.CHANNEL]

    def group_plan(self, switches: tuple[bool, bool]) -> np.ndarray:
        """The plan of the memory of groups; packs of rest lengths are no business of the stage of groups."""
        plan = self.tables.plan(self.scalars, *switches)
        plan[memory.GROUPS], plan[memory.RESTS] = self.group_packs, 0
        return plan

    def group_place(self, group: np.ndarray, slots: int, slot: Any = 0) -> np.ndarray:
        """Places of a slot of groups in a section of so many slots a group."""
        width = self.real.width
        return (group // width * slots + slot) * width + group % width

    def _any(self, of_voxels: np.ndarray) -> np.ndarray:
        """Whether a mask of voxels holds for any voxel of each pack, shape (P,)."""
        found: np.ndarray = (of_voxels[self.packs.voxel] & (self.packs.voxel >= 0)).any(axis=1)
        return found

    def _voxel_table(self, given: np.ndarray, class_of: np.ndarray) -> np.ndarray:
        packs = self.packs
        table = np.full((len(packs.voxel), columns.VOXEL_COLUMNS), -1, np.int32)
        table[:, columns.GROUP] = class_of * CONSTANT_COLUMNS
        table[:, columns.CHANNELS] = class_of * columns.CHANNELS_PER_GROUP
        for column in (columns.FIXED, columns.WET, columns.FEELS_PRESSURE):
            lanes = np.where(packs.voxel >= 0, given[packs.voxel, column], 0)
            table[:, column] = np.bitwise_or.reduce(lanes, axis=1)
        gauged = self._any(self.has_gauge)
        table[gauged, columns.GAUGE] = np.arange(gauged.sum()) * memory.STRAIN_WIDTH
        pack, axis = packs.link_pack.T
        ends = np.searchsorted(pack, np.arange(len(packs.voxel) + 1))
        table[:, columns.FIRST_LINK], table[:, columns.END_LINK] = ends[:-1], ends[1:]
        table[pack, columns.SIDE_LINK + 2 * axis + 1] = np.arange(len(pack))
        return table.ravel()

    def _link_table(self, links: np.ndarray, beam_of: np.ndarray, rest_of: np.ndarray) -> np.ndarray:
        packs = self.packs
        if not len(packs.link):
            return np.zeros(columns.LINK_COLUMNS, np.int32)
        first = packs.link[np.arange(len(packs.link)), (packs.link >= 0).argmax(axis=1)]
        table = links[first].copy()
        table[:, columns.LINK_MINUS] = packs.link_pack[:, 0] * memory.VOXEL_WIDTH
        table[:, columns.LINK_BEAM], table[:, columns.LINK_REST] = beam_of * BEAM_COLUMNS, rest_of * memory.REST_WIDTH
        alike = np.where(packs.link >= 0, links[packs.link, columns.LINK_SYMMETRIC], 1)
        table[:, columns.LINK_SYMMETRIC] = alike.all(axis=1)
        return table.astype(np.int32).ravel()

    def _lanes(self, given: np.ndarray) -> Lanes:
        packs, tables, width = self.packs, self.tables, self.real.width
        at_gauge = self.has_gauge[tables.link_ends].any(axis=1)
        nobody = len(packs.voxel) * width + np.arange(2)
        of = np.concatenate([packs.voxel_place[tables.surface_voxels], nobody])
        group = np.append(tables.group[tables.surface_voxels], [0, 0])
        groups, rest = self.group_place(group, CONSTANT_COLUMNS), tables.link[columns.LINK_REST :: columns.LINK_COLUMNS]
        surface = np.column_stack([self.place(of, memory.VOXEL_WIDTH), groups, self.place(of, 3)])
        square_corner, square_pressure = self._squares()
        full, gauged = (packs.link >= 0).all(axis=1), (at_gauge[packs.link] & (packs.link >= 0)).any(axis=1)
        ready = np.argsort(packs.last, kind="stable")
        ready_end = np.cumsum(np.bincount(packs.last, minlength=len(packs.voxel)))
        nothing = len(packs.link) * width
        minus = np.column_stack(self._reach(packs.minus, nothing))
        return Lanes(
            width,
            links=_ints(np.column_stack([*self._reach(packs.plus, 0), full, gauged])),
            packs=_ints(np.column_stack([minus.reshape(-1, 6), ready, ready_end])),
            plus=_ints(np.maximum(packs.plus.element, 0)),
            minus=_ints(np.where(packs.minus.element >= 0, packs.minus.element, nothing)),
            there=self._reals(packs.link >= 0),
            outer=self._reals(np.isin(packs.voxel, tables.surface_voxels)),
            shape=self._shape(given),
            **self._spread(),
            surface=np.ascontiguousarray(surface, np.int32),
            voxel=_ints(self.place(packs.voxel_place, memory.VOXEL_WIDTH)),
            link=_ints(self.place(packs.link_place, memory.LINK_WIDTH)),
            inverse=_ints(self.group_place(rest // memory.REST_WIDTH, memory.REST_WIDTH, 1)),
            square_corner=square_corner,
            square_pressure=square_pressure,
            corner=self._corners(given),
            square_there=self._reals((np.arange(self.squares * width) < tables.squares).reshape(-1, width)),
        )

    def place(self, lane: np.ndarray, slots: int) -> np.ndarray:
        """Places of lane numbers in a section of so many slots a pack."""
        width = self.real.width
        return lane // width * (slots * width) + lane % width

    def _reals(self, rows: np.ndarray) -> np.ndarray:
        """Rows of lanes as kernels take them, never empty."""
        array = aligned((max(len(rows), 1), self.real.width), self.real.numpy)
        array[: len(rows)] = rows
        return array

    @staticmethod
    def _reach(reach: Reach, nothing: int) -> tuple[np.ndarray, np.ndarray]:
        """Kinds and targets, as kernels take them; ``nothing`` is the lane number of who has no neighbour."""
        return reach.kind, np.where(reach.target >= 0, reach.target, nothing)

    def _shape(self, given: np.ndarray) -> np.ndarray:
        """The rows of the table of voxels as reals, see ``columns``."""
        packs = self.packs
        sides = (given[:, columns.SIDE_LINK : columns.SIDE_LINK + 6] >= 0).reshape(-1, 3, 2).sum(axis=2)
        wet = (given[:, columns.WET][:, None] >> np.arange(6) & 1).reshape(-1, 3, 2)
        held = given[:, columns.FIXED][:, None] >> np.arange(6) & 1
        single, braced = (sides == 1) & (held[:, :3] == 0), (sides == 1) & (held[:, :3] != 0)
        normals = given[:, columns.NORMAL : columns.NORMAL + 3]
        displaced = given[:, [columns.WET]] // columns.BEHIND_WET / columns.VOLUME
        ends = sides == 2, (sides == 2) | braced, single
        reached = np.where(wet[..., 1], wet.sum(axis=2), -wet[..., 0])
        parts = (0.5 * sides, normals, reached, held, self.tables.start, *ends, displaced)
        rows = np.concatenate([np.asarray(part, float) for part in parts], axis=1)
        lanes = np.where((packs.voxel >= 0)[..., None], rows[packs.voxel], 0.0)
        return self._reals(np.swapaxes(lanes, 1, 2).reshape(-1, self.real.width))

    def _spread(self) -> dict[str, np.ndarray]:
        """Rows of what each class takes of its lanes' groups in every step; lanes of nobody take the first group's."""
        at, of = self.layout.starts, self.scalars.starts
        frictions = (columns.STATIC_FRICTION, columns.KINETIC_FRICTION)
        channels = (*frictions, columns.PRESSURE, *columns.MOMENT, *columns.TRANSLATION, *columns.ROTATION)
        if self.tables.medium.floats:
            channels += columns.RESISTANCE
        if self.tables.poisson:  # which axes are in tension
            channels += tuple(channel for pair in columns.PULLING for channel in pair)
        rows: list[tuple[int, np.ndarray, np.ndarray, np.ndarray, tuple[int, int]]] = []
        width, w = memory.CURRENT_WIDTH, self.real.width
        for c, lanes in enumerate(np.maximum(self.classes, 0)):
            for q in range(width):
                follows = SIZING if q <= memory.MEAN_SIZE else LOADING
                source = of[memory.CURRENT] * w + self.group_place(lanes, width, q)
                rows.append((at[memory.CURRENT] + c * width + q, source, lanes, lanes, follows))
            for q in channels:
                slot, quantity = q + memory.VALUE, q // memory.CHANNEL_WIDTH
                to = at[memory.CHANNEL] + c * columns.CHANNELS_PER_GROUP + slot
                source = of[memory.CHANNEL] * w + self.group_place(lanes, columns.CHANNELS_PER_GROUP, slot)
                rows.append((to, source, lanes, lanes, (quantity, quantity + 1)))
        for c, lanes in enumerate(self.rests // memory.REST_WIDTH):
            ends = self.tables.rest[lanes]
            # A row for either group: the length changes with both.
            for q, end in product(range(memory.REST_WIDTH), (columns.REST_MINUS, columns.REST_PLUS)):
                to = at[memory.REST] + c * memory.REST_WIDTH + q
                source = of[memory.REST] * w + self.group_place(lanes, memory.REST_WIDTH, q)
                rows.append((to, source, lanes, ends[:, end], SIZING))
        to, source, owners, group, follows = zip(*rows, strict=True)
        places = self.group_place(np.array(group), columns.CHANNELS_PER_GROUP)
        spread = {"spreads": _ints(np.column_stack([to, follows])), "source": _ints(source), "group": _ints(places)}
        given = dict(zip(to, zip(range(len(to)), source, owners, strict=True), strict=True))
        return {**spread, **self._give_back(given), "rests": self._rests()}

    def _give_back(self, spread: dict[int, tuple[int, np.ndarray, np.ndarray]]) -> dict[str, np.ndarray]:
        """Rows by which groups get back the cotangents of what was spread to slots.

        Lanes of one owner are summed under a mask; where a row has many owners, it is given back lane by lane.

        Args:
            spread: by slot: the row that was spread, and the sources and the owners of its lanes.
        """
        masks: dict[tuple[bool, ...], int] = {}
        known: dict[bytes, list[tuple[int, int]]] = {}  # of owners: first lane and mask of each, in ascending order
        rows = []
        for to, (row, sources, owners) in spread.items():
            shares = known.get(owners.tobytes())
            if shares is None:
                each, first = np.unique(owners, return_index=True)
                if len(each) > MOST_MASKS:
                    shares = []
                else:
                    alike = [tuple((owners == owner).tolist()) for owner in each]
                    shares = [(lane, masks.setdefault(m, len(masks))) for lane, m in zip(first, alike, strict=True)]
                known[owners.tobytes()] = shares
            rows += [(to, sources[lane], mask) for lane, mask in shares] or [(to, row, BY_LANE)]
        return {"gives": _ints(rows), "masks": self._reals(np.array(list(masks)).reshape(-1, self.real.width))}

    def _rests(self) -> np.ndarray:
        """Places in CURRENT of the sizes of which each rest length is the mean; the last ones fill up a pack."""
        rest, width = self.tables.rest, self.real.width
        filled = rest[np.minimum(np.arange(-(-len(rest) // width) * width), len(rest) - 1)].reshape(-1, width, 3)
        slot = memory.SIZE + filled[..., columns.REST_AXIS]
        ends = [self.group_place(filled[..., end], memory.CURRENT_WIDTH, slot) for end in (0, 1)]
        return _ints(np.stack(ends, axis=1))

    def _squares(self) -> tuple[np.ndarray, np.ndarray]:
        """Where packs of squares find their corners, and the pressures there."""
        tables, width = self.tables, self.real.width
        square = tables.square.reshape(-1, columns.SQUARE_COLUMNS)
        padded = np.concatenate([square, np.repeat(square[:1], -len(square) % width, axis=0)])
        corners = np.swapaxes(padded.reshape(-1, width, columns.SQUARE_COLUMNS), 1, 2)
        first = self.scalars.starts[memory.CHANNEL] * width
        slot = columns.PRESSURE + memory.VALUE
        pressures = first + self.group_place(tables.group[corners], columns.CHANNELS_PER_GROUP, slot)
        return _ints(self.place(self.packs.voxel_place[corners], memory.VOXEL_WIDTH)), _ints(pressures)

    def _corners(self, given: np.ndarray) -> np.ndarray:
        """Places of the forces of squares on the voxels of each pack, in rows that the table of packs counts."""
        tables, width = self.tables, self.real.width
        rows: list[np.ndarray] = []
        nothing = self.squares * memory.PRESSED_WIDTH * width
        table = self.voxel.reshape(-1, columns.VOXEL_COLUMNS)
        for v, lanes in enumerate(self.packs.voxel):
            table[v, columns.FIRST_CORNER] = len(rows)
            first, end = (np.where(lanes >= 0, given[lanes, c], 0) for c in (columns.FIRST_CORNER, columns.END_CORNER))
            for r in range(int((end - first).max()) if tables.squares else 0):
                slot = tables.corner[np.minimum(first + r, len(tables.corner) - 1)]
                square, part = slot // memory.PRESSED_WIDTH, slot % memory.PRESSED_WIDTH
                place = (square // width * memory.PRESSED_WIDTH + part) * width + square % width
                rows.append(np.where(first + r < end, place, nothing))
            table[v, columns.END_CORNER] = len(rows)
        return _ints(rows)

    def put_nobody(self, section: np.ndarray) -> None:
        """Put the lanes without a voxel where nothing happens; a pack of them far from each other."""
        section[:, :, [2, 3, memory.STICKS]] = 1.0
        section[:, -1, 0] = FAR * (1 + np.arange(self.real.width))

    def write(self, view: np.ndarray, section: int, values: np.ndarray) -> None:
        """Set a section (B, items, components, lanes) from values of shape (B, items, components)."""
        if section in (memory.STRAIN, memory.PRINT):
            view[...] = 0.0
        elif section in (memory.VOXEL, memory.LINK):
            packs = self.packs.voxel if section == memory.VOXEL else self.packs.link
            row, lane = np.nonzero(packs >= 0)
            view[:, row, :, lane] = np.swapaxes(values[:, packs[row, lane]], 0, 1)
            if section == memory.LINK:
                row, lane = np.nonzero(packs < 0)
                view[:, row, :, lane] = 0.0
                view[:, row, memory.REGIME, lane] = 1.0
        else:
            items = self.classes if section == memory.CONSTANT else self.beams // BEAM_COLUMNS
            lanes = np.where(items[None, :, :, None] >= 0, values[:, np.maximum(items, 0)], 0.0)
            view[:, : len(items)] = np.swapaxes(lanes, 2, 3)

    def add(self, view: np.ndarray, section: int, found: np.ndarray) -> None:
        """Add what the classes of a section (B, items, components, lanes) have to its items (B, items, components)."""
        items = self.classes if section == memory.CONSTANT else self.beams // BEAM_COLUMNS
        for number, lanes in enumerate(items):
            for lane in np.flatnonzero(lanes >= 0):
                found[:, lanes[lane]] += view[:, number, :, lane]

    def read(self, view: np.ndarray, section: int) -> np.ndarray:
        """Values of the voxels or links of a section (B, items, components, lanes), shape (B, items, components)."""
        place = self.packs.voxel_place if section == memory.VOXEL else self.packs.link_place
        row, lane = np.divmod(place, self.real.width)
        return np.swapaxes(view[:, row, :, lane], 0, 1).copy()


def _classes(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Different rows, and which of them each row is."""
    found, number = np.unique(rows, axis=0, return_inverse=True)
    return found, number.reshape(-1)


def _ints(values: Any) -> np.ndarray:
    """Whole numbers as kernels take them, flat and never empty."""
    flat = np.ascontiguousarray(np.asarray(values).ravel(), np.int32)
    return flat if len(flat) else np.zeros(1, np.int32)
