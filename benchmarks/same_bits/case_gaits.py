"""Cases of the inflatable robot: gaits by hand and from files, bodies with several cores, hills, water."""

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import places
from cases import Arrays, arrays_of, case

RESULT = ("distance", "displacement", "speed", "speed_simulated", "status", "stages", "steps", "frames.positions",
          "frames.orientations", "frames.times", "frames.extents", "frames.sizes")  # fmt: skip
GAITS = ("both-genetic", "flat-genetic", "hill-cma-gradient", "hill-cma", "hill-genetic", "hill-program")
BRISK = {"inflation_rate": 3e-3, "pressure_ramp": 5.0, "hold_steps": 200, "settle_steps": 300}
HASTY = {"inflation_rate": 3e-3, "pressure_ramp": 20.0, "hold_steps": 100, "settle_steps": 100}


def brisk(**changes: float) -> Any:
    """Actuation that makes gaits ten times as short."""
    return places.InflatableActuation(**BRISK | changes)


def inching(columns: int = 8, repeats: int = 1, pressure: Any = 0.0) -> Any:
    """The gait of on and off that inches."""
    from robots.inflatable import InflatableDesign
    from robots.schedule import GaitSchedule

    bits = np.zeros((10, 8), bool)
    bits[:4, ::2] = bits[9, ::2] = bits[8, 1::2] = True
    return InflatableDesign(pressure, 90.0, GaitSchedule(bits[:, :columns], repeats))


def rolling(columns: int = 8, repeats: int = 1, pressure: Any = 12e3, orientation: float = 0.0) -> Any:
    """The gait of on and off that rolls."""
    from robots.inflatable import InflatableDesign
    from robots.schedule import GaitSchedule

    bits = np.vstack([np.eye(8, dtype=bool)[::-1], np.zeros((2, 8), bool)])
    return InflatableDesign(pressure, orientation, GaitSchedule(bits[:, :columns], repeats))


def graded(record: dict[str, Any]) -> Any:
    """The design of a graded gait's record, by way of a file, as outside code would read it."""
    from robots.gaits import load_gait

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gait.json"
        path.write_text(json.dumps({"format": "morpholab-graded-design-1", **record}))
        return load_gait(path)


def drawn(seed: int, columns: int = 2, **more: Any) -> dict[str, Any]:
    """The record of a graded gait with levels at random."""
    rng = np.random.default_rng(seed)
    inflation, grip = rng.random((8, columns)).tolist(), rng.random((2, columns)).tolist()
    return {"pressure": 4e3, "orientation": 60.0, "inflation": inflation, "grip": grip, "repeats": 1, **more}


@case("gaits/by-hand-small", quick=True)
def by_hand() -> Arrays:
    """Inching and rolling side by side, whole gaits, with frames."""
    from robots.inflatable import simulate

    found = simulate([inching(), rolling()], geometry=places.NAMED_GEOMETRIES["small"], actuation=brisk(), threads=1,
                     record_every=2000)  # fmt: skip
    return arrays_of(found, *RESULT)


@case("gaits/by-hand-as-shipped")
def as_shipped() -> Arrays:
    """The published gaits by the names and in the rates under which they ship; the first column of each."""
    from robots.inflatable import INCHING, ROLLING, InflatableDesign, simulate
    from robots.schedule import GaitSchedule

    designs = [InflatableDesign(d.pressure, d.orientation, GaitSchedule(np.asarray(d.schedule.bits)[:, :1], 1))
               for d in (INCHING, ROLLING)]  # fmt: skip
    found = simulate(designs, geometry=places.NAMED_GEOMETRIES["small"], threads=1,
                     actuation=places.InflatableActuation(pressure_ramp=5.0))  # fmt: skip
    return arrays_of(found, *RESULT)


@case("gaits/by-hand-on-a-hill")
def on_a_hill() -> Arrays:
    """A slope, other friction, noise on the start, and an oblique heading."""
    from robots.inflatable import simulate
    from robots.terrain import Terrain

    terrain = Terrain(slope=15.0, high_friction=1.5, low_friction=0.01)
    designs = [inching(3), rolling(3, pressure=8e3, orientation=35.0)]
    found = simulate(designs, terrain, geometry=places.NAMED_GEOMETRIES["small"], actuation=brisk(weight="physical"),
                     threads=1, perturbation=1e-4, seed=3, record_every=1000)  # fmt: skip
    return arrays_of(found, *RESULT)


