"""A foot that is dragged over the ground: force over displacement."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robots.calibration.laboratory import Laboratory, Trial
from robots.calibration.properties import Properties
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity

LENGTH, WIDTH = 6, 3  # of the strip of skin, in voxels
_SETTLING, _DRAGGING = 500, 10_000  # steps
_DAMPING = 1e-4  # ratio against the world: less than a thousandth of usual forces


@dataclass(frozen=True, eq=False)
class Drag:
    """A strip of skin under a load, held at one end and dragged along by it, slowly.

    The force rises while the strip stretches and sticks, and is the friction once all of it slides.

    Source: Powers 2021 dissertation, ch. 5, "Methods": feet dragged over materials by a testing machine.

    Attributes:
        at: displacements of the held end [m], not below 0.
        values: forces on it [N].
        load: on the foot, its own weight included [N].
        grips: whether the foot is told to grip or to slide.
        deviations: standard deviations of the forces [N], or None.
    """

    at: Floats
    values: Floats
    load: float
    grips: bool = True
    deviations: Floats | None = None

    axis, quantity = "displacement [m]", "force [N]"

    @property
    def title(self) -> str:
        """For tables and plots."""
        return f"drag, foot {'grips' if self.grips else 'slides'}, {self.load:g} N"

    @property
    def informs(self) -> tuple[str, ...]:
        """Friction by the plateau, the modulus by the rise."""
        return ("friction" if self.grips else "low_friction", "modulus")

    def predict(self, trials: Sequence[Trial], laboratory: Laboratory) -> Floats:
        """Forces in the links to the held end [N], shape (T, N)."""
        bodies = [self._strip(trial.properties, laboratory) for trial in trials]
        body, edge = bodies[0], laboratory.geometry.voxel_size
        engine = LatticeEngine(
            bodies,
            time_step=laboratory.time_step,
            floor=True,
            self_contact=False,
            precision="f64",
            threads=laboratory.threads,
        )
        builder, rate = ProgramBuilder(len(trials)), float(self.at.max()) / _DRAGGING
        dragged = LENGTH * WIDTH * laboratory.geometry.voxel_mass
        builder.set(Quantity.ACCELERATION + 2, -self.load / dragged, regions=[0])
        builder.set(Quantity.TRANSLATION, 0.0, regions=[0], step=_SETTLING, rate=rate)
        steps = _SETTLING + np.rint(self.at / rate).astype(int)
        order = np.argsort(steps, kind="stable")
        run = engine.run(builder.build(_SETTLING + _DRAGGING, np.tile(steps[order], (len(trials), 1))))
        held = np.isin(body.topology.links, np.flatnonzero(body.voxels[:, 0] == LENGTH)).sum(axis=1) == 1
        strains = run.strains[:, np.argsort(order)][:, :, held].sum(axis=2)
        moduli = np.array([[trial.properties.modulus] for trial in trials])
        return np.where((run.status == "ok")[:, None], moduli * edge**2 * strains, np.nan)

    def _strip(self, properties: Properties, laboratory: Laboratory) -> LatticeBody:
        """The voxels of the held end follow along x only, so that the floor carries them too."""
        friction = properties.friction if self.grips else properties.low_friction
        geometry = laboratory.geometry
        skin = Material(
            properties.modulus,
            geometry.density,
            static_friction=friction,
            kinetic_friction=friction,
            internal_damping=geometry.internal_damping,
            global_damping=_DAMPING,
            collision_damping=geometry.collision_damping,
        )
        voxels = np.array([(x, y, 0) for x in range(LENGTH + 1) for y in range(WIDTH)])
        fixed = np.zeros((len(voxels), 6))
        fixed[voxels[:, 0] == LENGTH, 0] = 1
        return LatticeBody(voxels, (skin,), np.zeros(len(voxels)), geometry.voxel_size, fixed=fixed)
