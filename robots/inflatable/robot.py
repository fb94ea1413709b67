"""The inflatable shape-changing robot: designs, and what they do on a terrain.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.frames import Frames, frames_of
from robots.inflatable.actuation import ACTUATION, InflatableActuation, nominal_steps, play
from robots.inflatable.body import NAMED_GEOMETRIES, PUBLISHED, SMALL, TWO_CORE, InflatableGeometry
from robots.inflatable.cores import MAXIMUM_PRESSURE, Pressure, checked_pressure, each_pressure, highest_pressure
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain, one_each
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.files import read_record, write_record
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeResult
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners

__all__ = [
    "ACTUATION",
    "INCHING",
    "MAXIMUM_PRESSURE",
    "NAMED_GEOMETRIES",
    "PUBLISHED",
    "ROLLING",
    "SMALL",
    "TWO_CORE",
    "Frames",
    "InflatableActuation",
    "InflatableDesign",
    "InflatableGeometry",
    "InflatableResult",
    "load_design",
    "predicted_steps",
    "save_design",
    "sideways",
    "simulate",
]

DESIGN_FORMAT = "morpholab-inflatable-design-1"


@dataclass(frozen=True)
class InflatableDesign:
    """Shape, orientation and control of the robot.

    Attributes:
        pressure: of the core [Pa], 0 (flat) to 15,000; 12,000 makes it round. In a body with several cores a number
            is that of all of them, and a tuple has one for each, from the end of foot 1 on.
        orientation: heading [degrees] from the rolling direction (0, along x) to the inching direction (90, along y).
        schedule: when bladders inflate and feet grip.
    """

    pressure: Pressure
    orientation: float
    schedule: GaitSchedule

    def __post_init__(self) -> None:
        object.__setattr__(self, "pressure", checked_pressure(self.pressure))
        object.__setattr__(self, "orientation", number("orientation", self.orientation, 0.0, 90.0, "degrees"))
        if not isinstance(self.schedule, GaitSchedule):
            raise ValueError(f"schedule: {type(self.schedule).__name__} is not allowed; give a GaitSchedule")


INCHING = InflatableDesign(
    pressure=0.0,
    orientation=90.0,
    schedule=GaitSchedule.from_text("/".join(["10101010"] * 4 + ["00000000"] * 4 + ["01010101", "10101010"])),
)
ROLLING = InflatableDesign(
    pressure=12e3,
    orientation=0.0,
    schedule=GaitSchedule(np.vstack([np.eye(8)[::-1], np.zeros((2, 8))])),
)


def save_design(design: InflatableDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: pressure [Pa], one or a list, orientation [degrees], rows of the schedule."""
    record = {
        "pressure": design.pressure,
        "orientation": design.orientation,
        "schedule": design.schedule.to_text().split("/"),
        "repeats": design.schedule.repeats,
    }
    write_record(path, DESIGN_FORMAT, record)


def load_design(path: str | PathLike[str]) -> InflatableDesign:
    """Read a design written by :func:`save_design`.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    return read_record(path, DESIGN_FORMAT, _design_of)


def _design_of(record: dict[str, Any]) -> InflatableDesign:
    schedule = GaitSchedule.from_text("/".join(record["schedule"]), record["repeats"])
    return InflatableDesign(record["pressure"], record["orientation"], schedule)


@dataclass(frozen=True, eq=False)
class InflatableResult:
    """What a batch of designs did.

    Attributes:
        distance: along the direction of travel, positive uphill [m], shape (B,); NaN unless the status is "ok".
        speed: body lengths per second by the published convention: the time is that of a gait in which every column
            moves (19.7968 s for the published robot), whatever the number of steps; shape (B,).
        speed_simulated: body lengths per second of the time simulated, shape (B,).
        status: "ok" or "diverged", shape (B,).
        stages: distances of equally long parts of the gait [m], shape (B, N), N 1 unless more were asked for.
        steps: time steps after the initialisation; those before divergence for a robot that diverged, shape (B,).
        time_step: dt [s].
        frames: recorded poses, or None.
        body: the lattice.
        displacement: in the plane of the ground, along x, where a robot rolls, and y, where it inches, whatever its
            heading [m], shape (B, 2); NaN unless the status is "ok". How far it drifts, too.
    """

    distance: np.ndarray
    speed: np.ndarray
    speed_simulated: np.ndarray
    status: np.ndarray
    stages: np.ndarray
    steps: np.ndarray
    time_step: float
    frames: Frames | None
    body: LatticeBody
    displacement: np.ndarray


def predicted_steps(design: InflatableDesign, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps of an evaluation, initialisation included, whatever the robot's geometry; cheap."""
    return actuation.initial_steps(highest_pressure(design.pressure)) + play(design.schedule, actuation)[1]


