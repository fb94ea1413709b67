"""Cases of gradients: through contact, gaits, robots of arrays, rigid robots, and vehicles."""

from dataclasses import replace

import numpy as np
import places
from case_gaits import RESULT as GAIT
from case_gaits import brisk, drawn, graded
from case_machines import QUADRUPED, vehicles
from cases import Arrays, arrays_of, case

LATTICE = ("values", "rates", "positions", "orientations", "velocities", "angular_velocities")
RIGID = ("weights", "commands", "lights", "masses", "parameters", "points", "position", "orientation", "angles",
         "places", "carried")  # fmt: skip
# Parameters of a rigid body by which version 1.0 has derivatives: all up to the axis of its hinge, and its motor.
PARAMETERS = [*range(13), *range(16, 20)]
VEHICLE = ("closest", "final", "closest_by_sites", "closest_by_controllers", "final_by_sites", "final_by_controllers")


def evaluation(found, prefix: str = "") -> Arrays:
    """All that a problem says of points."""
    details = {f"{prefix}details.{name}": np.asarray(values) for name, values in found.details.items()}
    return arrays_of(found, "objectives", "status", "gradients", prefix=prefix) | details


def lattice(batch: int, poisson: bool = False, pouch: bool = False, memory: float = 1e9, **options) -> Arrays:
    """The small body in trouble, backwards: derivatives by everything of a random cost."""
    scene = places.scene("gradient_scene")
    body = places.as_published(scene.body(poisson=poisson, pouch=pouch))
    floor = not options.get("fluid")
    engine = places.lattice_engine(body, batch, time_step=scene.TIME_STEP, floor=floor, threads=1, **options)
    places.set_state(engine, scene.repeated(scene.start(body), batch))
    tape = engine.record(scene.program(batch), memory=memory)
    gradient = scene.Cost(body, 3).pull_back(tape)
    materials = {f"materials.{name}": values for name, values in sorted(gradient.materials.items())}
    return arrays_of(gradient, *LATTICE) | materials | arrays_of(tape.result, "positions", "strains", prefix="run.")


@case("gradients/lattice", quick=True)
def of_one() -> Arrays:
    """Of one robot by itself."""
    return lattice(1)


@case("gradients/lattice-poisson")
def of_poisson() -> Arrays:
    """Of materials that grow thinner when pulled."""
    return lattice(1, poisson=True)


@case("gradients/lattice-pouch-in-fluid")
def of_pouch() -> Arrays:
    """Of a closed surface under pressure, in a fluid."""
    return lattice(1, pouch=True, fluid=True)


@case("gradients/lattice-lanes")
def of_lanes() -> Arrays:
    """Of robots in lanes, with little memory."""
    return lattice(2, width=8, memory=3e6)


@case("gradients/lattice-stepped")
def of_stages() -> Arrays:
    """By a kernel for every stage of a step."""
    return lattice(1, driver="stepped")


@case("gradients/gaits", quick=True)
def of_gaits() -> Arrays:
    """Of graded gaits in a tiny body, core pressures included."""
    tiny = places.InflatableGeometry(bladder_columns=1, rows=12, foot_rows=4, bladder_layers=1, voxel_size=0.02)
    designs = [graded(drawn(seed, core_pressure=[3e3, 5e3], pressure=4e3)) for seed in (4, 5)]
    actuation = brisk(pressure_ramp=50.0, inflation_rate=0.02)
    found = places.differentiate_gaits(designs, geometry=tiny, actuation=actuation, threads=1)
    names = ("pressure", "orientation", "inflation", "grip", "core_pressure")
    return arrays_of(found, *names) | arrays_of(found.result, *GAIT, prefix="result.")


def gait_problem(encoding: str, **settings):
    """A search for a gait in the small body, few columns."""
    from robots.terrain import Terrain

    return places.GaitProblem((Terrain(slope=5.0),), encoding=encoding, geometry="small", repeats=1, precision="f64",
                              threads=1, **settings)  # fmt: skip


def of_gait_problem(encoding: str, **settings) -> Arrays:
    """What the problem says of a relaxed point, with gradients, and of a true one."""
    problem = gait_problem(encoding, **settings)
    rng = np.random.default_rng(8)
    point = problem.space.relaxed().sample(rng, 1)
    found = evaluation(problem.evaluate_relaxed(point, 2.0, gradients=True), "relaxed.")
    return found | evaluation(problem.evaluate(problem.space.round(point)), "true.")


