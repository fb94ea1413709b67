"""Where the lattice's laws, which are the original simulator's, are not those of a textbook, and by how much.

    python benchmarks/model_limits.py

How hard a body on a floor must be pulled sideways before it slides, how sheets under tension stretch, and how stiff
bars are in torsion.
"""

import argparse

import numpy as np

from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity

GRAVITY, EDGE, MODULUS = 9.80665, 0.01, 1e6
SLIPPED = 1e-3  # m: what has gone so far in a tenth of a second was pulled loose
STEP = 0.025  # of the ratios of pull to weight that are tried
STRESS = 1e3  # Pa, so little that theory is linear
ACROSS = 9  # voxels of a sheet
TWIST = 0.02  # torque on a bar, parts of E b^3 times STRESS / E, so little that theory is linear
TORSION = 0.1406  # of the b^4 of a square bar, its torsion constant (Timoshenko & Goodier, Theory of Elasticity)


def _block(material: Material, size: tuple[int, int, int], regions: np.ndarray | None = None) -> LatticeBody:
    voxels = np.argwhere(np.ones(size, bool))
    return LatticeBody(
        voxels=voxels,
        materials=(material,),
        material_index=np.zeros(len(voxels), int),
        voxel_size=EDGE,
        regions=regions,
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


def twist(thick: int, poissons_ratio: float) -> float:
    """Torsional stiffness of a square bar so many voxels thick, held at one end, over G J of theory."""
    length = 4 * thick + 1
    voxels = np.argwhere(np.ones((length, thick, thick), bool))
    ends, held = np.flatnonzero(voxels[:, 0] == length - 1), np.zeros((len(voxels), 6), bool)
    held[voxels[:, 0] == 0] = True
    regions = np.zeros(len(voxels), int)
    regions[ends] = 1 + np.arange(len(ends))  # each has its own force
    material = Material(MODULUS, 1e3, poissons_ratio=poissons_ratio, global_damping=0.02)
    body = LatticeBody(voxels, (material,), np.zeros(len(voxels), int), EDGE, regions=regions, fixed=held)
    engine = LatticeEngine(body, self_contact=False, time_step=body.recommended_time_step / 1.3, threads=1)
    across = (voxels[:, 1:] - (thick - 1) / 2) * EDGE
    torque, program = TWIST * STRESS * (thick * EDGE) ** 3, ProgramBuilder(1)
    if thick == 1:
        program.set(Quantity.MOMENT, torque, regions=[1])
    for end in ends.tolist() if thick > 1 else ():
        y, z = across[end] * torque / (across[ends] ** 2).sum()
        program.set(Quantity.FORCE + 1, -z, regions=[int(regions[end])])
        program.set(Quantity.FORCE + 2, y, regions=[int(regions[end])])
    engine.run(program.build(20_000))
    state = engine.state()
    angles = []
    for place in (thick, 3 * thick):  # far from both ends
        rows = voxels[:, 0] == place
        (y, z), moved = across[rows].T, state.positions[0, rows, 1:] - EDGE * voxels[rows, 1:]
        turned = (y * moved[:, 1] - z * moved[:, 0]).sum() / max((y * y + z * z).sum(), 1e-30)
        angles.append(2 * state.orientations[0, rows, 1].mean() if thick == 1 else turned)
    rate = (angles[1] - angles[0]) / (2 * thick * EDGE)
    shear = MODULUS / (2 * (1 + poissons_ratio))
    return float(torque / rate / (shear * TORSION * (thick * EDGE) ** 4))


def main() -> None:
    """Print all tables."""
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
    print("\n| Poisson's ratio | 1 voxel thick | 4 voxels | 6 voxels |\n| ---: | ---: | ---: | ---: |")
    for ratio in (0.0, 0.3, 0.45):
        print(f"| {ratio} | {' | '.join(f'{twist(thick, ratio):.3f}' for thick in (1, 4, 6))} |", flush=True)


if __name__ == "__main__":
    main()