def simulate(
    designs: Sequence[InflatableDesign] | InflatableDesign,
    terrain: Terrain | Sequence[Terrain] | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    driver: str = "auto",
    record_every: int | None = None,
    perturbation: float = 0.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> InflatableResult:
    """Evaluate a batch of designs on a terrain.

    Args:
        designs: one design or several; one is a batch of one.
        terrain: one for all designs, flat ground by default; or one for each.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates.
        precision: "f32" or "f64".
        device: "cpu", "cuda", "vulkan" or "metal".
        threads: CPU threads; all cores by default. Results do not depend on it.
        driver: see ``LatticeEngine``.
        record_every: record the poses every so many time steps from the end of the initialisation on.
        perturbation: standard deviation of noise on the start positions [m]; contact makes long runs chaotic, so a
            few perturbed copies show how far a speed can be trusted.
        seed: of that noise; robot i of a batch always draws the same.
        progress: called now and then with the fraction done.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    designs = [designs] if isinstance(designs, InflatableDesign) else list(designs)
    if not designs or not all(isinstance(d, InflatableDesign) for d in designs):
        raise ValueError("designs: give at least one InflatableDesign")
    for name, value, kind, example in (
        ("geometry", geometry, InflatableGeometry, "NAMED_GEOMETRIES['small']"),
        ("actuation", actuation, InflatableActuation, "ACTUATION"),
    ):
        if not isinstance(value, kind):
            raise ValueError(f"{name}: {value!r} is not allowed; give an {kind.__name__}, such as {example}")
    for design in designs:
        each_pressure(design.pressure, geometry)  # better refused before any work
    terrains = one_each(Terrain() if terrain is None else terrain, len(designs))
    perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
    seed = whole_number("seed", seed, 0)
    record_every = None if record_every is None else whole_number("record_every", record_every, 1)
    # Robots of a block wait for its slowest: put those of like length together.
    order = np.argsort([predicted_steps(d, actuation) for d in designs], kind="stable")
    body = geometry.body
    engine = LatticeEngine(
        body,
        len(designs),
        time_step=geometry.time_step,
        **terrains[0].medium,
        device=device,
        precision=precision,
        threads=threads,
        driver=driver,
    )
    if perturbation > 0:
        engine.set_positions(scattered(body, perturbation, seed, order))
    grounds = [terrains[i] for i in order]
    program = build_program([designs[i] for i in order], grounds, actuation, record_every, geometry)
    run = engine.run(program, progress)
    back = np.argsort(order)
    run = reordered(run, back)
    headings = np.array([d.orientation for d in designs])
    nominal = np.array([nominal_steps(d.schedule.columns * d.schedule.repeats, actuation) for d in designs])
    return summarise(run, program.snapshots[back], headings, nominal, geometry, record_every)


def reordered(run: LatticeResult, order: np.ndarray) -> LatticeResult:
    """What a batch did, with its robots in another order, shape (B,)."""
    return LatticeResult(
        *(getattr(run, f)[order] for f in ("status", "steps", "positions", "orientations", "strains", "sizes"))
    )


def scattered(body: LatticeBody, deviation: float, seed: int, robots: ArrayLike) -> np.ndarray:
    """Start positions [m] with Gaussian noise of a standard deviation [m], shape (B, V, 3); a robot has its own."""
    noise = [np.random.default_rng([seed, r]).normal(0.0, deviation, body.voxels.shape) for r in np.asarray(robots)]
    return body.start_positions + np.array(noise)


def travel_directions(headings: np.ndarray) -> np.ndarray:
    """Unit vectors in the plane, shape (B, 2), of headings [degrees], shape (B,)."""
    angles = np.deg2rad(headings)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def sideways(displacement: ArrayLike, headings: ArrayLike) -> np.ndarray:
    """How far robots have drifted to the left of their headings [m], shape (B,).

    Args:
        displacement: of ``InflatableResult`` [m], shape (B, 2).
        headings: [degrees], shape (B,).
    """
    x, y = np.asarray(displacement, float).T
    ahead = travel_directions(np.asarray(headings, float)).T
    return np.asarray(y * ahead[0] - x * ahead[1])


def summarise(
    run: LatticeResult,
    marks: np.ndarray,
    headings: np.ndarray,
    nominal: np.ndarray,
    geometry: InflatableGeometry,
    record_every: int | None = None,
    stages: int = 1,
) -> InflatableResult:
    """What a run says of its robots.

    Args:
        run: of a batch; its first snapshots are the end of the initialisation, the end of the gait, and the ends of
            all stages but the last.
        marks: steps of the snapshots, shape (B, S).
        headings: [degrees], shape (B,).
        nominal: steps that the published convention divides the distance of each robot by, shape (B,).
        geometry: of the robots.
        record_every: steps between the snapshots that follow; None without.
        stages: of the gait.
    """
    body, dt = geometry.body, geometry.time_step
    begin, end = marks[:, 0], marks[:, 1]
    extents = half_extents(body, run.strains, run.sizes)
    first = stages + 1
    middle = mean_of_face_corners(body, run.positions[:, :first], run.orientations[:, :first], extents[:, :first])
    way = (middle[..., :2] * travel_directions(headings)[:, None]).sum(axis=-1)
    ok = run.status == "ok"
    parts = np.where(ok[:, None], np.diff(way[:, stage_order(stages)], axis=1), np.nan)
    displacement = np.where(ok[:, None], middle[:, 1, :2] - middle[:, 0, :2], np.nan)
    distance = (displacement * travel_directions(headings)).sum(axis=1)
    lengths = distance / geometry.body_length
    steps = np.where(ok, end - begin, np.maximum(run.steps - begin, 0))
    frames = None
    if record_every:
        times = np.arange(marks.shape[1] - first) * record_every * dt
        frames = frames_of(run, extents, first, times)
    return InflatableResult(
        distance,
        lengths / (nominal * dt),
        lengths / ((end - begin) * dt),
        run.status,
        parts,
        steps,
        dt,
        frames,
        body,
        displacement,
    )


def stage_order(stages: int) -> list[int]:
    """In which order in time the first snapshots were taken, see :func:`summarise`."""
    return [0, *range(2, stages + 1), 1]
