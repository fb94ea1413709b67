"""Cases of the beam lattice: the reference bodies of the tests, and a small body in which everything happens."""

import numpy as np
import places
from cases import Arrays, arrays_of, case, plain

STEPS = 1000
NAMES = ("cantilever_small", "cantilever_large", "two_materials", "actuated_bimorph", "floor_slip", "tilted_drop",
         "bars_collide", "poisson_traction")  # fmt: skip
RESULT = ("status", "steps", "positions", "orientations", "strains")
STATE = ("positions", "orientations", "velocities", "angular_velocities")


def reference_case(name: str, precision: str = "f64", robots: int = 1, **options: object) -> Arrays:
    """The first steps of a reference case, and the state after them."""
    from taichi_sim.lattice import LatticeEngine

    given = places.scene("lattice_reference").load_case(name)
    engine = LatticeEngine(given.body, batch=robots, time_step=given.time_step, precision=precision, threads=1,
                           **given.options | options)  # fmt: skip
    builder = places.ProgramBuilder(robots)
    given.fill(builder)
    result = engine.run(builder.build(STEPS, np.tile(np.arange(0, STEPS + 1, 100), (robots, 1))))
    return arrays_of(result, *RESULT) | arrays_of(engine.state(), *STATE, prefix="end.")


for name in NAMES:
    quick = name in ("floor_slip", "bars_collide", "poisson_traction")
    case(f"lattice/{name}", name, quick=quick)(reference_case)
case("lattice/floor_slip-f32", "floor_slip", "f32")(reference_case)


def in_trouble(poisson: bool, pouch: bool, robots: int, **options: object) -> Arrays:
    """A folded sheet that slides, is pressed, heated and held; see tests/gradient_scene.py of version 1.0."""
    from taichi_sim.lattice import LatticeEngine

    scene = places.scene("gradient_scene")
    body = scene.body(poisson=poisson, pouch=pouch)
    engine = LatticeEngine(
        body, batch=robots, time_step=scene.TIME_STEP, floor=not options.get("fluid"), gravity=9.81, threads=1,
        **options
    )  # fmt: skip
    engine.set_state(scene.repeated(scene.start(body), robots))
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


@case("lattice/trouble-stepped")
def stepped() -> Arrays:
    """A kernel for every stage of a step."""
    return in_trouble(False, False, 2, driver="stepped")
