"""Cases of vehicles, quadrupeds, the rover, and soft walkers."""

import numpy as np
import places
from cases import Arrays, arrays_of, case

QUADRUPED = ("light", "distance", "closest", "position", "status")
ROLLOUTS = ("position", "orientation", "angles", "velocities", "readings", "closest", "status")
LEAVES = ("reached", "closest", "arrival", "final", "diverged")


def sweep(precision: str) -> Arrays:
    """A small grid of controllers in two bodies."""
    from robots.braitenberg import VehicleBody, sweep

    bodies = [VehicleBody(((0.5, 0.25), (0.5, -0.25))), VehicleBody(((0.125, 0.5), (-0.25, -0.375)))]
    return {"overlaps": sweep(bodies, weights=21, dt=0.05, steps=2000, precision=precision, threads=1)}


case("vehicles/sweep", "f64", quick=True)(sweep)
case("vehicles/sweep-f32", "f32")(sweep)


@case("vehicles/rollouts", quick=True)
def rollouts() -> Arrays:
    """Distances, times of arrival and places at the end."""
    batch, task = vehicles()
    found = {}
    for until in ("success", "closest", "end"):
        done = places.rollout(batch, task, until=until, threads=1)
        found |= arrays_of(done, *LEAVES, prefix=f"{until}.")
    return found


def vehicles() -> tuple:
    """Three bodies, each with five controllers, in two environments."""
    rng = np.random.default_rng(11)
    sites, controllers = rng.uniform(-0.5, 0.5, (3, 2, 2)), rng.uniform(-1, 1, (3, 5, 2, 2))
    starts = np.array([[2.8, 2.8, 0.0], [-2.8, 2.0, 1.0]])
    return places.VehicleBatch(sites, controllers), places.VehicleTask(starts, radius=0.1, steps=1500)


def quadrupeds(kind: str) -> Arrays:
    """Six controllers in two environments, with frames."""
    from robots import quadruped

    weights = np.random.default_rng(5).uniform(-1, 1, (6, 5, 8))
    found = quadruped.simulate(
        getattr(quadruped, kind.upper()), weights, steps=400, record_every=40, precision="f64", threads=1
    )
    frames = ("times", "position", "orientation", "angles", "readings", "neurons")
    return (
        arrays_of(found, *QUADRUPED)
        | arrays_of(found.rollouts, *ROLLOUTS, prefix="rollouts.")
        | arrays_of(found.rollouts.frames, *frames, prefix="frames.")
    )


for kind in ("legged", "wheeled", "whegged"):
    case(f"rigid/{kind}", kind, quick=kind == "whegged")(quadrupeds)


@case("rigid/rover")
def rover() -> Arrays:
    """The two-wheel vehicle, two bodies with a controller each."""
    bodies = [places.Rover(((-0.5, 0.5), (0.5, 0.5))), places.Rover(((-0.125, -0.5), (0.375, 0.5)))]
    weights = np.array([[0.8, 0.6], [0.4, -0.7]])
    found = places.simulate_rovers(bodies, weights, steps=600, precision="f64", threads=1)
    names = ("closest", "success", "position", "status")
    return arrays_of(found, *names) | arrays_of(found.rollouts, *ROLLOUTS, prefix="rollouts.")


@case("rigid/arm-and-ball")
def arm_and_ball() -> Arrays:
    """A fixed arm too heavy for its motor, and a ball with momentum carried on, under commands."""
    hinge = places.Hinge("base", "arm", (0, 0, 1), (0, 1, 0), places.Motor.position(-1, 1, 2, 0.5))
    bodies = [places.Body("base", (0, 0, 1), 1.0, [places.Sphere(0.05)]),
              places.Body("arm", (0.2, 0, 1), 0.5, [places.Capsule(0.02, 0.4, (1, 0, 0))])]  # fmt: skip
    arm = places.Tree(bodies, [hinge], fixed=True)
    ball = places.Tree([places.Body("ball", (0, 0, 0.0999), 1.0, [places.Sphere(0.1)])])
    found = {}
    for name, tree in (("arm", arm), ("ball", ball)):
        for integration in ("momentum", "velocity"):
            world = places.World(0.01, slip=0.01, integration=integration)
            done = places.RigidEngine(tree, world, precision="f64", threads=1).run(200)
            found |= arrays_of(done, *ROLLOUTS, prefix=f"{name}.{integration}.")
    return found


WALKER = np.array([[[1, 2], [1, 3]], [[1, 2], [1, 3]], [[2, 0], [3, 0]], [[1, 2], [2, 3]]])


@case("soft/walkers", quick=True)
def walkers() -> Arrays:
    """Two soft walkers of one shape."""
    from robots.terrain import Terrain

    designs = [places.WalkerDesign(WALKER), places.WalkerDesign(np.where(WALKER == 1, 2, WALKER))]
    found = places.simulate_walkers(designs, Terrain(slope=3.0), threads=1, record_every=500)
    names = ("distance", "speed", "status", "steps", "time_step")
    frames = {f"frames.{i}": part.positions for i, part in enumerate(found.frames)}
    return arrays_of(found, *names) | frames


@case("soft/walker-problem")
@places.pulled_aside_by_rounding()
def walker_problem() -> Arrays:
    """Bodies of genes at random, by either encoding; some are no robots."""
    found: Arrays = {}
    for encoding in ("direct", "pattern"):
        problem = places.WalkerProblem((3, 2, 2), encoding, threads=1)
        points = problem.space.sample(np.random.default_rng(13), 4)
        judged = problem.evaluate(points)
        found |= {f"{encoding}.points": points} | arrays_of(judged, "objectives", "status", prefix=f"{encoding}.")
    return found
