"""Lattice robots among props: one lattice of all bodies, and which part of it is the robot."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robots.props import Prop
from robots.world import MATERIAL_FRICTION
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.lattice import Felt, LatticeBody, Material, Quantity, Relief, time_steps
from taichi_sim.lattice.laws.contact import SPHERE_RADIUS
from taichi_sim.lattice.program import EVENT

MODULUS = 1e5  # Pa
FRICTION = 1.0, 0.8  # static and kinetic, where the terrain says nothing
APART = 3  # voxels between bodies on the lattice, so that nothing links them
TOUCH = 2 * SPHERE_RADIUS  # edges between centres of voxels that touch
DIAGONAL = 1e-9  # difference of sine and cosine below which a heading is diagonal
SLOWEST = 50.0  # by how much props may shorten the time steps of a robot, at most
SUNK = 1e-3  # edges in the ground at which a prop may start, as places are rounded


@dataclass(frozen=True, eq=False)
class Placed:
    """A robot and props as one lattice.

    Attributes:
        robot: the robot's own body.
        body: of all; the robot's voxels come first.
        shift: from places on the lattice to where voxels start [m], shape (V, 3).
        groups: which body each voxel belongs to: 0 the robot, then the props, shape (V,).
        lifted: whether each body starts above the ground, at a height that counts from where the robot stands.
        held: whether the world holds each body.
    """

    robot: LatticeBody
    body: LatticeBody
    shift: Floats
    groups: Ints
    lifted: tuple[bool, ...]
    held: tuple[bool, ...]

    @property
    def own(self) -> int:
        """Number of the robot's voxels."""
        return self.robot.voxel_count

    @cached_property
    def own_links(self) -> Ints:
        """Numbers of the robot's links."""
        found: Ints = np.flatnonzero((self.body.topology.links < self.own).all(axis=1))
        return found

    def of(self, group: int) -> Bools:
        """Mask of the voxels of one body, shape (V,)."""
        found: Bools = self.groups == group
        return found

    def own_part(self, felt: Felt) -> Felt:
        """The robot's part of what was felt of all bodies."""
        own = np.ascontiguousarray(felt.strains[:, self.own_links])  # summed as in a batch of one
        return Felt(positions=felt.positions[:, : self.own], orientations=felt.orientations[:, : self.own], strains=own)

    def widened(self, felt: Felt) -> Felt:
        """Derivatives by all bodies' voxels and links from those by the robot's: zero for props."""
        batch, count, links = len(felt.positions), self.body.voxel_count, len(self.body.topology.links)
        every = Felt(
            positions=np.zeros((batch, count, 3)),
            orientations=np.zeros((batch, count, 4)),
            strains=np.zeros((batch, links)),
        )
        every.positions[:, : self.own], every.orientations[:, : self.own] = felt.positions, felt.orientations
        every.strains[:, self.own_links] = felt.strains
        return every

    def holding(self, centres: Floats) -> Any:
        """Events that hold bodies where they start, not where they are on the lattice; voxel centres (B, V, 3) [m]."""
        events = []
        for group in np.flatnonzero(self.held).tolist():
            first = int(np.argmax(self.of(group)))
            moved, region = centres[:, first] - self.body.start_positions[first], np.asarray(self.body.regions)[first]
            one = np.zeros((len(centres), 3), EVENT)
            one["robot"], one["region"] = np.arange(len(centres))[:, None], region
            one["quantity"], one["value"] = Quantity.TRANSLATION + np.arange(3), moved
            events.append(one.ravel())
        return np.concatenate(events) if events else np.zeros(0, EVENT)

    def standing(self, centres: Floats, relief: Relief) -> Floats:
        """Voxel centres at the start [m], shape (V, 3), each body raised so that it stands on uneven ground."""
        raised, edge = np.array(centres), self.body.voxel_size
        base = relief.rise(centres[self.of(0)], edge)
        for group, lifted in enumerate(self.lifted):
            rows = self.of(group)
            raised[rows, 2] += base if lifted or group == 0 else relief.rise(centres[rows], edge)
        return raised

    def check_start(self, props: Sequence[Prop], relief: Relief | None) -> None:
        """Refuse props that start inside uneven ground, or nearer to other bodies than where they would touch.

        Raises:
            ValueError: names the first such prop, and what is allowed.
        """
        level = self.body.start_positions + self.shift
        if relief is not None:
            self._check_above(props, level, relief)
        standing = level if relief is None else self.standing(level, relief)
        bodies = np.split(standing, np.flatnonzero(np.diff(self.groups)) + 1)
        for group in range(1, len(bodies)):
            for other in range(group):
                if not (self.held[group] and self.held[other]):  # the world holds walls, so none throws another
                    self._check_apart(props, bodies, (group, other), relief is not None)

    def _check_apart(
        self, props: Sequence[Prop], bodies: Sequence[Floats], pair: tuple[int, int], uneven: bool
    ) -> None:
        """Refuse a pair of bodies, the later one first, if voxels start nearer to each other than where they touch.

        Raises:
            ValueError: names the prop of the two whose height can change, or the later one, and what is allowed.
        """
        edge, (group, other) = self.body.voxel_size, pair
        least = TOUCH * edge
        nearest = _nearest(bodies[group], bodies[other], least)
        if nearest >= least * (1 - 1e-9) - (SUNK * edge if uneven else 0.0):
            return
        named = other if self.lifted[other] and not self.lifted[group] else group
        prop, beside = props[named - 1], "another prop" if other else "the robot"
        told = f"prop: {prop.name} is not allowed {nearest:.3g} m from {beside} (between centres of voxels"
        if not uneven or prop.z is None:
            raise ValueError(f"{told}{', on their ground' if uneven else ''}); give at least {least:.3g} m")
        others = np.concatenate([body for number, body in enumerate(bodies[: group + 1]) if number != named])
        height = math.ceil((prop.z + _rise_above(bodies[named], others, least)) * 1e4) / 1e4
        raise ValueError(f"{told}, on their ground); give a Z of at least {height:.4f} m, or another X and Y")

    def _check_above(self, props: Sequence[Prop], starts: Floats, relief: Relief) -> None:
        """Refuse loose props that start inside uneven ground, which would throw them out.

        Raises:
            ValueError: names the height of the first such prop, and the least that is allowed.
        """
        base, edge = relief.rise(starts[self.of(0)], self.body.voxel_size), self.body.voxel_size
        for group, prop in enumerate(props, start=1):
            if prop.z is None or prop.held:
                continue
            depth = relief.rise(starts[self.of(group)], edge) - base
            if depth > SUNK * edge:
                least = math.ceil((prop.z + depth) * 1e4) / 1e4
                raise ValueError(
                    f"prop: {prop.name} is not allowed with Z = {prop.z:g} m, {depth:.3g} m deep in the ground; give a "
                    f"Z of at least {least:.4f} m, or 'ground' to stand it on the ground below it"
                )