@case("gaits/in-water")
def in_water() -> Arrays:
    """No ground, but a fluid."""
    from robots.inflatable import simulate
    from robots.terrain import Terrain

    found = simulate(inching(2, pressure=3e3), Terrain(fluid_density=1000.0), actuation=brisk(), threads=1,
                     geometry=places.NAMED_GEOMETRIES["small"])  # fmt: skip
    return arrays_of(found, *RESULT)


@case("gaits/by-hand-published")
def published() -> Arrays:
    """The published geometry for a few columns."""
    from robots.inflatable import simulate

    found = simulate([inching(4), rolling(4)], actuation=brisk(), threads=1, record_every=1000)
    return arrays_of(found, *RESULT)


@case("gaits/two-core")
def two_core() -> Arrays:
    """Several cores, at one pressure and at two, of the published and of a smaller body."""
    from robots.inflatable import simulate

    small = replace(places.NAMED_GEOMETRIES["small"], cores=2)
    designs = [inching(2, pressure=3e3), rolling(2, pressure=(2e3, 9e3))]
    found = arrays_of(simulate(designs, geometry=small, actuation=brisk(), threads=1), *RESULT, prefix="small.")
    large = simulate(designs[1], geometry=places.NAMED_GEOMETRIES["two-core"], threads=1,
                     actuation=places.InflatableActuation(**HASTY | {"pressure_ramp": 50.0}))  # fmt: skip
    return found | arrays_of(large, *RESULT, prefix="two-core.")


@case("gaits/graded")
def graded_gaits() -> Arrays:
    """Levels between, core pressures of columns, and times of their own; a gait of on and off beside a graded one."""
    from robots.gaits import simulate

    small = {"geometry": places.NAMED_GEOMETRIES["small"], "actuation": brisk(), "threads": 1}
    timed = {"motion_steps": [300, 500], "settle_steps": [200, 0]}
    found = arrays_of(simulate([graded(drawn(1)), rolling(2)], **small), *RESULT, prefix="levels.")
    with_core = [graded(drawn(seed, core_pressure=[2e3, 7e3], **timed)) for seed in (2, 3)]
    return found | arrays_of(simulate(with_core, **small, record_every=300), *RESULT, prefix="timed.")


def of_file(name: str) -> Arrays:
    """A published gait file: its first four columns in the small body, ramps made short."""
    from robots.gaits import load_gait, simulate

    path = places.inputs / "docs" / "gaits" / f"{name}.json"
    load_gait(path)  # the whole file must be readable, too
    record = json.loads(path.read_text())
    for table, value in record.items():
        if isinstance(value, list) and table != "pressure":
            record[table] = [row[:4] for row in value] if table in ("inflation", "grip") else value[:4]
    record["repeats"] = min(record["repeats"], 2)
    found = simulate(graded(record), geometry=places.NAMED_GEOMETRIES["small"], threads=1, record_every=500,
                     actuation=places.InflatableActuation(**HASTY))  # fmt: skip
    return arrays_of(found, *RESULT)


for name in GAITS:
    case(f"gaits/file-{name}", name, quick=name == "hill-program")(of_file)


@case("gaits/encodings", quick=True)
def encodings() -> Arrays:
    """The designs of points at random, of every encoding, by way of files."""
    from robots.gaits import load_gait
    from robots.terrain import Terrain

    found: Arrays = {}
    for encoding in ("codes", "bits", "pattern", "graded", "graded-pattern", "graded-wave"):
        problem = places.GaitProblem((Terrain(),), encoding=encoding, geometry="small", columns=4, precision="f64")
        points = problem.space.sample(np.random.default_rng(12), 5)
        found[f"{encoding}.points"] = points
        with tempfile.TemporaryDirectory() as folder:
            for number, point in enumerate(points):
                problem.save(point, Path(folder) / "gait.json")
                design = load_gait(Path(folder) / "gait.json")
                names = ("pressure", "orientation", "schedule.levels", "schedule.repeats")
                found |= arrays_of(design, *names, prefix=f"{encoding}.{number}.")
    return found


@case("gaits/f32", quick=True)
def single_precision() -> Arrays:
    """A short run in single precision."""
    from robots.inflatable import simulate

    found = simulate([inching(2), rolling(2)], geometry=places.NAMED_GEOMETRIES["small"], precision="f32", threads=1,
                     actuation=places.InflatableActuation(**HASTY))  # fmt: skip
    return arrays_of(found, *RESULT)
