"""The eight reference cases of the lattice: bodies, programs and the states that an independent engine computed."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_sim.lattice import LatticeBody, LatticeProgram, Material, ProgramBuilder, Quantity

DATA = Path(__file__).parents[1] / "data"
GRAVITY = 9.80665


@dataclass(frozen=True)
class Case:
    """A body with its program builder, engine options and reference states (rows: before step k * every)."""

    body: LatticeBody
    fill: object
    options: dict
    time_step: float
    steps: int
    every: int
    positions: np.ndarray
    quaternions: np.ndarray
    velocities: np.ndarray
    spins: np.ndarray

    def program(self, robots: int = 1) -> LatticeProgram:
        builder = ProgramBuilder(robots)
        self.fill(builder)  # type: ignore[operator]
        marks = np.tile(np.arange(0, self.steps + 1, self.every), (robots, 1))
        return builder.build(self.steps, marks)


def fixed(count: int, voxels: list[int]) -> np.ndarray:
    flags = np.zeros((count, 6), bool)
    flags[voxels] = True
    return flags


def ramp_scale(b: ProgramBuilder) -> None:
    """S = 1 + 0.8 min(1, i / 3000) along x, a quarter of it along y."""
    for axis, share in ((0, 1.0), (1, 0.25)):
        b.set(Quantity.SCALE + axis, 1.0, rate=share * 0.8 / 3000, regions=[1])
        b.set(Quantity.SCALE + axis, 1 + share * 0.8, step=3000, regions=[1])


def slip_force(dt: float):
    def fill(b: ProgramBuilder) -> None:
        """fx = m g 1.6 t / 0.6 with t = i / 12000 < 0.6, else 0; also 0.3 fx along y; weight as a force."""
        weight = 3000 * 0.01**3 * GRAVITY
        rate = weight * 1.6 / 0.6 / 12000
        for axis, share in ((0, 1.0), (1, 0.3)):
            b.set(Quantity.FORCE + axis, 0.0, rate=share * rate, regions=[0])
            b.set(Quantity.FORCE + axis, 0.0, step=7200, regions=[0])
        b.set(Quantity.FORCE + 2, -weight, regions=[0])

    return fill


def _force(regions: list[int], force: tuple, moment: tuple = (), until: int | None = None):
    def fill(b: ProgramBuilder) -> None:
        for axis in range(3):
            b.set(Quantity.FORCE + axis, force[axis], regions=regions)
            if moment:
                b.set(Quantity.MOMENT + axis, moment[axis], regions=regions)
            if until is not None:
                b.set(Quantity.FORCE + axis, 0.0, step=until, regions=regions)

    return fill


def load_case(name: str) -> Case:
    """Build a case by its name in lattice_cases.npz."""
    with np.load(DATA / "lattice_cases.npz") as data:
        meta = json.loads(str(data["meta"]))[name]
        voxels, states = data[f"{name}/index"], data[f"{name}/state"]
    n, dt = len(voxels), meta["dt"]
    x, z = voxels[:, 0], voxels[:, 2]
    rubber = Material(4e5, 3000)
    options: dict = {"self_contact": False}
    common = {"voxels": voxels, "voxel_size": 0.01, "materials": (rubber,), "material_index": np.zeros(n)}
    if name.startswith("cantilever"):
        force = (0, 0, -0.0005) if name == "cantilever_small" else (0, 0.01, -0.05)
        body = LatticeBody(
            **common | {"voxel_size": 0.005, "materials": (Material(1e6, 1e3),)},
            regions=np.arange(n) == n - 1,
            fixed=fixed(n, [0]),
        )
        fill = _force([1], force)
    elif name == "two_materials":
        materials = (
            Material(4e5, 3000, internal_damping=0.5, global_damping=0.002),
            Material(1e5, 1500, internal_damping=1.0, global_damping=0.01),
        )
        body = LatticeBody(
            **common | {"materials": materials, "material_index": (x >= 2) * 1, "links": "published"},
            regions=np.arange(n) >= 12,
            fixed=fixed(n, [0, 1, 2, 3]),
        )
        fill = _force([1], (0.05, 0.02, -0.03), (1e-4, -5e-5, 2e-4))
    elif name == "actuated_bimorph":
        materials = (Material(4e5, 3000, global_damping=0.002), Material(4e5 / 1.8, 3000, global_damping=0.002))
        body = LatticeBody(**common | {"materials": materials, "material_index": z})
        fill = ramp_scale
    elif name == "floor_slip":
        body = LatticeBody(**common | {"materials": (Material(4e5, 3000, static_friction=0.8, kinetic_friction=0.4),)})
        options["floor"] = True
        fill = slip_force(dt)
    elif name == "tilted_drop":
        drop = Material(4e5, 3000, static_friction=0.3, kinetic_friction=0.2, collision_damping=0.8)
        body = LatticeBody(**common | {"materials": (drop,)})
        options["floor"] = True
        tilt = np.deg2rad(25)
        weight = 3000 * 0.01**3 * GRAVITY
        fill = _force([0], (-weight * np.sin(tilt), 0, -weight * np.cos(tilt)))
    elif name == "bars_collide":
        body = LatticeBody(**common, regions=np.arange(n) >= 4)
        options["self_contact"] = True

        def fill(b: ProgramBuilder) -> None:
            _force([0], (0, 0, 0.05), until=800)(b)
            _force([1], (0, 0, -0.05), until=800)(b)
    elif name == "poisson_traction":
        stretchy = Material(1e6, 1000, poissons_ratio=0.3)
        body = LatticeBody(**common | {"materials": (stretchy,)}, regions=x == 4, fixed=fixed(n, list(range(9))))
        fill = _force([1], (2, 0, 0))
    else:
        raise ValueError(name)
    return Case(body, fill, options, dt, meta["steps"], meta["every"], *np.split(states, [3, 7, 10], axis=2))


NAMES = (
    "cantilever_small",
    "cantilever_large",
    "two_materials",
    "actuated_bimorph",
    "floor_slip",
    "tilted_drop",
    "bars_collide",
    "poisson_traction",
)