def placed(
    robot: LatticeBody,
    props: Sequence[Prop],
    heading: Floats,
    friction: Mapping[str, float],
    relief: Relief | None = None,
) -> Placed:
    """The lattice of a robot and props.

    Args:
        robot: its body.
        props: beside it.
        heading: its direction of travel, shape (3,).
        friction: that the terrain gives to all materials, by the names of their fields.
        relief: uneven ground that all will stand on; None is level.

    Raises:
        ValueError: for bodies that overlap at the start, props that start inside the ground, and those too light or too
            heavy to touch each other.
    """
    check_weights([robot.materials[number] for number in np.unique(robot.material_index)], props, robot.voxel_size)
    edge, middle = robot.voxel_size, robot.start_positions.mean(axis=0)
    left = np.array([-heading[1], heading[0], 0.0])
    voxels, materials, indices = [robot.voxels], list(robot.materials), [robot.material_index]
    regions, fixed = [np.asarray(robot.regions)], [np.asarray(robot.fixed)]
    starts, groups = [robot.start_positions], [np.zeros(robot.voxel_count, int)]
    for number, prop in enumerate(props, start=1):
        cells = _turned(prop.cells(edge), heading)
        centred = (cells - (cells.max(axis=0) / 2) * [1, 1, 0]) * edge
        place = middle * [1, 1, 0] + prop.x * heading + prop.y * left + [0.0, 0.0, prop.z or 0.0]
        beyond = max(int(each[:, 0].max()) for each in voxels) + APART - int(cells[:, 0].min())
        voxels.append(cells + np.array([beyond, 0, 0]))
        indices.append(np.full(len(cells), len(materials)))
        materials.append(_material(prop.density, _friction(prop, friction)))
        regions.append(np.full(len(cells), max(int(each.max()) for each in regions) + 1))
        fixed.append(np.full((len(cells), 6), prop.held))
        starts.append(place + centred)
        groups.append(np.full(len(cells), number))
    whole = {"voxels": voxels, "material_index": indices, "regions": regions, "fixed": fixed}
    more = robot.voxel_count, sum(len(each) for each in voxels[1:])
    normals, chambers = np.asarray(robot.pressure_normals), np.asarray(robot.chambers)
    whole["pressure_normals"] = [normals, np.zeros((more[1], 3), normals.dtype)]
    whole["chambers"] = [chambers, np.full(more[1], chambers[0])]  # props have none of their own
    fields: dict[str, Any] = {name: np.concatenate(each) for name, each in whole.items()}
    body = dataclasses.replace(robot, materials=tuple(materials), **fields)
    shift = np.concatenate(starts) - body.start_positions
    lifted, held = (prop.z is not None for prop in props), (prop.held for prop in props)
    found = Placed(robot, body, shift, np.concatenate(groups), (False, *lifted), (False, *held))
    found.check_start(props, relief)
    return found


