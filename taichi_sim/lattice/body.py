"""The description of a lattice body: voxels, materials, regions, cut links, fixed voxels, pressurised faces."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.checks import choice
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import time_steps
from taichi_sim.lattice.materials import Material, voxel_mass
from taichi_sim.lattice.topology import Topology, build_topology

LINK_LAWS = USUAL_LINKS, BALANCED, PUBLISHED = "alike", "balanced", "published"

MOST_LABELS = 100_000  # of regions and chambers, which may be more than voxels: memory is taken for each


def _frozen(array: object, dtype: type, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A read-only copy of the given shape (-1 is any), or a one-line ValueError."""
    given = np.asarray(array)
    fits = given.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, given.shape, strict=True))
    if not fits:
        wanted = "(" + ", ".join("n" if s == -1 else str(s) for s in shape) + ")"
        raise ValueError(f"{name}: shape {given.shape} is not allowed; it must be {wanted}")
    if given.dtype.kind == "f" and not np.all(np.isfinite(given) & (given == np.round(given))):
        raise ValueError(f"{name}: only whole numbers are allowed")
    result: np.ndarray = given.astype(dtype, order="C")  # rounding depends on the order in which numbers lie
    result.setflags(write=False)
    return result


@dataclass(frozen=True, eq=False, repr=False)
class LatticeBody(ShortText):
    """A soft body: cubic voxels on a lattice, whose neighbours are joined by beams.

    Attributes:
        voxels: places on the lattice, shape (V, 3), whole numbers; voxel i starts at ``voxel_size * voxels[i]`` [m].
        materials: the materials in use.
        material_index: material of each voxel, shape (V,).
        voxel_size: edge h [m].
        regions: label of the group that a program can address, shape (V,), 0 to R-1; by default the material.
        cut_links: pairs of neighbouring voxels without a beam, shape (C, 2), indices into ``voxels``.
        fixed: degrees of freedom held by the world (x, y, z, rotation about x, y, z), shape (V, 6).
        pressure_normals: which way the region's pressure pushes a voxel, along the axes of its own frame, shape
            (V, 3), entries -1, 0, 1; zero where no pressure acts. The force is +pressure times the area of a face
            times this. To inflate a hollow body, point them away from the cavity.
        chambers: which of several volumes, each closed by its own skin, pressurised voxels enclose, shape (V,); all
            the same one by default. Of several, pressure acts on the closed surfaces, see ``enclosure``.
        links: law of the links. ``"published"`` is that of the published simulator, which damps either end as its own
            material says: bodies of materials unlike in density or damping push themselves along. ``"alike"`` damps
            both ends alike, see ``materials.beam_row``. ``"balanced"`` does so, too, and keeps angular momentum, as all
            links do in water, see ``laws.link.balanced``: bodies do not turn themselves; large voxels take shorter
            time steps.

    Raises:
        ValueError: if a field is not allowed; names the field, the value and what is allowed.
    """

    voxels: np.ndarray
    materials: tuple[Material, ...]
    material_index: np.ndarray
    voxel_size: float
    regions: np.ndarray | None = None
    cut_links: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    fixed: np.ndarray | None = None
    pressure_normals: np.ndarray | None = None
    chambers: np.ndarray | None = None
    links: str = USUAL_LINKS

    def __post_init__(self) -> None:
        put = lambda name, value: object.__setattr__(self, name, value)  # noqa: E731 - a frozen dataclass fills itself
        put("voxels", _frozen(self.voxels, np.int64, "voxels", (-1, 3)))
        count = len(self.voxels)
        if count == 0:
            raise ValueError("voxels: the body is empty; give at least one voxel")
        places, counts = np.unique(self.voxels, axis=0, return_counts=True)
        if counts.max() > 1:
            raise ValueError(
                f"voxels: {counts.max()} voxels at {tuple(places[counts.argmax()].tolist())}; one is allowed"
            )
        if not (np.isfinite(self.voxel_size) and self.voxel_size > 0):
            raise ValueError(f"voxel_size: {self.voxel_size!r} is not allowed; it must be positive")
        put("voxel_size", float(self.voxel_size))
        put("materials", tuple(self.materials))
        put("material_index", _frozen(self.material_index, np.int64, "material_index", (count,)))
        choice("links", self.links, LINK_LAWS)
        for name, dtype, shape, usual in (
            ("regions", np.int64, (count,), self.material_index),
            ("fixed", bool, (count, 6), np.zeros((count, 6))),
            ("pressure_normals", np.int8, (count, 3), np.zeros((count, 3))),
            ("chambers", np.int64, (count,), np.zeros(count)),
            ("cut_links", np.int64, (-1, 2), None),
        ):
            given = getattr(self, name)
            put(name, _frozen(usual if given is None else given, dtype, name, shape))
        if self.material_index.min() < 0 or self.material_index.max() >= len(self.materials):
            raise ValueError(f"material_index: must lie in 0..{len(self.materials) - 1}")
        for name in ("regions", "chambers"):
            labels, most = getattr(self, name), max(count, MOST_LABELS) - 1
            for wrong in labels[(labels < 0) | (labels > most)][:1]:
                raise ValueError(f"{name}: label {wrong} is not allowed; give 0 to {most}")
        if np.abs(self.pressure_normals).max(initial=0) > 1:  # type: ignore[arg-type]
            raise ValueError("pressure_normals: entries must be -1, 0 or 1")
        self._check_cut_links()

    def _check_cut_links(self) -> None:
        for first, second in self.cut_links:
            known = min(first, second) >= 0 and max(first, second) < len(self.voxels)
            if not known or np.abs(self.voxels[first] - self.voxels[second]).sum() != 1:
                raise ValueError(
                    f"cut_links: ({first}, {second}) are not neighbouring voxels; only their link can be cut"
                )

    @property
    def voxel_count(self) -> int:
        """Number V of voxels."""
        return len(self.voxels)

    @property
    def is_published(self) -> bool:
        """Whether links damp either end as its own material says."""
        return self.links == PUBLISHED

    @property
    def is_balanced(self) -> bool:
        """Whether links keep angular momentum on dry ground, too."""
        return self.links == BALANCED

    @property
    def has_chambers(self) -> bool:
        """Whether pressurised voxels enclose several volumes."""
        return len(np.unique(self.chambers)) > 1  # type: ignore[arg-type]

    @property
    def region_count(self) -> int:
        """Number R of regions: one more than the largest label."""
        return int(self.regions.max()) + 1  # type: ignore[union-attr]

    @property
    def start_positions(self) -> np.ndarray:
        """Voxel centres before the simulation [m], shape (V, 3)."""
        return self.voxels * self.voxel_size

    def scattered(self, deviation: float, seeds: int | Sequence[int], robots: ArrayLike) -> np.ndarray:
        """Return start positions of B robots with Gaussian noise [m], shape (B, V, 3).

        Args:
            deviation: standard deviation [m].
            seeds: one seed, from which each robot has a stream of its own; or a seed for each robot, by its number.
            robots: numbers of the B robots, shape (B,).
        """
        rows = np.asarray(robots).tolist()
        streams = [(seeds, row) if isinstance(seeds, int) else (seeds[row], 0) for row in rows]
        noise = [np.random.default_rng(stream).normal(0.0, deviation, self.voxels.shape) for stream in streams]
        return self.start_positions + np.array(noise)

    @cached_property
    def topology(self) -> Topology:
        """Links, faces and contact exclusions, derived once."""
        return build_topology(self.voxels, self.cut_links)

    def with_materials(self, materials: Iterable[Material], material_index: ArrayLike | None = None) -> "LatticeBody":
        """Return the same voxels with other materials; by default each keeps its index into the materials.

        What follows from places alone, which every engine needs, is derived once for all such bodies.
        """
        index = self.material_index if material_index is None else np.asarray(material_index)
        found = replace(self, materials=tuple(materials), material_index=index)
        vars(found)["topology"] = self.topology
        return found

    @cached_property
    def recommended_time_step(self) -> float:
        """Largest stable time step [s]: 1 / (2 pi sqrt(max a1 / min(m-, m+))) of links, less for what else needs less.

        That is damping ratios of links above 1, and against the world; contact with the floor, of voxels that are much
        stiffer than those they are linked to or damped much more; and contact of parts that no links join with each
        other. See ``time_steps``; blocks of many voxels need 1 / 1.3 of it.
        """
        ends = self.material_index[self.topology.links] if len(self.topology.links) else np.zeros((0, 2), int)
        pairs = [(self.materials[minus], self.materials[plus]) for minus, plus in np.unique(ends, axis=0)]
        steps = [time_steps.link_step(minus, plus, self.voxel_size, self.is_published) for minus, plus in pairs]
        if not pairs:
            stiffest = max(m.youngs_modulus * self.voxel_size / voxel_mass(m, self.voxel_size) for m in self.materials)
            steps = [float(1 / (2 * np.pi * np.sqrt(stiffest)))]
        return min(*steps, self._contact_step)

    def stable_time_step(self, is_afloat: bool, sizes: tuple[float, float] | None = None) -> float:
        """Return the largest stable time step [s], :attr:`recommended_time_step` on dry ground at usual sizes.

        Args:
            is_afloat: whether it is in water, or in any fluid, where all links are balanced.
            sizes: smallest and largest rest size that its voxels may reach [edges]; None is those of their materials.
        """
        least, most = self.sizes if sizes is None else sizes
        step = self.recommended_time_step / time_steps.shrunk(least)
        return step / time_steps.afloat(most) if is_afloat or self.is_balanced else step

    @property
    def sizes(self) -> tuple[float, float]:
        """Smallest and largest rest size of a voxel before anything is driven [edges], by its material."""
        used = [self.materials[number] for number in np.unique(self.material_index)]
        warmed = [(m.scale, 1 + m.thermal_expansion * m.temperature) for m in used]
        return min(min(size) * by for size, by in warmed), max(max(size) * by for size, by in warmed)

    @property
    def _contact_step(self) -> float:
        """Largest step for contact of voxels with the floor, and of parts that no links join with each other [s]."""
        part = self.topology.parts
        sizes, found = np.bincount(part), math.inf
        held = np.asarray(self.fixed)[:, :3].all(axis=1)
        for index in np.unique(self.material_index[~held]):
            found = min(found, time_steps.floor_step(self.materials[index], self.voxel_size))
        if len(sizes) == 1 < self.voxel_count:
            return found
        kinds, members = np.unique(np.stack([self.material_index, held], axis=1), axis=0, return_inverse=True)
        members = members.reshape(-1)
        owners = [np.unique(part[members == kind]) for kind in range(len(kinds))]
        for one, two in itertools.combinations_with_replacement(range(len(kinds)), 2):
            if len(owners[one]) == len(owners[two]) == 1 and owners[one][0] == owners[two][0]:
                continue  # both are in one part alone
            (first, fixed), (second, also) = kinds[one].tolist(), kinds[two].tolist()
            pair = self.materials[first], self.materials[second]
            found = min(found, time_steps.contact_step(*pair, self.voxel_size, (bool(fixed), bool(also))))
        return found
