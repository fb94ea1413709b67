"""What the contact of the inflatable robot with the ground does: which parts bear its load, slide, and chatter.

On uneven ground a voxel touches the plane of the triangle under its centre, as in the simulation, and slides along it.
Everything is read off recorded frames. What happens between two of them is not seen: motions shorter than that count
by where they end.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from robots.inflatable.body import FIRST_BLADDER, FOOT_1, FOOT_2, FOOT_SEAM, SEAM, SKIN, kinds_of
from robots.inflatable.design import InflatableDesign
from robots.inflatable.simulation import InflatableResult
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.ground.laws import penetration

PARTS = ("feet", "seams", "bladders", "core")
LEVEL = (0.0, 0.0, 1.0)  # normal of a plane
CREEP = 1e-3  # body lengths a second: contact that moves more slowly rests


@dataclass(frozen=True, eq=False)
class Contact:
    """How the voxels of a robot touch the ground in F frames.

    Attributes:
        times: of the frames [s], shape (F,).
        places: of the voxels [m], shape (F, V, 3).
        depth: at which voxels are in the ground at each frame, along its normal [m], to which the force of firm ground
            is proportional; 0 for those that do not touch it, shape (F, V).
        kinds: of the voxels' regions, shape (V,).
        normals: unit normals of the ground under the voxels, shape (F, V, 3), or of all of it, shape (3,).
    """

    times: Floats
    places: Floats
    depth: Floats
    kinds: Ints
    normals: Floats = field(default_factory=lambda: np.array(LEVEL))

    @classmethod
    def of(cls, result: InflatableResult, design: InflatableDesign, robot: int = 0) -> "Contact":
        """The contact of a robot of a batch with what it was simulated on, as long as it was simulated.

        Args:
            result: with frames.
            design: what was simulated; uneven ground lies along its heading.
            robot: place in the batch.

        Raises:
            ValueError: for a result without frames.
        """
        if result.frames is None:
            raise ValueError("frames: nothing was recorded; simulate with record_every")
        frames, body = result.frames, result.body
        kept = np.isfinite(frames.positions[:, robot, 0, 0])
        places, sizes = frames.positions[kept, robot], frames.sizes[kept, robot]
        ground = None if result.terrains is None else result.terrains[robot].uneven
        height, nz, normals = 0.0, 1.0, np.array(LEVEL, places.dtype)
        if ground is not None:
            relief = ground.relief(design.orientation, body.voxel_size)
            height, normals = relief.planes(places[..., 0], places[..., 1])
            nz = normals[..., 2]
        depth = np.maximum(penetration(sizes.mean(axis=-1), body.voxel_size, places[..., 2], height, nz), 0.0)
        return cls(frames.times[kept], places, depth, kinds_of(np.asarray(body.regions)), normals)

    @cached_property
    def load(self) -> Floats:
        """Mean depth of voxels that touch the ground at two frames in succession [m], else 0, shape (F - 1, V)."""
        before, after = self.depth[:-1], self.depth[1:]
        return np.where((after > 0) & (before > 0), (after + before) / 2, 0.0)

    @cached_property
    def _facing(self) -> Floats:
        """Way that the ground under voxels faces between frames, of any length, shape (F - 1, V, 3)."""
        normals = np.broadcast_to(self.normals, self.places.shape)
        return normals[1:] + normals[:-1]

    @cached_property
    def shift(self) -> Floats:
        """Way of voxels along the ground under them between frames [m], shape (F - 1, V, 3)."""
        return _along(np.diff(self.places, axis=0), self._facing)

    @cached_property
    def way(self) -> Floats:
        """Length of that way [m], shape (F - 1, V)."""
        return np.linalg.norm(self.shift, axis=-1)

    @cached_property
    def path(self) -> Floats:
        """Way of the robot's middle between frames, along the mean plane of the ground under it [m], shape (F - 1,)."""
        return np.linalg.norm(_along(np.diff(self.places.mean(axis=1), axis=0), self._facing.mean(axis=1)), axis=-1)

    def slides(self, body_length: float) -> Bools:
        """Which loaded voxels move faster than ``CREEP`` between frames, shape (F - 1, V)."""
        least = CREEP * body_length * np.diff(self.times)
        return (self.load > 0) & (self.way > least[:, None])


