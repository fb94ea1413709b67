"""Where the lattice's laws, which are the original simulator's, are not those of a textbook, and by how much.

    python benchmarks/model_limits.py

How hard a body on a floor must be pulled sideways before it slides, and how sheets under tension stretch.
"""

import argparse

import numpy as np

from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity

GRAVITY, EDGE, MODULUS = 9.80665, 0.01, 1e6
SLIPPED = 1e-3  # m: what has gone so far in a tenth of a second was pulled loose
STEP = 0.025  # of the ratios of pull to weight that are tried
STRESS = 1e3  # Pa, so little that theory is linear
ACROSS = 9  # voxels of a sheet


def _block(material: Material, size: tuple[int, int, int], regions: object = None) -> LatticeBody:
    voxels = np.argwhere(np.ones(size, bool))
    return LatticeBody(
        voxels=voxels, materials=(material,), material_index=[0] * len(voxels), voxel_size=EDGE, regions=regions
    )


def grip(size: tuple[int, int, int], held: float, sliding: float) -> float:
    """The least pull, parts of the weight, at which a block on a floor slides; coefficients of friction are given."""
    material = Material(MODULUS, 1e3, static_friction=held, kinetic_friction=sliding)
    pulls = np.arange(0.8 * held, 1.8 * held, STEP)
    body = _block(material, size)
    engine = LatticeEngine(
        body, len(pulls), gravity=GRAVITY, floor=True, time_step=body.recommended_time_step / 1.3, threads=1
    )
    settle = ProgramBuilder(len(pulls)).build(int(0.1 / engine.time_step))
    engine.run(settle)
    before = engine.state().positions[:, :, 0].mean(axis=1)
    pulling = ProgramBuilder(len(pulls))
    slowly = int(0.4 / engine.time_step)  # a sudden pull would shake it loose
    for robot, pull in enumerate((pulls * GRAVITY).tolist()):
        pulling.set(Quantity.ACCELERATION, 0.0, rate=pull / slowly, regions=[0], robots=[robot])
        pulling.set(Quantity.ACCELERATION, pull, step=slowly, regions=[0], robots=[robot])
    engine.run(pulling.build(slowly + int(0.1 / engine.time_step)))
    gone = engine.state().positions[:, :, 0].mean(axis=1) - before
    return float(pulls[np.argmax(gone > SLIPPED)])


def stretch(layers: int, poissons_ratio: float, across: float) -> float:
    """Strain along x of a sheet under a stress along x, and ``across`` of it along y, parts of that of theory."""
    size = ACROSS, ACROSS, layers
    voxels = np.argwhere(np.ones(size, bool))
    ends = (voxels[:, :2] == ACROSS - 1).astype(int) - (voxels[:, :2] == 0)
    regions = (ends[:, 0] + 1) * 3 + ends[:, 1] + 1
    material = Material(MODULUS, 1e3, poissons_ratio=poissons_ratio, global_damping=0.01)
    body = _block(material, size, regions)
    engine = LatticeEngine(body, self_contact=False, time_step=body.recommended_time_step / 2, threads=1)
    program = ProgramBuilder(1)
    for region in np.unique(regions).tolist():
        program.set(Quantity.FORCE, STRESS * EDGE**2 * (region // 3 - 1), regions=[region])
        program.set(Quantity.FORCE + 1, across * STRESS * EDGE**2 * (region % 3 - 1), regions=[region])
    engine.run(program.build(30_000))
    x = engine.state().positions[0].reshape(*size, 3)[:, ACROSS // 2, layers // 2, 0]
    middle = ACROSS // 2
    strain = (x[middle + 2] - x[middle - 2]) / (4 * EDGE) - 1
    return float(strain / (STRESS / MODULUS * (1 - poissons_ratio * across)))


def main() -> None:
    """Print both tables."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print("| static / kinetic friction | one voxel slides at | 3 x 3 x 2 voxels slide at |\n| --- | ---: | ---: |")
    for held, sliding in ((0.5, 0.2), (0.5, 0.4), (0.5, 0.5), (0.7, 0.56)):
        ones = [f"{grip(size, held, sliding):.3g}" for size in ((1, 1, 1), (3, 3, 2))]
        print(f"| {held} / {sliding} | {' | '.join(ones)} |", flush=True)
    print("\n| Poisson's ratio | layers | pulled along x | along x and y |\n| ---: | ---: | ---: | ---: |")
    for ratio in (0.0, 0.3, 0.45):
        for layers in (1, 3):
            both = [f"{stretch(layers, ratio, across):.3f}" for across in (0.0, 1.0)]
            print(f"| {ratio} | {layers} | {' | '.join(both)} |", flush=True)


if __name__ == "__main__":
    main()
