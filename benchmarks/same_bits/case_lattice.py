"""Cases of the beam lattice: the reference bodies of the tests, and a small body in which everything happens."""

from dataclasses import replace

import numpy as np
import places
from cases import Arrays, arrays_of, case, plain

STEPS = 1000
WHOLE = ("floor_slip", "tilted_drop", "bars_collide")  # what touches, touches later
NAMES = ("cantilever_small", "cantilever_large", "two_materials", "actuated_bimorph", "floor_slip", "tilted_drop",
         "bars_collide", "poisson_traction")  # fmt: skip
RESULT = ("status", "steps", "positions", "orientations", "strains")
STATE = ("positions", "orientations", "velocities", "angular_velocities")


def reference_case(name: str, precision: str = "f64", whole: bool = False) -> Arrays:
    """The first steps of a reference case, or all of them, and the state after them."""
    from taichi_sim.lattice import LatticeEngine

    given = places.scene("lattice_reference").load_case(name)
    body = places.as_published(given.body)
    engine = LatticeEngine(body, time_step=given.time_step, precision=precision, threads=1, **given.options)
    builder = places.ProgramBuilder(1)
    given.fill(builder)
    steps = given.steps if whole else STEPS
    result = engine.run(builder.build(steps, np.arange(0, steps + 1, steps // 10)[None]))
    return arrays_of(result, *RESULT) | arrays_of(engine.state(), *STATE, prefix="end.")


for name in NAMES:
    quick = name in ("floor_slip", "bars_collide", "poisson_traction")
    case(f"lattice/{name}", name, quick=quick)(reference_case)
for name in WHOLE:
    case(f"lattice/{name}-whole", name, "f64", True)(reference_case)
case("lattice/floor_slip-f32", "floor_slip", "f32")(reference_case)


def in_trouble(poisson: bool, pouch: bool, robots: int, **options: object) -> Arrays:
    """A folded sheet that slides, is pressed, heated and held; see tests/gradient_scene.py of version 1.0."""
    scene = places.scene("gradient_scene")
    body = places.as_published(scene.body(poisson=poisson, pouch=pouch))
    given = {"threads": 1, "floor": not options.get("fluid"), "gravity": 9.81, **options}
    engine = places.lattice_engine(body, batch=robots, time_step=scene.TIME_STEP, **given)
    places.set_state(engine, scene.repeated(scene.start(body), robots))
    result = engine.run(scene.program(robots))
    found = arrays_of(result, *RESULT) | arrays_of(engine.state(), *STATE, prefix="end.")
    return found | {"time_step": plain(body.recommended_time_step)}


@case("lattice/trouble", quick=True)
def alone() -> Arrays:
    """One robot by itself."""
    return in_trouble(False, False, 1)


@case("lattice/trouble-poisson")
def with_poisson() -> Arrays:
    """Materials that grow thinner when pulled."""
    return in_trouble(True, False, 1)


@case("lattice/trouble-pouch-in-fluid")
def pouch_in_fluid() -> Arrays:
    """A closed surface under pressure, in a fluid."""
    return in_trouble(False, True, 1, fluid=True)


@case("lattice/trouble-lanes", quick=True)
def in_lanes() -> Arrays:
    """Eight robots in the lanes of a vector."""
    return in_trouble(False, False, 9, width=8)


@case("lattice/trouble-two-threads")
def two_threads() -> Arrays:
    """Blocks of robots on two threads."""
    return in_trouble(False, False, 9, width=8, threads=2)


@case("lattice/diverging", quick=True)
def diverging() -> Arrays:
    """Robots of other materials and lengths side by side, one of which flies apart."""
    from taichi_sim.lattice import LatticeEngine

    scene = places.scene("gradient_scene")
    body = places.as_published(scene.body())
    soft = replace(body, materials=tuple(replace(m, youngs_modulus=0.7 * m.youngs_modulus) for m in body.materials))
    engine = LatticeEngine([body, soft, body], time_step=scene.TIME_STEP, floor=True, threads=1)
    builder = places.ProgramBuilder(3)
    builder.set(places.Quantity.FORCE, 1e6, regions=[2], step=20, robots=[2])
    result = engine.run(builder.build([150, 220, 200], [[50, 150], [50, 220], [10, 200]]))
    return arrays_of(result, *RESULT) | arrays_of(engine.state(), *STATE, prefix="end.")


@case("lattice/trouble-stepped")
def stepped() -> Arrays:
    """A kernel for every stage of a step."""
    return in_trouble(False, False, 2, driver="stepped")
