"""A robot of the user's own: a lattice body, what drives it, and what a search may change of both."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.control.cyclic import LEAST_FREQUENCY, MOST_FREQUENCY, Cycle, Cyclic
from robots.lattice_robot import reach
from robots.lattice_robot.description import description_of
from robots.lattice_robot.design_space import DesignSpace
from robots.lattice_robot.doubts import doubts_of, doubts_on
from robots.lattice_robot.drive import Drive, Free, check_drives
from robots.lattice_robot.export import LatticeExports
from robots.lattice_robot.faults import caution_of, fault_of
from robots.lattice_robot.formats import ROBOT_FORMAT
from robots.lattice_robot.ground import material_friction
from robots.lattice_robot.links import facts_of_links
from robots.lattice_robot.measures import OF_PROPS, checked_target, measures_among, measures_of
from robots.lattice_robot.props import Placed, placed
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.robustness import perturbed_robot
from robots.lattice_robot.rollout import Aim, ahead, footprint_of, turned
from robots.lattice_robot.simulation import felt_over_time, outcome_of, try_points, try_variants
from robots.lattice_robot.soft_motion import TOLD_ANYWAY
from robots.own_measures import OwnMeasure, checked_own_measures
from robots.robot import Facts, Measure, Outcome, Parameter, Trial, World
from robots.uncertainty import Perturbation
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import number, numbers, positive, whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_record
from taichi_sim.base.short_text import counted
from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.materials import channel_values

if TYPE_CHECKING:
    from robots.view.motion import Motion

MOST_CYCLES = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class LatticeRobot(Cyclic, LatticeExports):
    """A soft robot: any lattice body, whose drives move groups of its regions in a repeated cycle.

    Attributes:
        body: lattice body of the robot; it is moved so that it stands on the ground.
        drives: groups of its regions, each with the wave that it follows.
        moduli: free Young's moduli of materials [Pa], by the materials' names or numbers from 0.
        frequency: cycles per second [Hz], 0.1 to 100.
        cycles: number of cycles that count, 1 to 10,000; another one comes before them.
        settling: time before they begin, in which driven regions go to where the cycle begins [s], up to 1000.
        heading: direction of travel [degrees] from x towards y; on a slope it is uphill.
        time_step_safety: the largest stable time step is divided by this.
        name: for people.
        target: point (x, y) that it should come near, from where its centre of mass starts [m]; None for none.
        reference_length: length by which speeds are divided [m]; None is that of the body along its heading.
        perturbation: standard deviation of noise on the start positions [m], below a voxel's edge.
        seed: of the noise.
        reflexes: what it feels, and how that changes its waves; None for a robot that feels nothing.
        placed: the robot among the props of a terrain, see :meth:`on`; ``body`` is then that of all.
        highest_moduli: Young's moduli [Pa] of its first materials with which time steps are stable; by default its own.
            Designs of a search have the highest of the search, whose time steps they keep so.
        lowest_size, highest_size: smallest rest size of voxels [edges] for which time steps are stable, and largest
            for which those in water are; by default what its own drives reach. Designs have those of their search.
        largest_amplitude: largest amplitude of sizes that uncertain levels make of one [edges]; None for any.
        is_afloat: whether it is in water, whose time steps are shorter, see :meth:`on`.
        origin: place (x, y, z) that the first place of the body's grid had in the file that it was made of [m]: what is
            exported for printers lies there again. Motions are counted from the grid.
        own_measures: of the user, see ``robots.own_measures``; installed ones may be given by name.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """

    body: LatticeBody
    drives: tuple[Drive, ...]
    moduli: Mapping[str | int, Free] = field(default_factory=dict)
    frequency: float = 4.0
    cycles: int = 4
    settling: float = 0.25
    heading: float = 0.0
    time_step_safety: float = 1.3
    name: str = "robot"
    target: tuple[float, float] | None = None
    reference_length: float | None = None
    perturbation: float = 0.0
    seed: int = 0
    reflexes: Reflexes | None = None
    placed: Placed | None = None
    highest_moduli: tuple[float, ...] = ()
    highest_size: float | None = None
    lowest_size: float | None = None
    largest_amplitude: float | None = None
    is_afloat: bool = False
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    own_measures: tuple[OwnMeasure, ...] = ()

    kind = "lattice"
    worlds = (Terrain(),)
    differentiable = True
    horizons = (1, 2, 4)

    def __post_init__(self) -> None:
        number("frequency", self.frequency, LEAST_FREQUENCY, MOST_FREQUENCY, "Hz")
        whole_number("cycles", number("cycles", self.cycles, 1, MOST_CYCLES), 1)
        number("settling", self.settling, 0.0, 1000.0, "s")
        number("heading", self.heading, unit="degrees")
        number("time_step_safety", self.time_step_safety, 1e-3)
        number("perturbation", self.perturbation, 0.0, self.body.voxel_size, "m")
        whole_number("seed", self.seed, 0)
        lengths = {"reference_length": 1e6, "highest_size": 1e3, "lowest_size": 1e3, "largest_amplitude": 1e3}
        for name, most in lengths.items():
            if getattr(self, name) is not None:
                positive(name, getattr(self, name), most)
        if self.target is not None:
            object.__setattr__(self, "target", checked_target(self.target))
        object.__setattr__(self, "origin", tuple(numbers("origin", self.origin, 3).tolist()))
        object.__setattr__(self, "drives", tuple(self.drives))
        object.__setattr__(self, "own_measures", checked_own_measures(self.own_measures, TOLD_ANYWAY))
        check_drives(self.drives, self.body)
        if lowest := int(self.body.voxels[:, 2].min()):
            grounded = dataclasses.replace(self.body, voxels=self.body.voxels - [0, 0, lowest])
            object.__setattr__(self, "body", grounded)
        highest = tuple(positive("highest_moduli", each) for each in self.highest_moduli)
        if len(highest) > len(self.body.materials):
            raise ValueError(f"highest_moduli: {len(highest)} do not fit {len(self.body.materials)} materials")
        object.__setattr__(self, "highest_moduli", highest)
        _ = self.free_moduli  # which checks their names
        if self.reflexes is not None:
            self.reflexes.check(self.body, self.felt_regions)

    @cached_property
    def _space(self) -> DesignSpace:
        """Its free values, and their places in points."""
        return DesignSpace(self.body, self.drives, self.moduli, self.reflexes, self.highest_moduli)

    @property
    def free_moduli(self) -> dict[int, Free]:
        """Free Young's moduli [Pa] by the numbers of their materials."""
        return self._space.free_moduli

    @property
    def free(self) -> dict[str, Free]:
        """Free numbers of the robot by name, in the order of points."""
        return self._space.free

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Free parameters of the robot; a phase whose bounds span a whole cycle is an angle."""
        return self._space.parameters

    @property
    def felt_regions(self) -> tuple[int, ...]:
        """Labels of the regions whose scale is driven; the reflexes feel and change these."""
        return self._space.felt_regions

    def weights_of(self, points: Floats) -> Floats:
        """Return the weights of the reflexes at N points, shape (N, K)."""
        return self._space.weights_of(points)

    def bodies(self, points: Floats) -> list[LatticeBody]:
        """Return the body of each point; the same object for all if no modulus is free."""
        return self._space.bodies(points)

    def filled(self, point: ArrayLike) -> "LatticeRobot":
        """Return the robot of a point with nothing free, with the same time step as this one."""
        points = self.points(point)
        each = zip(self.drives, self._space.shares(points[:1]), strict=True)
        drives, body = tuple(drive.filled(share[0].tolist()) for drive, share in each), self.bodies(points)[0]
        own: dict[str, Any] = {"body": body, "drives": drives, "moduli": {}}
        if self.moduli:
            own["highest_moduli"] = tuple(m.youngs_modulus for m in self._space.stiffest.materials)
        if self.reflexes is not None:
            weights = tuple(self.weights_of(points)[0].tolist())
            own["reflexes"] = dataclasses.replace(self.reflexes, weights=weights)
        return reach.kept(self, dataclasses.replace(self, **own))

    def design(self, point: ArrayLike) -> "LatticeRobot":
        """Return the robot of a point with nothing free."""
        return self.filled(point)

    @cached_property
    def size_range(self) -> tuple[float, float]:
        """Smallest and largest rest size of a voxel for which its time steps are stable [edges]."""
        return reach.size_range(self)

    @cached_property
    def cycle(self) -> Cycle:
        """Timing of the cycles in the robot's surroundings; all points have the same time step."""
        stable = self._space.stiffest.stable_time_step(self.is_afloat, self.size_range)
        largest = stable / self.time_step_safety
        return Cycle(self.frequency, self.settling, self.cycles, Cycle.fit(self.frequency, largest))

    @property
    def has_muscles(self) -> bool:
        """Whether some drive changes rest lengths; pressure and friction do not."""
        return any(drive.quantity in ("scale", "temperature") for drive in self.drives)

    @property
    def measures(self) -> tuple[Measure, ...]:  # type: ignore[override]
        """Measures of the robot; with a target, or a light that it feels, also the distance that remains."""
        return *measures_of(self.target is not None or self.feels_light, self.has_muscles), *self.own_measures

    def measures_in(self, worlds: Sequence[World]) -> tuple[Measure, ...]:
        """Return the measures in all of some worlds; with props in all, also measures of the first prop."""
        terrains = [terrain_of(world) for world in worlds]
        targeted = self.target is not None or all(map(self.light_in, terrains))
        return *measures_among(terrains, targeted, self.has_muscles), *self.own_measures

    def light_in(self, terrain: Terrain) -> tuple[float, float] | None:
        """Return the light's place (x, y) from where the body's centre starts [m]: the terrain's or the reflexes'."""
        if terrain.light is not None:
            return turned(terrain.light, self.heading)
        return self.reflexes.light if self.reflexes is not None else None

    @property
    def feels_light(self) -> bool:
        """Whether the robot's reflexes feel light."""
        return self.reflexes is not None and "light" in self.reflexes.senses

    @property
    def direction(self) -> Floats:
        """Unit vector of the direction of travel, shape (3,)."""
        return ahead(self.heading)

    @property
    def length(self) -> float:
        """Length by which speeds are divided [m]: ``reference_length``, or the body's along its heading."""
        if self.reference_length is not None:
            return self.reference_length
        return float(np.ptp(self.body.start_positions @ self.direction)) + self.body.voxel_size

    @property
    def footprint(self) -> tuple[float, float]:
        """Positions of the rear and front of the voxels along the heading [m]."""
        return footprint_of(self.body, self.direction)

    @property
    def aim(self) -> Aim:
        """Settings of the measures: heading, length, target, and the robot among props."""
        return Aim(self.heading, self.length, self.target, self.placed, own_measures=self.own_measures)

    def starts(self, count: int, seeds: Ints | None = None) -> Floats | None:
        """Return noisy voxel centres of ``count`` robots at the start [m], shape (count, V, 3); None without noise.

        The noise of each is that of its seed, by default of the robot's own one: none depends on the others.
        """
        found = None
        if self.perturbation:
            each = [self.seed] * count if seeds is None else seeds.tolist()
            found = self.body.scattered(self.perturbation, each, np.arange(count))
        if self.placed is not None:
            found = (np.tile(self.body.start_positions, (count, 1, 1)) if found is None else found) + self.placed.shift
        return found

    @property
    def actuators(self) -> int:  # type: ignore[override]
        """Number of driven regions, counted for each drive that moves them."""
        return sum(len(drive.regions) for drive in self.drives if drive.quantity != "friction")

    @property
    def uncertain_in(self) -> tuple[str, ...]:  # type: ignore[override]
        """Quantities that can be uncertain: slope, friction unless it is driven, and levels and timing of drives."""
        driven = any(drive.quantity == "friction" for drive in self.drives)
        return ("slope", "levels", "timing") if driven else ("friction", "slope", "levels", "timing")

    def perturbed(self, drawn: Perturbation) -> "LatticeRobot":
        """Return this robot with its friction, drive amplitudes and period multiplied by drawn factors."""
        return perturbed_robot(self, drawn)

    def on(self, terrain: Terrain) -> "LatticeRobot":
        """Return this robot with a terrain's friction, light, water and props, if any; a light is the usual target.

        Raises:
            ValueError: if the terrain gives a friction for parts of the inflatable robot, has no light to feel, or
                props that start where they cannot.
        """
        changed: dict[str, Any] = {}
        if friction := material_friction(terrain):
            given: Any = friction
            materials = (dataclasses.replace(material, **given) for material in self.body.materials)
            changed["body"] = self.body.with_materials(materials)
        if terrain.is_wet != self.is_afloat:
            changed["is_afloat"] = terrain.is_wet
        light = self.light_in(terrain)
        if self.reflexes is not None and self.feels_light:
            if light is None:
                raise ValueError(f"light: {terrain.name} has none to feel; give one, as {terrain.name}+light:0.5,0.1")
            changed["reflexes"] = dataclasses.replace(self.reflexes, light=light)
        if light is not None and self.target is None:
            changed["target"] = light
        if terrain.props and self.placed is None:
            relief = None if terrain.uneven is None else terrain.uneven.relief(self.heading, self.body.voxel_size)
            among = placed(changed.get("body", self.body), terrain.props, self.direction, friction, relief)
            changed |= {"body": among.body, "placed": among, "reference_length": self.length}
        return dataclasses.replace(self, **changed) if changed else self

    def nodes(self, points: Any, later: ArrayLike = 0.0) -> list[Any]:
        """Compute the values of each drive's channels at points, shape (N, P), see ``Drive.nodes``."""
        each = zip(self.drives, self._space.shares(points), strict=True)
        return [drive.nodes(share, self.rest_of(drive), later) for drive, share in each]

    def caution(self, point: ArrayLike) -> str:
        """Warn if finite differences mislead at a point, shape (P,), as nothing moves while it settles; else empty."""
        return caution_of(self, point)

    def doubts(self) -> tuple[str, ...]:
        """Settings that are allowed but likely mistakes, such as phases in degrees, a line each."""
        return doubts_of(self)

    def doubts_in(self, world: World) -> tuple[str, ...]:
        """What is likely a mistake in a world: materials without friction on dry ground."""
        return doubts_on(self, terrain_of(world))

    def fault(self, point: ArrayLike) -> str:
        """Explain why a point, shape (P,), is not a valid robot; empty if it is one."""
        return fault_of(self, point)

    def rest_of(self, drive: Drive) -> Floats:
        """Return the values of a drive's channels before anything drives them, shape (Q, G)."""
        return np.array([[self.rest(region, quantity) for region in drive.regions] for quantity in drive.quantities])

    @cached_property
    def _material_of(self) -> dict[int, Material]:
        """Material of the first voxel of each region."""
        regions, first = np.unique(np.asarray(self.body.regions), return_index=True)
        found = [self.body.materials[m] for m in self.body.material_index[first]]
        return dict(zip(regions.tolist(), found, strict=True))

    def rest(self, region: int, quantity: int) -> float:
        """Return a channel's value before anything drives it: that of the material of the region's first voxel."""
        return float(channel_values(self._material_of[region])[quantity])

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Simulate the robot at N points, with the gradients of measures if wanted."""
        return outcome_of(try_points(self, points, trial))

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: "Sequence[LatticeRobot]" = ()
    ) -> list[Outcome]:
        """Simulate the robot at N points in several worlds, in one batch where little enough differs."""
        return try_variants(variants or [self] * len(worlds), points, worlds, trial)

    @property
    def feels(self) -> bool:  # type: ignore[override]
        """Whether the robot has reflexes."""
        return self.reflexes is not None

    def felt_over_time(self, points: Floats, world: World, compute: Compute) -> Floats:
        """Return what the robot's S sensors read at N points, shape (N, P), sixteen times a cycle, shape (N, S, T)."""
        return felt_over_time(self, points, terrain_of(world), compute)

    def spoken(self, outcome: Outcome) -> str:
        """Summarise all measures of an outcome, including those for a light and props of the terrain."""
        known = (*measures_of(targeted=True), *OF_PROPS, *self.own_measures)
        return ", ".join(m.value(float(outcome.measures[m.name][0])) for m in known if m.name in outcome.measures)

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """Build the motion of the robot from an outcome with recorded frames."""
        from robots.lattice_robot.motion import lattice_robot_motion

        return lattice_robot_motion(outcome.result, self, terrain_of(world), name=name)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the robot of one point, for ``load_robot``; without own measures, as a robot needs no package."""
        write_record(path, ROBOT_FORMAT, description_of(dataclasses.replace(self.design(point), own_measures=())))

    @property
    def fixed(self) -> "LatticeRobot":
        """Return the robot itself, or with its starting values if something is free."""
        return self.filled(self.start) if self.free else self

    def describe(self) -> dict[str, Any]:
        """Describe the robot as JSON values; ``robot_of_record`` rebuilds it exactly, to the bit."""
        return description_of(self)

    def facts(self) -> Facts:
        """Rows for a report: body, drives and cycle."""
        voxels = f"{self.body.voxel_count} voxels of {1000 * self.body.voxel_size:g} mm"
        return [
            ("Robot", f"{self.name}: {voxels}"),
            *facts_of_links(self.body.links),
            ("Driven", ", ".join(f"{drive.name} ({drive.quantity})" for drive in self.drives)),
            *([("Reflexes", self.reflexes.spoken)] if self.reflexes else []),
            ("Cycle", f"{self.frequency:g} Hz; the speed is that of {counted(self.cycles, 'cycle')}"),
        ]

    def at_horizon(self, length: int) -> tuple[str, "LatticeRobot"]:
        """Return a label and the robot with ``length`` cycles."""
        return counted(length, "cycle"), dataclasses.replace(self, cycles=length)
