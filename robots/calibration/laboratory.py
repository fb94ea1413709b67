"""Laboratory in which experiments are simulated: the robot, the common time step, and noise on start positions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from robots.calibration.properties import BOUNDS, Properties
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.simulation import touching_as_published
from robots.world import Terrain, medium_of
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, LatticeEngine


@dataclass(frozen=True)
class Replica:
    """One simulation of an experiment.

    Attributes:
        properties: properties of the robot.
        replica: number of the draw of start noise; those of the same number start alike.
    """

    properties: Properties
    replica: int = 0


Trial = Replica  # its former name


@dataclass(frozen=True)
class Laboratory:
    """Settings by which experiments are simulated.

    Attributes:
        geometry: geometry of the robot before its properties are fitted.
        actuation: actuation before the fit; durations that it counts in steps stay the same in seconds.
        stiffest: largest modulus that will be tried [Pa]. It determines the time step of all simulations, so that
            results change smoothly with the modulus; see :meth:`as_played`.
        perturbation: standard deviation of the noise on start positions [m].
        seed: seed of the noise.
        precision: "f32" or "f64".
        threads: CPU threads; all cores by default.
    """

    geometry: InflatableGeometry = PUBLISHED
    actuation: InflatableActuation = ACTUATION
    stiffest: float = BOUNDS["modulus"][1]
    perturbation: float = 1e-6
    seed: int = 0
    precision: str = "f32"
    threads: int | None = None

    @cached_property
    def time_step(self) -> float:
        """Time step dt [s]: that of the geometry if it is stable for the stiffest robot, otherwise a shorter one."""
        if self.stiffest <= self.geometry.most_modulus:
            return self.geometry.time_step
        return self.geometry.time_step * self.geometry.relative_time_step(self.stiffest)

    def as_played(self, properties: Properties) -> "Laboratory":
        """The laboratory with the time step of robots of these properties elsewhere, see ``Properties.robot``.

        Way and height of a robot depend on the step, as time steps are long: what is fitted at another does not hold.
        """
        most = self.geometry.most_modulus
        return replace(self, stiffest=most if properties.modulus <= most else properties.modulus)

    def drive(self, properties: Properties) -> InflatableActuation:
        """Actuation of a robot with the given properties."""
        return properties.drive_of(self.actuation, self.geometry.time_step, self.time_step)

    def played(self, design: InflatableDesign) -> InflatableDesign:
        """The design whose times, which gaits count in steps of the geometry, last as long in those of simulations."""
        return replace(design, schedule=design.schedule.in_steps_of(self.time_step / self.geometry.time_step))

    def engine(self, trials: Sequence[Replica], terrain: Terrain) -> tuple[LatticeBody, LatticeEngine]:
        """Engine for the robots of some trials, with noise on their starts, and the body of the first.

        The bodies differ only in their materials.

        Raises:
            ValueError: for uneven ground.
        """
        if terrain.ground:
            raise ValueError(f"terrain: uneven ground ({terrain.ground}) is not allowed for calibrations; give a plane")
        bodies = [trial.properties.body_of(self.geometry).body for trial in trials]
        substeps = self.geometry.substeps(terrain.is_wet, self.actuation.largest_size)
        medium = medium_of([terrain], [0.0], self.geometry.voxel_size)
        compute = Compute.given({"precision": self.precision, "threads": self.threads})
        engine = touching_as_published(bodies, len(bodies), self.time_step, substeps, medium, compute)
        replicas = [trial.replica for trial in trials]
        engine.set_positions(bodies[0].scattered(self.perturbation, self.seed, replicas))
        return bodies[0], engine
