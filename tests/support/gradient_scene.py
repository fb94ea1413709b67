"""A small body in trouble: everything that the lattice knows happens within 200 steps."""

from dataclasses import replace

import numpy as np

from taichi_sim.lattice import (
    LatticeBody,
    LatticeEngine,
    LatticeProgram,
    LatticeState,
    Material,
    ProgramBuilder,
    Quantity,
)

STEPS, TIME_STEP = 200, 1e-4
MATERIALS = (
    Material(
        3e5,
        3000,
        static_friction=0.6,
        kinetic_friction=0.4,
        internal_damping=0.9,
        collision_damping=0.8,
        global_damping=0.002,
        scale=(1.01, 1.0, 0.99),
        thermal_expansion=1e-3,
        temperature=5.0,
    ),
    Material(
        2e5,
        2500,
        static_friction=0.5,
        kinetic_friction=0.3,
        internal_damping=0.8,
        collision_damping=0.7,
        global_damping=0.001,
        thermal_expansion=2e-3,
        temperature=-3.0,
    ),
)


def body(poisson: bool = False, pouch: bool = False) -> LatticeBody:
    """A sheet folded over itself: the upper half hangs down onto the lower one, which slides on the floor.

    The voxels at the fold's top are held in part: two degrees of freedom of one, all six of another. Faces of the sheet
    are under pressure, or, with a ``pouch``, the upper half has a second skin and the pressure is between the two.
    """
    lower = [(x, y, 0) for x in range(8) for y in range(2)]
    hinge = [(0, y, 1) for y in range(2)]
    upper = [(x, y, 2) for x in range(8) for y in range(2)]
    top = [(x, y, 3) for x, y, _ in upper] if pouch else []
    voxels = np.array([*lower, *hinge, *upper, *top])
    regions = np.repeat([0, 3, 2, 1], [len(lower), len(hinge), len(upper), len(top)])
    fixed = np.zeros((len(voxels), 6), bool)
    normals = np.zeros((len(voxels), 3), int)
    normals[regions == 2, 2] = -1 if pouch else 1
    normals[regions == 1, 2] = 1
    if not pouch:
        normals[regions == 0, 1] = voxels[regions == 0, 1] * 2 - 1
    upwards = np.arange(len(lower) + len(hinge), len(voxels) - len(top))
    cut = [(i, i + len(upper)) for i in upwards if 0 < voxels[i, 0] < 7] if pouch else np.zeros((0, 2))
    held = [len(lower), len(lower) + 1]  # the hinge
    fixed[held[0], [1, 3, 5]] = True
    fixed[held[1]] = True
    materials = MATERIALS
    if poisson:
        materials = tuple(replace(m, poissons_ratio=nu) for m, nu in zip(MATERIALS, (0.3, 0.2), strict=True))
    return LatticeBody(
        voxels=voxels,
        materials=materials,
        material_index=np.isin(regions, [1, 2]).astype(int),
        voxel_size=0.01,
        regions=regions,
        fixed=fixed,
        pressure_normals=normals,
        cut_links=cut,
    )


def start(shape: LatticeBody) -> LatticeState:
    """Bent so that the tips touch, sliding fast enough for the neighbour list to be built again."""
    rng = np.random.default_rng(3)
    positions = shape.start_positions + rng.normal(0, 2e-4, (shape.voxel_count, 3))
    upper = np.isin(shape.regions, [1, 2])
    positions[upper, 2] -= 0.0013 * shape.voxels[upper, 0]
    positions[shape.regions == 0, 2] -= 1e-4
    velocities = np.array([0.35, 0.1, 0.0]) + rng.normal(0, 0.02, (shape.voxel_count, 3))
    velocities[upper, 2] -= 0.3
    turns = rng.normal(0, 0.02, (shape.voxel_count, 3))
    orientations = np.concatenate([np.ones((len(turns), 1)), turns], axis=1)
    orientations /= np.linalg.norm(orientations, axis=1, keepdims=True)
    return LatticeState(positions, orientations, velocities, rng.normal(0, 0.5, velocities.shape))


def repeated(state: LatticeState, batch: int) -> LatticeState:
    """The same state for every robot of a batch."""
    return LatticeState(*(np.repeat(getattr(state, f)[None], batch, axis=0) for f in state.__dataclass_fields__))


