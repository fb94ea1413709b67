"""How much jump and work the 65 recorded moments of a cycle miss: ``python benchmarks/recorded_moments.py``.

Random freeform bodies, and a bar whose muscles work as one, are recorded at the moments that measures take, and at 16
times as many. The table has, for each stiffness and frequency, by how much each measure differs at worst [%].
"""

from dataclasses import replace

import numpy as np

from robots.control.cyclic import FRAMES_FROM, LAST_CYCLE
from robots.freeform import FreeformActuation, FreeformRobot, Grid, Palette, Tissue
from robots.lattice_robot import Drive, LatticeRobot
from robots.lattice_robot.measures import Record
from robots.lattice_robot.rollout import Rollout
from robots.lattice_robot.scenes import Scenes
from robots.lattice_robot.simulation import rollout_of, swing_of
from robots.robot import Trial
from robots.world import Terrain
from taichi_sim.base.arrays import Ints
from taichi_sim.lattice import LatticeBody, Material

FINER, BODIES = 16, 8
MODULI = 1e5, 3e5, 1e6  # [Pa]
FREQUENCIES = 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0  # [Hz]
LAST = LAST_CYCLE.stop - LAST_CYCLE.start - 1  # stretches between the moments


def muscle_of(modulus: float) -> Material:
    """A muscle of some Young's modulus [Pa]."""
    return Material(modulus, 1e3, static_friction=1.0, kinetic_friction=0.8, name="muscle")


def random_body(modulus: float, frequency: float, seed: int) -> LatticeRobot:
    """A random body of 8 x 3 x 3 cells, muscles and rubber twice as stiff."""
    muscle = muscle_of(modulus)
    rubber = Material(2 * modulus, 1e3, static_friction=0.3, kinetic_friction=0.2, name="rubber")
    palette = Palette((Tissue(muscle), Tissue(rubber, muscle=False)))
    drive = FreeformActuation(channels=6, frequency=frequency)
    robot = FreeformRobot(Grid((8, 3, 3), voxel_size=0.01), palette=palette, actuation=drive)
    parameters = robot.parameters
    low, high = np.array([each.low for each in parameters]), np.array([each.high for each in parameters])
    point = low + (high - low) * np.random.default_rng(seed).random(len(parameters))
    return robot.design(point)


def bar(modulus: float, frequency: float) -> LatticeRobot:
    """A bar of 6 x 2 x 2 voxels that swells and shrinks as one, by 30 %."""
    body = LatticeBody(np.argwhere(np.ones((6, 2, 2))), (muscle_of(modulus),), np.zeros(24, int), 0.01)
    return LatticeRobot(body, (Drive("muscles", (0,), amplitude=0.3),), frequency=frequency, cycles=2)


def rollout(robot: LatticeRobot) -> Rollout:
    """A robot on flat ground, ready to move."""
    nothing = np.zeros((1, 0))
    return rollout_of(Scenes.of([robot], [Terrain()]), nothing, swing_of(robot, nothing, 0.0), Trial(Terrain()))


def recorded(robot: LatticeRobot) -> tuple[dict[str, float], dict[str, float]]:
    """Jump and energy from the moments that measures take, and from 16 times as many."""
    own = rollout(robot)
    cycle = own.cycle
    whole = cycle.segment * 16
    steps = np.arange(LAST * FINER + 1) * whole // (LAST * FINER)
    ends = own.program.snapshots[:, : LAST_CYCLE.start]
    fine = np.concatenate([ends, cycle.end - whole + steps[None]], axis=1)
    run = own.engine.run(replace(own.program, snapshots=fine))
    lost = run.status != "ok"

    def measured_at(moments: Ints) -> dict[str, float]:
        taken = np.concatenate([[0, 1], LAST_CYCLE.start + moments]).astype(int)
        parts = (np.ascontiguousarray(each[:, taken]) for each in (run.positions, run.strains, run.sizes))
        found = own.measured(Record(*parts), lost)
        return {name: float(found[name][0]) for name in ("jump", "energy")}

    pieces = [measured_at(piece * LAST + np.arange(LAST + 1)) for piece in range(FINER)]
    whole_cycle = {"jump": max(each["jump"] for each in pieces), "energy": sum(each["energy"] for each in pieces)}
    return measured_at(np.arange(LAST + 1) * FINER), whole_cycle


def main() -> None:
    """Print the table."""
    assert LAST_CYCLE.stop == FRAMES_FROM
    print("| modulus [Pa] | frequency [Hz] | jump at worst [%] | energy at worst [%] | energy of the bar [%] |")
    print("| ---: | ---: | ---: | ---: | ---: |")
    for modulus in MODULI:
        for frequency in FREQUENCIES:
            pairs = [recorded(random_body(modulus, frequency, seed)) for seed in range(BODIES)]
            both = recorded(bar(modulus, frequency))
            jumps = [100 * (told["jump"] - fine["jump"]) / max(abs(fine["jump"]), 1e-4) for told, fine in pairs]
            works = [100 * (told["energy"] / fine["energy"] - 1) for told, fine in pairs]
            worst = (max(each, key=abs) for each in (jumps, works))
            of_bar = 100 * (both[0]["energy"] / both[1]["energy"] - 1)
            parts = f"{modulus:g}", f"{frequency:g}", *(f"{each:.1f}" for each in (*worst, of_bar))
            print("|", " | ".join(parts), "|", flush=True)


if __name__ == "__main__":
    main()
