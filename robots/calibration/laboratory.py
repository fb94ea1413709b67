"""Where experiments are simulated: one robot, one time step, and noise on where robots start."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from robots.calibration.properties import BOUNDS, Properties
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.world import Terrain, medium_of
from taichi_sim.lattice import LatticeBody, LatticeEngine


@dataclass(frozen=True)
class Trial:
    """One simulation of an experiment.

    Attributes:
        properties: of the robot.
        replica: number of the noise on its start; trials of one replica start alike.
    """

    properties: Properties
    replica: int = 0


@dataclass(frozen=True)
class Laboratory:
    """How experiments are simulated.

    Attributes:
        geometry: of the robot before its properties are fitted.
        actuation: likewise; what it counts in steps stays as long in seconds.
        stiffest: largest modulus that will be tried [Pa]. It sets the time step of all simulations, so that what they
            say changes smoothly with the modulus.
        perturbation: standard deviation of the noise on start positions [m].
        seed: of that noise.
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
        """dt [s]: as long as is stable for the stiffest robot."""
        return self.geometry.time_step * min(1.0, self.geometry.relative_time_step(self.stiffest))

    def drive(self, properties: Properties) -> InflatableActuation:
        """How a robot of these properties is driven."""
        return properties.drive_of(self.actuation, self.geometry.time_step, self.time_step)

    def engine(self, trials: Sequence[Trial], terrain: Terrain) -> tuple[LatticeBody, LatticeEngine]:
        """A body of the robots of some trials (alike but for the material) and their engine, with noise on starts."""
        if terrain.ground:
            raise ValueError(f"terrain: uneven ground ({terrain.ground}) is not allowed for calibrations; give a plane")
        bodies = [trial.properties.body_of(self.geometry).body for trial in trials]
        engine = LatticeEngine(
            bodies,
            time_step=self.time_step,
            **medium_of([terrain], [0.0], self.geometry.voxel_size),
            precision=self.precision,
            threads=self.threads,
        )
        replicas = [trial.replica for trial in trials]
        engine.set_positions(bodies[0].scattered(self.perturbation, self.seed, replicas))
        return bodies[0], engine