# Channel, regions, step, value, rate per step.
EVENTS = (
    (Quantity.PRESSURE, [2], 0, 300.0, 2.0),
    (Quantity.PRESSURE, [0], 20, -100.0, 1.0),
    (Quantity.PRESSURE, [1], 10, 400.0, 1.0),
    (Quantity.PRESSURE, [2], 90, 500.0, -3.0),
    (Quantity.SCALE, [2], 0, 1.0, 2e-4),
    (Quantity.SCALE + 1, [0], 15, 1.01, -1e-4),
    (Quantity.SCALE + 2, [0, 2], 60, 1.02, 1e-4),
    (Quantity.TEMPERATURE, [2], 30, 4.0, 0.02),
    (Quantity.STATIC_FRICTION, [0], 10, 0.55, 0.0),
    (Quantity.KINETIC_FRICTION, [0], 25, 0.35, 5e-4),
    (Quantity.KINETIC_FRICTION, [0], 120, 0.5, -1e-3),
    (Quantity.GLOBAL_DAMPING, [0, 1, 2], 40, 0.01, 1e-5),
    (Quantity.ACCELERATION, [0, 1, 2, 3], 0, 1.0, 0.0),
    (Quantity.ACCELERATION + 1, [0, 2], 0, -0.5, 1e-3),
    (Quantity.ACCELERATION + 2, [0], 0, -70.0, 0.0),
    (Quantity.ACCELERATION + 2, [1, 2, 3], 0, -9.5, 0.0),
    (Quantity.FORCE, [2], 0, 2e-3, 1e-5),
    (Quantity.FORCE + 2, [0], 50, -5e-3, 0.0),
    (Quantity.MOMENT + 1, [2], 0, 2e-6, 1e-8),
    (Quantity.TRANSLATION, [3], 0, 0.0, 3.5e-5),
    (Quantity.TRANSLATION + 1, [3], 0, 0.0, 1e-5),
    (Quantity.ROTATION, [3], 0, 0.01, 1e-4),
    (Quantity.ROTATION + 2, [3], 80, -0.01, 1e-4),
    (Quantity.RESISTANCE, [0, 1, 2], 0, 300.0, 2.0),
    (Quantity.RESISTANCE + 1, [0, 2], 40, 50.0, -0.1),
)


def program(batch: int = 1) -> LatticeProgram:
    """The program of ``EVENTS`` with poses recorded half-way, near and at the end."""
    builder = ProgramBuilder(batch)
    for quantity, regions, step, value, rate in EVENTS:
        builder.set(quantity, value, regions=regions, step=step, rate=rate)
    return builder.build(STEPS, np.tile([STEPS // 2, STEPS - 7, STEPS], (batch, 1)))


class Cost:
    """A random linear function of everything that a run gives, each part of like weight."""

    def __init__(self, shape: LatticeBody, snapshots: int, sizes: bool = False) -> None:
        """Draw it; with ``sizes``, of recorded rest sizes too."""
        rng = np.random.default_rng(7)
        voxels = shape.voxel_count
        self.positions = rng.normal(size=(snapshots, voxels, 3)) / 1e-3
        self.orientations = rng.normal(size=(snapshots, voxels, 4)) / 1e-2
        self.strains = rng.normal(size=(snapshots, len(shape.topology.links))) / 1e-2
        self.state = LatticeState(
            rng.normal(size=(voxels, 3)) / 1e-3,
            rng.normal(size=(voxels, 4)) / 1e-2,
            rng.normal(size=(voxels, 3)) / 0.1,
            rng.normal(size=(voxels, 3)) / 1.0,
        )
        self.sizes = sizes * rng.normal(size=(snapshots, voxels, 3)) / 1e-3

    def of(self, engine: LatticeEngine, result) -> np.ndarray:
        """Its value for every robot, shape (B,)."""
        assert (result.status == "ok").all()
        state = engine.state()
        pairs = [
            (result.positions, self.positions),
            (result.orientations, self.orientations),
            (result.strains, self.strains),
            (result.sizes, self.sizes),
        ]
        pairs += [(getattr(state, f), getattr(self.state, f)) for f in state.__dataclass_fields__]
        return sum((a * b).reshape(engine.batch, -1).sum(axis=1) for a, b in pairs)

    def pull_back(self, tape):
        """The gradient by everything."""
        batch = len(tape.result.status)
        names = ("positions", "orientations", "strains", "sizes")
        parts = {f: np.repeat(getattr(self, f)[None], batch, axis=0) for f in names}
        return tape.pull_back(**parts, state=repeated(self.state, batch))