@case("gradients/gait-problem-bits")
def of_bits() -> Arrays:
    """Genes of on and off."""
    return of_gait_problem("bits", columns=1, pressure=0.0)


@case("gradients/gait-problem-graded")
def of_levels() -> Arrays:
    """Graded genes, in a body that is free, too."""
    return of_gait_problem("graded", columns=2, steps=3000, ramp_steps=500)


LATER_MEASURES = ("jump", "turning", "energy", "mass", "payload")  # of lattice robots, which version 1.0 has not


@case("gradients/lattice-robot", quick=True)
@places.pulled_aside_by_rounding()
def of_lattice_robot() -> Arrays:
    """An inchworm of an array, at three points."""
    problem = places.LatticeRobotProblem(inchworm(), precision="f64", threads=1)
    points = problem.space.sample(np.random.default_rng(9), 3)
    found = evaluation(problem.evaluate_relaxed(points, 1.0, gradients=True), "relaxed.")
    found |= evaluation(problem.evaluate(points), "true.")
    return {name: array for name, array in found.items() if name.rpartition(".")[2] not in LATER_MEASURES}


def inchworm():
    """A bar on two feet that lengthens and shortens between feet that grip in turn."""
    from robots.lattice_robot import Drive, Free, LatticeRobot
    from taichi_sim.lattice import Material, body_from_array

    rubber = Material(youngs_modulus=1e5, density=1e3, static_friction=1.0, kinetic_friction=0.8, name="rubber")
    foam = Material(youngs_modulus=5e4, density=5e2, name="foam")
    body = np.full((6, 2, 2), 2)
    body[2:4, :, 0] = 0
    body[:2] = body[4:] = 1
    regions = np.ones(body.shape, int)
    regions[:2], regions[4:] = 0, 2
    drives = (
        Drive("bar", (1,), "scale", mean=Free(0.9, 1.1), amplitude=Free(0.0, 0.25, start=0.2), axes="x"),
        Drive("back", (0,), "friction", mean=0.8, amplitude=Free(0.0, 0.7), phase=Free(0.0, 1.0, start=0.25)),
        Drive("front", (2,), "friction", mean=0.8, amplitude=Free(0.0, 0.7), phase=Free(0.0, 1.0, start=0.75)),
    )
    lattice = places.as_published(body_from_array(body, (rubber, foam), voxel_size=0.01, regions=regions))
    return LatticeRobot(body=lattice, drives=drives, moduli={"foam": Free(3e4, 2e5)}, frequency=8.0, cycles=1)


def of_quadruped(kind: str) -> Arrays:
    """Light readings by weights, and places by everything."""
    from robots import quadruped

    robot, weights = getattr(quadruped, kind.upper()), np.random.default_rng(6).uniform(-1, 1, (2, 5, 8))
    result, slopes = places.differentiate_quadruped(robot, weights, steps=60, precision="f64", threads=1)
    engine = places.quadruped_engine(replace(robot, mass=1.1), precision="f64", threads=1)
    tape = engine.record(40, weights=weights, lights=np.array([[3.0, 1.0, 0.15]]))
    gradient = tape.pull_back(position=np.tile([1.0, -0.5, 0.3], (2, 1)), orientation=np.full((2, 4), 0.2))
    return (
        arrays_of(result, *QUADRUPED)
        | {"slopes": slopes}
        | arrays_of(gradient, *RIGID, prefix="tape.")
        | {"tape.parameters": gradient.parameters[..., PARAMETERS]}
    )  # fmt: skip


for kind in ("legged", "wheeled", "whegged"):
    case(f"gradients/{kind}", kind)(of_quadruped)


@case("gradients/vehicles", quick=True)
def of_vehicles() -> Arrays:
    """Distances by sites and controllers."""
    return arrays_of(places.differentiate_vehicles(*vehicles(), threads=1), *VEHICLE)


@case("gradients/vehicle-problem")
def of_vehicle_problem() -> Arrays:
    """The total distance by all that is free."""
    task = places.VehicleTask(np.array([[2.8, 2.8, 0.0], [-2.8, 2.0, 1.0]]), radius=0.1, steps=1000)
    problem = places.VehicleProblem(controller="full", task=task, threads=1)
    points = problem.space.sample(np.random.default_rng(10), 12)
    found = evaluation(problem.evaluate_relaxed(points, 1.0, gradients=True), "relaxed.")
    found |= evaluation(problem.evaluate(points), "true.")
    return {name: array for name, array in found.items() if name.rpartition(".")[2] not in LATER_MEASURES}