def _turned(cells: Ints, heading: Floats) -> Ints:
    """Cells of a prop with its edges along the heading and to the left of it, to the nearest quarter turn.

    A prop looks the same from behind, so half a turn changes nothing, and diagonal headings keep x and y.
    """
    return cells[:, [1, 0, 2]] if abs(heading[1]) > abs(heading[0]) + DIAGONAL else cells


def _friction(prop: Prop, given: Mapping[str, float]) -> tuple[float, float]:
    """Static and kinetic friction of a prop: its own, unless the terrain gives it."""
    usual = zip(MATERIAL_FRICTION, FRICTION, strict=True)
    static, kinetic = (given.get(name, prop.rubbing * value) for name, value in usual)
    return static, kinetic


def _material(density: float, friction: tuple[float, float] = FRICTION) -> Material:
    """What a prop of a density [kg/m^3] is made of."""
    return Material(MODULUS, density, static_friction=friction[0], kinetic_friction=friction[1])


def time_step_among(materials: Sequence[Material], props: Sequence[Prop], edge: float) -> float:
    """Largest time step [s] that is stable for props, of voxels of an edge h [m], and their contact with materials.

    Raises:
        ValueError: as of :func:`check_weights`.
    """
    check_weights(materials, props, edge)
    densities = [prop.density for prop in props]
    return min(_links_step(props, densities, edge), _contact_step(materials, props, densities, edge))