@dataclass(frozen=True, eq=False)
class Footing:
    """How a robot stood and slid on the ground in one run, in numbers.

    Attributes:
        slips: by part, and of all parts together: share of the robot's path that the loaded contact slides, while the
            part bears load; 0 of contact that holds, 1 of a block that slides. NaN of parts that never bear load.
        loads: share of the load that each part bears; NaN of a robot that never touches the ground.
        chatter: share of the times between frames, over loaded voxels, at which contact begins or ends, or sliding
            turns by more than 90 degrees; 0.5 of contact that comes and goes at random.
        turning: of the line from the first foot to the second in the plane, to the left, from the first frame to the
            last [degrees].
    """

    slips: Mapping[str, float]
    loads: Mapping[str, float]
    chatter: float
    turning: float


def footing_of(result: InflatableResult, design: InflatableDesign, body_length: float, robot: int = 0) -> Footing:
    """How a robot of a batch stood and slid.

    Args:
        result: with frames.
        design: what was simulated; softer regions bear less at the same depth.
        body_length: of the robot [m].
        robot: place in the batch.

    Raises:
        ValueError: for a result without frames.
    """
    contact, stiffness = Contact.of(result, design, robot), _stiffness(result, design)
    load = contact.load * stiffness
    members = {name: _members(contact.kinds, name) for name in PARTS}
    every = np.ones(len(contact.kinds), bool)
    slips = {name: _slip_share(contact, load, mine) for name, mine in {**members, "all": every}.items()}
    whole = load.sum()
    loads = {name: float(load[:, mine].sum() / whole) if whole > 0 else np.nan for name, mine in members.items()}
    return Footing(slips, loads, chatter_of(contact, body_length), turning_of(contact))


def _along(ways: Floats, normals: Floats) -> Floats:
    """Parts of ways along planes, whose normals have any length, shape (..., 3) each."""
    facing = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    along: Floats = ways - (ways * facing).sum(axis=-1, keepdims=True) * facing
    return along


def _stiffness(result: InflatableResult, design: InflatableDesign) -> Floats:
    """Young's modulus of each voxel [Pa], shape (V,): firm ground pushes back by depth times modulus."""
    body = result.body
    moduli = np.array([material.youngs_modulus for material in body.materials])[np.asarray(body.material_index)]
    own = None if design.materials is None else design.materials.modulus
    return moduli if own is None else moduli * np.array(own)[np.asarray(body.regions)]


def _members(kinds: Ints, part: str) -> Bools:
    """Which voxels belong to a part."""
    if part == "bladders":
        return kinds >= FIRST_BLADDER
    return np.isin(kinds, {"feet": (FOOT_1, FOOT_2), "seams": (SEAM, FOOT_SEAM), "core": (SKIN,)}[part])


def _slip_share(contact: Contact, load: Floats, mine: Bools) -> float:
    """Share of the robot's path that the loaded voxels of a part slide while there are any."""
    borne = load[:, mine].sum(axis=1)
    bears = borne > 0
    if not bears.any():
        return np.nan
    slid = float(((load * contact.way)[:, mine].sum(axis=1)[bears] / borne[bears]).sum())
    path = float(contact.path[bears].sum())
    return slid / path if path > 0 else (np.inf if slid > 0 else 0.0)


def chatter_of(contact: Contact, body_length: float) -> float:
    """Share of changes of contact among all that could be, see ``Footing``; 0 of a robot that never touches the ground.

    Each voxel that touches the ground at a frame may cease to at the next, one that touches it at the next may have
    begun to, and one that slides through two intervals may turn round.
    """
    touching = contact.depth > 0
    bearing = touching[1:] | touching[:-1]
    changed = touching[1:] != touching[:-1]
    sliding = contact.slides(body_length)
    onward = (contact.shift[1:] * contact.shift[:-1]).sum(axis=-1)
    changed[1:] |= sliding[1:] & sliding[:-1] & (onward < 0)
    return float(changed.sum() / bearing.sum()) if bearing.any() else 0.0


def turning_of(contact: Contact) -> float:
    """How far the line between the feet turns to the left in the plane, full turns included [degrees]."""
    ends = [contact.places[:, contact.kinds == foot, :2].mean(axis=1) for foot in (FOOT_1, FOOT_2)]
    x, y = (ends[1] - ends[0]).T
    angles = np.unwrap(np.arctan2(y, x))
    return float(np.rad2deg(angles[-1] - angles[0]))
