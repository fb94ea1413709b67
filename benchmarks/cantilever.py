"""Deflection of a cantilever at finer and finer voxels, against beam theory.

    python benchmarks/cantilever.py [1 2 4 8]

A beam of 100 x 10 x 10 mm, of n x n voxels in its section, is held in an extra layer before its first face, and pulled
down at the centres of its last layer; so held and pulled centres are its length apart. It is let go with the damping
against the world that is critical for its slowest swing, until it rests.
"""

import argparse
import math
import time

import numpy as np

from optim.commands.options import whole
from taichi_sim.lattice import LatticeEngine, Material, ProgramBuilder, Quantity, body_from_array

LENGTH, HEIGHT = 0.1, 0.01  # [m]
TISSUE = Material(youngs_modulus=1e6, density=1e3)
SAG = 1e-3  # of the length: so little that the theory is linear


def relative_deflection(n: int) -> float:
    """Deflection of n x n voxels in the section, parts of F L^3 / (3 E I)."""
    layers = round(LENGTH / HEIGHT) * n + 1
    held, regions = np.zeros((layers, n, n), bool), np.zeros((layers, n, n), int)
    held[0], regions[-1] = True, 1
    body = body_from_array(np.ones((layers, n, n)), TISSUE, HEIGHT / n, regions=regions, fixed=held)
    second_moment = HEIGHT**4 / 12
    force = SAG * LENGTH * 3 * TISSUE.youngs_modulus * second_moment / LENGTH**3
    # Of the first swing, whose frequency is 3.516 sqrt(E I / (rho A L^4)), see damping ratios in ``Material``.
    damping = 3.516 / np.sqrt(12) * HEIGHT * body.voxel_size / LENGTH**2
    builder = ProgramBuilder(1)
    builder.set(Quantity.GLOBAL_DAMPING, damping, regions=[0, 1])
    builder.set(Quantity.FORCE + 2, -force / n**2, regions=[1])
    # The damping of links shakes voxels with six of them at the largest step.
    engine = LatticeEngine(body, time_step=body.recommended_time_step / 1.3, self_contact=False)
    swing = 2 * np.pi / (3.516 * HEIGHT / LENGTH**2 * np.sqrt(TISSUE.youngs_modulus / TISSUE.density / 12))
    run = engine.run(builder.build(int(2.0 * swing / engine.time_step)))
    if run.status[0] != "ok":
        return math.nan
    sagged = body.start_positions[-n * n :, 2] - engine.state().positions[0, -n * n :, 2]
    return float(sagged.mean() / (SAG * LENGTH))


def shear() -> float:
    """What shear adds to it in Timoshenko's theory, nu = 0, k = 5/6: 3 E I / (k G A L^2)."""
    return 3 * 2 * HEIGHT**2 / 12 / (5 / 6 * LENGTH**2)


def main() -> None:
    """Print a row for each n given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", nargs="*", type=whole(1), default=[1, 2, 4], help="voxels across (default: 1 2 4)")
    args = parser.parse_args()
    print(f"Timoshenko {1 + shear():.5f}\n    h [mm]  voxels  deflection / (F L^3 / 3 E I)   seconds")
    for n in args.n:
        begun = time.process_time()
        found, voxels = relative_deflection(n), (10 * n + 1) * n * n
        print(f"{1000 * HEIGHT / n:10.2f}{voxels:8d}{found:31.5f}{time.process_time() - begun:10.1f}", flush=True)


if __name__ == "__main__":
    main()