def check_weights(materials: Sequence[Material], props: Sequence[Prop], edge: float) -> None:
    """Refuse props whose links or contact would take time steps very much shorter than a robot of materials alone.

    Raises:
        ValueError: names the density of the prop that differs most from the robot's, and what is allowed.
    """
    densities = [prop.density for prop in props]
    own = min(time_steps.link_step(one, two, edge) for one, two in itertools.product(materials, repeat=2))

    def shortens(densities: Sequence[float]) -> float:
        return own / min(_links_step(props, densities, edge), _contact_step(materials, props, densities, edge))

    if not props or (times := shortens(densities)) <= SLOWEST:
        return
    usual = math.exp(float(np.mean([math.log(material.density) for material in materials])))
    worst = max(props, key=lambda prop: abs(math.log(prop.density / usual)))
    told = f"take time steps {times:.3g} times as short, {SLOWEST:g} at most are allowed"
    if shortens([usual] * len(props)) > SLOWEST:
        softest = min(material.youngs_modulus for material in materials)
        raise ValueError(
            f"prop: {worst.name} is not allowed beside a robot as soft as {softest:g} Pa, as props of {MODULUS:g} Pa "
            f"would {told}; leave props out"
        )
    is_light = worst.density < usual
    bad, good = worst.density, usual
    for _ in range(50):  # bisection for the density at which all props that are worse would be allowed
        middle = math.sqrt(bad * good)
        within = [max(each, middle) if is_light else min(each, middle) for each in densities]
        bad, good = (bad, middle) if shortens(within) <= SLOWEST else (middle, good)
    unit = 10.0 ** (math.floor(math.log10(good)) - 1)  # two digits, on the safe side
    digits = math.ceil(good / unit) if is_light else math.floor(good / unit)
    raise ValueError(
        f"density: {worst.density:g} kg/m^3 of the prop {worst.name} is not allowed beside a robot of {usual:.4g}; it "
        f"would {told}; give at {'least' if is_light else 'most'} {digits * unit:g} kg/m^3"
    )


def _links_step(props: Sequence[Prop], densities: Sequence[float], edge: float) -> float:
    """Largest stable time step of the links of props, were they of these densities [s]."""
    linked = (_material(each) for prop, each in zip(props, densities, strict=True) if not prop.is_voxel(edge))
    return min((time_steps.link_step(each, each, edge) for each in linked), default=math.inf)


def _contact_step(
    materials: Sequence[Material], props: Sequence[Prop], densities: Sequence[float], edge: float
) -> float:
    """Largest stable time step of the contact of props, were they of these densities, with all else [s]."""
    bodies = [(_material(each), prop.held) for prop, each in zip(props, densities, strict=True)]
    found = [math.inf]
    for number, (material, held) in enumerate(bodies):
        others = [(own, False) for own in materials] + bodies[:number]
        found += [time_steps.contact_step(other, material, edge, (fixed, held)) for other, fixed in others]
        if props[number].is_voxel(edge) and not held:
            found.append(time_steps.floor_step(material, edge))
    return min(found)


def _nearest(one: Floats, other: Floats, least: float) -> float:
    """Distance between the nearest voxels of two bodies, by their centres [m]; infinity far above a least."""
    from scipy.spatial import cKDTree

    low = np.maximum(one.min(axis=0), other.min(axis=0)) - least
    high = np.minimum(one.max(axis=0), other.max(axis=0)) + least
    near = [each[((each >= low) & (each <= high)).all(axis=1)] for each in (one, other)]
    return float(cKDTree(near[0]).query(near[1])[0].min()) if len(near[0]) and len(near[1]) else math.inf


def _rise_above(body: Floats, others: Floats, least: float) -> float:
    """How far a body must rise so that, there and higher, no voxel is nearer to one of others than a least [m]."""
    from scipy.spatial import cKDTree

    columns = [np.unique(each[:, :2], axis=0, return_inverse=True) for each in (body, others)]
    bottoms, tops = (
        np.full(len(places), filled) for (places, _), filled in zip(columns, (np.inf, -np.inf), strict=True)
    )
    np.minimum.at(bottoms, columns[0][1].ravel(), body[:, 2])
    np.maximum.at(tops, columns[1][1].ravel(), others[:, 2])
    trees = [cKDTree(places) for places, _ in columns]
    beside = trees[0].sparse_distance_matrix(trees[1], least, output_type="coo_matrix")
    rises = tops[beside.col] + np.sqrt(least**2 - beside.data**2) - bottoms[beside.row]
    return float(rises.max(initial=0.0))
