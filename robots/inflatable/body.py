"""The body of the inflatable shape-changing robot: a flat pouch of two skins with four bladders on either side.

The space between the skins is the core. With several cores the pouch is divided along its length: each is closed
towards its neighbours as it is along the two long edges, by a row in which the skins stay joined. Bladders have eight
places; a body may leave some of them out.

Source: Powers 2021 dissertation, ch. 5; Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021. Where the
text and the published experiment differ, the defaults are those of the experiment.

Layers from the ground up: lower bladders, lower skin, upper skin, upper bladders. Rolling is along x, inching along y.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from robots.hardware.lines import BLADDERS
from robots.inflatable.layout import EVERY_BLADDER, TOP_BLADDERS, Layout, checked_layout, layout_mask
from robots.inflatable.materials import RegionMaterials
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import Positive, check_fields, whole_number
from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.time_steps import afloat

# Regions that a program addresses. Foot seams are the third foot material of the published robot. Behind these, each
# core but the first has the five regions of its own skin, in the same order.
SKIN, SEAM, FOOT_1, FOOT_2, FOOT_SEAM = range(5)
FIRST_BLADDER = 5
BLADDER_COUNT = BLADDERS
REGION_COUNT = FIRST_BLADDER + BLADDER_COUNT
SKIN_REGIONS = np.arange(FIRST_BLADDER)
FOOT_REGIONS = np.array([FOOT_1, FOOT_2])
BLADDER_REGIONS = np.arange(FIRST_BLADDER, REGION_COUNT)
Count = Annotated[int, partial(whole_number, low=1)]
SKIN_NAMES = ("skin", "seam", "foot1", "foot2", "footseam")
# Least ratio of the largest stable time step to that of the simulation; stiffer skin takes shorter ones.
LEAST_SAFETY = 1.08
LEAST_CORE_ROWS = 3  # a wall at either end, and a row between


def skin_regions(kinds: ArrayLike, core: int) -> Ints:
    """Regions of the skin of a core, counted from 0, for such regions of the first."""
    return np.asarray(kinds) + (REGION_COUNT + FIRST_BLADDER * (core - 1) if core else 0)


def kinds_of(regions: ArrayLike) -> Ints:
    """What regions are, whichever core they belong to: ``SKIN`` to ``FOOT_SEAM``, or bladders."""
    given = np.asarray(regions)
    return np.where(given < REGION_COUNT, given, (given - REGION_COUNT) % FIRST_BLADDER)


def cores_of(regions: ArrayLike) -> Ints:
    """The core that regions of the skin belong to, counted from 0; 0 for bladders."""
    return np.maximum((np.asarray(regions) - REGION_COUNT) // FIRST_BLADDER + 1, 0)


@dataclass(frozen=True)
class InflatableGeometry:
    """Shape and materials of the inflatable robot's pouch. Defaults are the published robot: 1428 voxels, 3290 links.

    Attributes:
        bladder_columns: voxels across a bladder; the pouch is 4 bladders and the 3 seams between them wide.
        rows: voxels along the pouch.
        foot_rows: rows of the foot zone at either end, without bladders.
        bladder_layers: voxels through a bladder.
        voxel_size: h [m].
        youngs_modulus: of the skin [Pa].
        bladder_modulus: of the bladders [Pa].
        density: density of skin and bladders [kg/m^3].
        foot_seam_scale: rest size of foot seams across the pouch, in voxels.
        internal_damping: damping ratio of links.
        collision_damping: damping ratio of contacts.
        time_step_safety: the largest stable time step is divided by this.
        cores: number of cores that divide the pouch along its length, of as equal numbers of rows as possible.
        bladders: places that have a bladder: 1 to 4 on top, in order of x, and 8 to 5 underneath in the same columns.
            Others are left out, with their mass and stiffness; their numbers and regions stay, and nothing fills them.
        closed: whether pressure acts on the closed surface of a single core, as it does on those of several. By the
            published law, on faces of voxels, a pouch whose regions differ in size drives itself along.

    Raises:
        ValueError: for a value that is not allowed, or too few rows for feet or cores.
    """

    bladder_columns: Count = 3
    rows: Count = 22
    foot_rows: Count = 3
    bladder_layers: Count = 2
    voxel_size: Positive = 0.01
    youngs_modulus: Positive = 400e3
    bladder_modulus: Positive = 400e3 / 1.8
    density: Positive = 3000.0
    foot_seam_scale: Positive = 0.9
    internal_damping: Positive = 1.0
    collision_damping: Positive = 1.0
    time_step_safety: Positive = 1.3
    cores: Count = 1
    closed: bool = False
    bladders: Annotated[Layout, checked_layout] = EVERY_BLADDER

    def __post_init__(self) -> None:
        check_fields(self)
        if self.rows <= 2 * self.foot_rows:
            raise ValueError(
                f"rows: {self.rows} is not allowed; two feet of {self.foot_rows} rows leave no room for bladders"
            )
        if self.rows < LEAST_CORE_ROWS * self.cores:
            most = self.rows // LEAST_CORE_ROWS
            raise ValueError(
                f"cores: {self.cores} is not allowed; {self.rows} rows have room for 1 to {most}, each of "
                f"{LEAST_CORE_ROWS} rows or more"
            )

    @property
    def columns(self) -> int:
        """Width of the pouch in voxels."""
        return 4 * self.bladder_columns + 3

    @property
    def region_count(self) -> int:
        """Number R of regions: those of the skin of every core, and the bladders."""
        return REGION_COUNT + FIRST_BLADDER * (self.cores - 1)

    @property
    def absent_regions(self) -> tuple[int, ...]:
        """Regions of the places without a bladder, ascending; no voxel belongs to them."""
        return tuple(BLADDER_REGIONS[~layout_mask(self.bladders)].tolist())

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the regions, such as ``skin`` and ``bladder3``; those of further cores end with ``_2`` and on."""
        bladders = [f"bladder{number}" for number in range(1, BLADDER_COUNT + 1)]
        others = [f"{kind}_{core}" for core in range(2, self.cores + 1) for kind in SKIN_NAMES]
        return (*SKIN_NAMES, *bladders, *others)

    def rest_sizes(self, regions: ArrayLike) -> tuple[Floats, Floats]:
        """Return the rest sizes of regions across and along the pouch [voxels], shape (N,) each; bladders deflated."""
        kinds = kinds_of(regions)
        return np.where(kinds == FOOT_SEAM, self.foot_seam_scale, 1.0), np.ones(len(kinds))

    @property
    def core_rows(self) -> tuple[range, ...]:
        """Rows of each core, counted from 1, walls included; the same from either end of the pouch if that can be."""
        # The nearest row to each k / N of the length, halves rounded towards the ends.
        ends = [-(-(2 * self.rows * k - self.cores) // (2 * self.cores)) for k in range(self.cores + 1)]
        ends = [end if 2 * k <= self.cores else self.rows - ends[self.cores - k] for k, end in enumerate(ends)]
        return tuple(range(first + 1, last + 1) for first, last in itertools.pairwise(ends))

    @property
    def wall_rows(self) -> tuple[int, ...]:
        """Rows in which the skins are joined all across: where one core ends, and where the next begins."""
        inner = [row for rows in self.core_rows for row in (rows[0], rows[-1])]
        return tuple(inner[1:-1])

    @property
    def bladder_rows(self) -> range:
        """Range of the rows that the bladders lie on."""
        return range(self.foot_rows + 1, self.rows - self.foot_rows + 1)

    @property
    def bladder_shares(self) -> list[float]:
        """Fraction of the rows under bladders that belongs to each core."""
        under = self.bladder_rows
        return [sum(row in under for row in rows) / len(under) for rows in self.core_rows]

    @property
    def body_length(self) -> float:
        """Length of the flat pouch [m], the unit of speeds."""
        return self.rows * self.voxel_size

    @property
    def voxel_mass(self) -> float:
        """Mass of a voxel [kg]."""
        return self.density * self.voxel_size**3

    @property
    def body(self) -> LatticeBody:
        """Lattice body of the robot; built once per geometry."""
        return _bodies(self).plain

    @property
    def time_step(self) -> float:
        """Time step of the simulation [s]."""
        return self.body.recommended_time_step / self.time_step_safety

    def substeps(self, is_wet: bool, largest: float) -> int:
        """Into how many parts a time step must be divided to be stable: 1 on dry ground, more in water.

        Gaits are written in time steps, whose length is that of dry ground. In water links are balanced, and the more
        bladders swell, the shorter are the steps that are stable, see ``taichi_sim.lattice.time_steps.afloat``. Skin
        may be as stiff as ``SkinMaterials`` allow, so that a robot has the same substeps in every batch.

        Args:
            is_wet: whether the robot is in water or any fluid.
            largest: size of the bladders when they are largest [edges], see ``InflatableActuation.largest_size``.
        """
        if not is_wet:
            return 1
        return math.ceil(afloat(largest) / min(LEAST_SAFETY, self.time_step_safety))

    @property
    def most_modulus(self) -> float:
        """Largest Young's modulus of the skin for which the time step is stable, with the least margin [Pa]."""
        return self.youngs_modulus * (self.time_step_safety / LEAST_SAFETY) ** 2

    def check_materials(self, materials: RegionMaterials) -> None:
        """Refuse materials of another number of regions, or a region too stiff for the time step.

        Raises:
            ValueError: that says which.
        """
        count = self.region_count
        for name, row in (("modulus", materials.modulus), ("size", materials.size and materials.size[0])):
            if row is not None and len(row) != count:
                raise ValueError(f"{name}: {len(row)} regions are not allowed; a body with this geometry has {count}")
        moduli = materials.modulus
        if moduli is not None and (most := self.most_modulus / self.youngs_modulus) < max(moduli):
            raise ValueError(
                f"modulus: {max(moduli):g} is not allowed with this geometry, whose time step is too long for it; at "
                f"most {most:.3g}"
            )

    def relative_time_step(self, modulus: float) -> float:
        """Return the largest stable time step for skin of another modulus [Pa], relative to that of this skin.

        As 1 / sqrt(E), see ``LatticeBody.recommended_time_step``, if bladders keep their proportion.
        """
        return math.sqrt(self.youngs_modulus / modulus)


PUBLISHED = InflatableGeometry()
# Half the voxels; by the published gaits it still rolls (0.18 BL/s on flat ground) and inches (0.04). Shorter ones do
# not inch, narrower ones do not roll.
SMALL = InflatableGeometry(bladder_columns=2, rows=16, foot_rows=2)
TWO_CORE = InflatableGeometry(cores=2)
NAMED_GEOMETRIES = {
    "published": PUBLISHED,
    "small": SMALL,
    "two-core": TWO_CORE,
    "closed": replace(PUBLISHED, closed=True),
    "small-closed": replace(SMALL, closed=True),
}


def _skin_kind(geometry: InflatableGeometry, x: int, y: int) -> int:
    first_foot, last_foot = y <= geometry.foot_rows, y > geometry.rows - geometry.foot_rows
    if x % (geometry.bladder_columns + 1) == 0:
        return FOOT_SEAM if first_foot or last_foot else SEAM
    if first_foot or last_foot:
        return FOOT_1 if first_foot else FOOT_2
    return SEAM if y in geometry.wall_rows else SKIN


def _build(geometry: InflatableGeometry) -> LatticeBody:
    """Voxels layer by layer: upper skin, lower skin, then bladder by bladder, away from the skin."""
    layers, stride = geometry.bladder_layers, geometry.bladder_columns + 1
    # A body without bladders underneath lies on its lower skin.
    lower = layers if any(place > TOP_BLADDERS for place in geometry.bladders) else 0
    upper = lower + 1  # z of the skins
    plan = [(x, y) for x in range(1, geometry.columns + 1) for y in range(1, geometry.rows + 1)]
    voxels = [(x, y, z) for z in (upper, lower) for x, y in plan]
    core = {y: number for number, rows in enumerate(geometry.core_rows) for y in rows}
    regions = [int(skin_regions(_skin_kind(geometry, x, y), core[y])) for _ in range(2) for x, y in plan]
    under = [(x, y) for x, y in plan if x % stride and y in geometry.bladder_rows]
    for bladder in np.flatnonzero(layout_mask(geometry.bladders)).tolist():
        # Bladders 1 to 4 lie on top, in order of x; 8 to 5 are the same columns underneath.
        on_top = bladder < TOP_BLADDERS
        group = bladder if on_top else BLADDER_COUNT - 1 - bladder
        depths = range(upper + 1, upper + 1 + layers) if on_top else range(lower - 1, -1, -1)
        places = [(x, y, z) for x, y in under if x // stride == group for z in depths]
        voxels += places
        regions += [FIRST_BLADDER + bladder] * len(places)
    skins = len(plan)
    # The skins are joined along the two long edges and the walls only: the spaces between them are the cores.
    cut = [(i, i + skins) for i, (x, y) in enumerate(plan) if 1 < x < geometry.columns and y not in geometry.wall_rows]
    chambers = cores_of(regions)
    if geometry.closed and geometry.cores == 1:
        # Pressure acts on closed surfaces where there are several chambers: bladders are one that no pressure fills.
        chambers = np.where(kinds_of(regions) >= FIRST_BLADDER, 1, 0)
    normals = np.zeros((len(voxels), 3), int)
    normals[:skins, 2], normals[skins : 2 * skins, 2] = 1, -1
    return LatticeBody(
        voxels=np.array(voxels),
        materials=_materials(geometry),
        material_index=np.minimum(kinds_of(regions), FIRST_BLADDER),
        voxel_size=geometry.voxel_size,
        regions=np.array(regions),
        cut_links=np.array(cut).reshape(-1, 2),
        pressure_normals=normals,
        chambers=chambers,
    )


def _materials(geometry: InflatableGeometry) -> tuple[Material, ...]:
    """One material per skin region and one for the bladders; friction and bladder scales belong to the program."""

    skin = geometry.youngs_modulus
    kinds = (
        ("skin", skin, 1.0),
        ("seam", skin, 1.0),
        ("foot 1", skin, 1.0),
        ("foot 2", skin, 1.0),
        ("foot seam", skin, geometry.foot_seam_scale),
        ("bladder", geometry.bladder_modulus, 1.0),
    )
    return tuple(
        Material(
            modulus,
            geometry.density,
            internal_damping=geometry.internal_damping,
            collision_damping=geometry.collision_damping,
            scale=(across, 1.0, 1.0),
            name=name,
        )
        for name, modulus, across in kinds
    )


@dataclass(frozen=True)
class _Bodies:
    """The bodies of one geometry, which are forgotten together, so that they share one topology."""

    geometry: InflatableGeometry

    @cached_property
    def plain(self) -> LatticeBody:
        """The body of the published materials."""
        return _build(self.geometry)

    @cached_property
    def by_region(self) -> LatticeBody:
        """The body with a material of its own in every region."""
        kinds = np.minimum(kinds_of(np.arange(self.geometry.region_count)), FIRST_BLADDER)
        return self.plain.with_materials((self.plain.materials[kind] for kind in kinds), self.plain.regions)


_bodies = lru_cache(maxsize=64)(_Bodies)  # a generation may be of as many layouts of bladders


def bodies_of(geometry: InflatableGeometry, moduli: Sequence[tuple[float, ...] | None]) -> list[LatticeBody]:
    """A body for each robot of a batch, or a single one where no robot has moduli of its own.

    Args:
        geometry: of all.
        moduli: of the regions of each robot, relative to those of the geometry, shape (R,); None has those.
    """
    if not any(moduli):
        return [geometry.body]
    common, built = _bodies(geometry).by_region, dict[tuple[float, ...] | None, LatticeBody]()
    for factors in set(moduli):
        each = zip(common.materials, factors or (1.0,) * geometry.region_count, strict=True)
        materials = tuple(replace(m, youngs_modulus=m.youngs_modulus * factor) for m, factor in each)
        built[factors] = common.with_materials(materials)
    return [built[factors] for factors in moduli]
