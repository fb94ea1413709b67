"""The inflatable robot with a gait: it plays the gait on terrains, shows and exports it, and judges it.

What is heavy is imported when it is used, as commands know robots before they do any work.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.batches import batch_key, grouped, in_groups
from robots.inflatable.design import InflatableDesign, common_pressure, save_design
from robots.inflatable.layout import told_layout
from robots.inflatable.schedule import BLADDERS
from robots.outcome import recorded
from robots.robot import (
    HERE,
    Facts,
    Judgement,
    Measure,
    Outcome,
    Picture,
    Progress,
    Quantity,
    Replay,
    Robot,
    Trial,
    World,
)
from robots.uncertainty import QUANTITIES
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import decimal

if TYPE_CHECKING:
    from robots.calibration import Properties
    from robots.hardware import GaitTable, PneumaticRig
    from robots.inflatable.actuation import InflatableActuation
    from robots.inflatable.body import InflatableGeometry
    from robots.inflatable.convention import SpeedConvention
    from robots.inflatable.simulation import InflatableResult
    from robots.uncertainty import Perturbation
    from robots.view.motion import Motion

MEASURES = (
    Measure("speed", "BL/s", "speed, in body lengths a second by the published convention"),
    Measure("distance", "m", "distance along its heading"),
    Measure("speed_simulated", "BL/s", "speed in the time simulated"),
    Measure("sideways", "m", "drift to the left"),
)


@dataclass(frozen=True, eq=False)
class InflatableRobot(Robot):
    """The robot with a gait; nothing of it is free, as searches encode gaits in ways of their own.

    Attributes:
        gait: pressure, orientation and schedule.
        geometry: name of the body.
        weight: of bladders, ``"published"`` or ``"physical"``.
        properties: of a rig, or None.
        calibration: the file that these come from, if any.
        perturbation: standard deviation of noise on the start positions [m].
        seed: of that noise.
        convention: by which its speed counts, as in the search that found it; None is the published one.
        name: what people call it.
        rig: that plays a gait table; None plays the gait itself.
        rig_table: that it plays.
        drawn: what bladders do otherwise than told, which is no part of a description; None if they do as told.
    """

    gait: InflatableDesign
    geometry: str = "published"
    weight: str = "published"
    properties: "Properties | None" = None
    calibration: Path | None = None
    perturbation: float = 0.0
    seed: int = 0
    convention: "SpeedConvention | None" = None
    name: str = "inflatable robot"
    rig: "PneumaticRig | None" = None
    rig_table: "GaitTable | None" = None
    drawn: "Perturbation | None" = None

    kind = "inflatable"
    measures = MEASURES
    uncertain_in = QUANTITIES
    actuators = BLADDERS
    worlds = (Terrain(),)
    pictured = True

    def __post_init__(self) -> None:
        from robots.inflatable.actuation import WEIGHTS
        from robots.inflatable.body import NAMED_GEOMETRIES

        choice("geometry", self.geometry, NAMED_GEOMETRIES)
        choice("weight", self.weight, WEIGHTS)
        if self.properties is not None and self.gait.schedule.has_own_times:
            self.properties.check_time_step(NAMED_GEOMETRIES[self.geometry])

    @property
    def has_table(self) -> bool:  # type: ignore[override]
        """Whether a rig plays it: its cores share a pressure, as the usual rig has one line for them."""
        core = self.gait.schedule.core_pressure
        shared = core is None or core.ndim == 1 or not np.ptp(core, axis=0).any()
        return shared and common_pressure(self.gait.pressure) is not None

    @cached_property
    def parts(self) -> "tuple[InflatableGeometry, InflatableActuation]":
        """Its body, and how it is driven."""
        from robots.calibration import robot_of
        from robots.inflatable.simulation import laid_out

        geometry, actuation = robot_of(self.geometry, self.weight, self.properties)
        return laid_out(geometry, [self.gait]), actuation

    @property
    def footprint(self) -> tuple[float, float]:
        """Rear and front of the flat pouch along its heading, from the robot's origin [m]."""
        from robots.lattice_robot.rollout import ahead, footprint_of

        return footprint_of(self.parts[0].body, ahead(self.gait.orientation))

    def changed(self, options: Mapping[str, Any]) -> "InflatableRobot":
        """This robot with another body, properties of another rig, part of the gait, or noise, as options say."""
        from robots.calibration import load_calibration, weight_of_calibration

        rig = load_calibration(options["calibration"]) if "calibration" in options else None
        gait = {name: options[name] for name in ("pressure", "orientation") if name in options}
        schedule = self.gait.schedule.cut(options.get("columns"), options.get("repeats"))
        own = {"properties": rig[0], "calibration": options["calibration"]} if rig else {}
        if rig:  # the body with which they were fitted
            own["weight"] = weight_of_calibration(options["calibration"])
        if "columns" in options or "repeats" in options:
            own["convention"] = None  # that of another gait; this one counts as a whole
        more = {name: options[name] for name in ("geometry", "weight", "perturbation", "seed") if name in options}
        changed = dataclasses.replace(self.gait, schedule=schedule, **gait)
        if "bladders" in options:
            changed = changed.with_layout(options["bladders"])
        return dataclasses.replace(self, gait=changed, **{**own, **more})

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Play the gait, as often as there are points."""
        return self.run_in(points, (trial.world,), trial)[0]

    def perturbed(self, drawn: "Perturbation") -> "InflatableRobot":
        """This robot with bladders that play the gait as drawn."""
        return dataclasses.replace(self, drawn=drawn)

    def drawn_terrain(self, terrain: Terrain, drawn: "Perturbation") -> Terrain:
        """The terrain of a draw, with the friction of this robot's feet where it gives none."""
        return drawn.on(terrain, self.parts[1])

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: "Sequence[InflatableRobot]" = ()
    ) -> list[Outcome]:
        """Play the gait in several worlds, in as few batches as can be, in each world as often as there are points.

        Noise is the same in every world. A rig plays its table once in each world, whatever is drawn.
        """
        if self.rig is not None:
            return [self._on_rig(part) for part in trial.parts(worlds)]
        terrains, robots = [terrain_of(world) for world in worlds], variants or [self] * len(worlds)
        noisy = self.perturbation > 0 and len(points) > 1  # each of several has noise of its own, the same everywhere
        groups = grouped((batch_key(terrain), number * noisy) for number, terrain in enumerate(terrains))

        def run(group: Sequence[int], progress: Progress | None) -> list[Outcome]:
            told = dataclasses.replace(trial, progress=progress)
            return self._played([robots[n] for n in group], [terrains[n] for n in group], len(points), told)

        return in_groups(groups, trial.progress, run)

    def _played(
        self, robots: "Sequence[InflatableRobot]", terrains: Sequence[Terrain], count: int, trial: Trial
    ) -> list[Outcome]:
        """What each of several variants does so often on its terrain, in one batch."""
        from robots.inflatable.convention import counting_of
        from robots.inflatable.simulation import reordered, simulate

        gaits, drives = zip(*(robot.as_drawn for robot in robots), strict=True)
        rows = np.arange(len(terrains)).repeat(count).tolist()
        alone = len(terrains) == 1
        result = simulate(
            [gaits[row] for row in rows],
            terrains[0] if alone else [terrains[row] for row in rows],
            geometry=self.parts[0],
            actuation=drives[0] if alone else [drives[row] for row in rows],
            counting=counting_of(self.convention),
            **trial.compute.options,
            record_every=trial.record_every,
            perturbation=self.perturbation,
            seed=self.seed if alone else (self.seed,) * len(rows),
            progress=trial.progress,
        )
        if alone:
            return [self._outcome(result)]
        parts = np.arange(len(rows)).reshape(len(terrains), count)
        return [self._outcome(reordered(result, part)) for part in parts]

    @property
    def as_drawn(self) -> "tuple[InflatableDesign, InflatableActuation]":
        """The gait, and how it is driven, as bladders play it."""
        from robots.inflatable.perturbed import perturbed_design, perturbed_drive

        actuation = self.parts[1]
        if self.drawn is None:
            return self.gait, actuation
        return perturbed_design(self.gait, self.drawn), perturbed_drive(actuation, self.drawn)

    def _on_rig(self, trial: Trial) -> Outcome:
        """What becomes of the table on the rig."""
        from robots.inflatable.on_rig import played_by_rig

        return self._outcome(*played_by_rig(self, trial))

    def _outcome(self, result: "InflatableResult", more: Mapping[str, Floats] | None = None) -> Outcome:
        """A result as commands and searches see it."""
        from robots.inflatable.convention import speeds_by
        from robots.inflatable.simulation import sideways

        measures = {"speed": speeds_by(self.convention, result, *self.parts)}
        measures |= {name: getattr(result, name) for name in ("distance", "speed_simulated")}
        measures["sideways"] = sideways(result.displacement, [self.gait.orientation] * len(result.status))
        measures |= more or {}
        return Outcome(measures, result.status, steps=result.steps, frames=recorded(result.frames), result=result)

    @property
    def steps(self) -> int:
        """Time steps of the gait."""
        from robots.inflatable.timing import gait_steps

        return gait_steps(self.gait.schedule, self.parts[1])

    @property
    def lasts(self) -> float:
        """Time of the gait in the simulation [s]."""
        return float(self.steps * self.parts[0].time_step)

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the robot, with its gait."""
        from robots.inflatable.view.motion import inflatable_motion

        return inflatable_motion(outcome.result, self.gait, terrain_of(world), actuation=self.parts[1], name=name)

    def title_of(self, outcome: Outcome, world: World) -> str:
        """Speed, as it is counted, terrain, pressure and heading."""
        from robots.inflatable.view.picture import inflatable_title

        counted = dataclasses.replace(outcome.result, speed=outcome.measures["speed"])
        return inflatable_title(counted, self.gait, terrain_of(world))

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design, for ``robots.inflatable.load_design``."""
        save_design(self.gait, path)

    def document(self) -> dict[str, Any]:
        """The design, and the body that plays it."""
        gait = self.gait
        return {
            "pressure": gait.pressure,
            "orientation": gait.orientation,
            "schedule": gait.schedule.to_text(),
            "repeats": gait.schedule.repeats,
            "geometry": self.geometry,
            "weight": self.weight,
            **({} if gait.materials is None else {"materials": gait.materials.given}),
            **({} if gait.bladders is None else {"bladders": list(gait.bladders)}),
            **({} if self.rig is None else {"rig": self.rig.name}),
            **({} if self.calibration is None else {"calibration": str(self.calibration)}),
        }

    def spoken(self, outcome: Outcome) -> str:
        """Distance, drift and speeds."""
        numbers = {name: float(values[0]) for name, values in outcome.measures.items()}
        side = "left" if numbers["sideways"] >= 0 else "right"
        text = (
            f"distance {decimal(numbers['distance'])} m, {decimal(abs(numbers['sideways']))} m to the {side}, "
            f"speed {decimal(numbers['speed'])} BL/s "
        )
        if self.rig is not None:
            from robots.inflatable.on_rig import speed_lines

            return f"{text}(in the rig's time)\n{speed_lines(self.rig, numbers)}"
        told = "published convention" if self.convention is None else self.convention.spoken
        return f"{text}({told}; {decimal(numbers['speed_simulated'])} in the time simulated)"

    def facts_of(self, point: ArrayLike) -> Facts:
        """Shape, heading and gait."""
        from robots.hardware.units import KPA_PER_UNIT

        gait = self.gait
        cores: list[tuple[str, str | Quantity]] = []
        for name, kpa in core_pressure_rows("Core pressure", gait).items():
            cores += [
                (name, Quantity(kpa, "kPa", 2)),
                (f"{name} in psi", Quantity(kpa / KPA_PER_UNIT["psi"], "psi", 2)),
            ]
        times = {1: "once", 2: "twice"}.get(gait.schedule.repeats, f"{gait.schedule.repeats} times")
        return [
            *cores,
            ("Orientation, 0° rolls and 90° inches", Quantity(gait.orientation, "°", 1)),
            ("Gait", f"{gait.schedule.columns} columns, played {times}, {self.lasts:.2f} s simulated"),
            *([] if gait.materials is None else [("Of its own", ", ".join(gait.materials.given))]),
            *([] if gait.bladders is None else [("Bladders", told_layout(gait.bladders))]),
        ]

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """When its actuators are on."""
        from robots.inflatable.timing import gait_timeline
        from robots.inflatable.view.schedule_chart import draw_schedule

        played = gait_timeline(self.gait, self.parts[1])
        edges = played.edges * self.parts[0].time_step

        def draw(axes: Any) -> None:
            draw_schedule(axes, self.gait.schedule, edges)
            axes.set_xlabel("time [s]")

        share = f"on in {100 * played.levels.mean():.0f} % of the columns"
        words = f"When its ten actuators are on over {edges[-1]:.1f} s, {share}: bladders inflate, feet grip."
        return [Picture(words, draw, (4.8, 2.1), "medium screen-only" if replays else "medium")]

    def judge(
        self, world: World, *, seed: int = 0, compute: Compute = HERE, progress: Progress | None = None
    ) -> Judgement:
        """Mean speed of runs with noise, what remains of it under other conditions, and how far its parts slip."""
        from robots.inflatable.robustness import judge_gait

        if self.perturbation:
            raise ValueError(
                f"perturbation: {self.perturbation} is not allowed with --judge, which plays with noise of its own"
            )
        geometry, drive = self.parts
        more: Any = {**compute.options, "seed": seed or self.seed, "progress": progress}
        more |= {"geometry": geometry, "actuation": drive, "convention": self.convention}
        found = judge_gait(self.gait, terrain_of(world), closely=True, **more)
        calibration = {} if self.calibration is None else {"calibration": str(self.calibration)}
        return Judgement(found.spoken, {**calibration, **found.to_document()}, found.diverged)

    def table(self, **settings: Any) -> Any:
        """Pressures of a rig's lines over time, see ``robots.hardware.gait_table``."""
        from robots.hardware import gait_table

        if "full_scale" in settings:
            raise ValueError("full-scale: the rig's map says what pressures stand for; leave it out")
        return gait_table(self.gait, **settings)

    def rig_report(self, rig: Any) -> tuple[Any, float]:
        """What the gait asks of each line of a rig, and the time of the gait in the simulation [s]."""
        from robots.hardware.gait_commands import rig_report

        return rig_report(self.gait, rig), self.lasts

    def save_picture(self, world: World, path: Path) -> None:
        """Draw poses and gait."""
        from robots.inflatable.view import picture

        geometry, drive = self.parts
        picture.save_motion_picture(
            self.gait, terrain_of(world), path, geometry=geometry, actuation=drive, convention=self.convention
        )


def core_pressure_rows(name: str, gait: InflatableDesign) -> dict[str, float]:
    """Pressure of the core by that name, or of several by the name and a number [kPa]."""
    if not isinstance(gait.pressure, tuple):
        return {name: gait.pressure / 1000}
    return {f"{name} {number}": one / 1000 for number, one in enumerate(gait.pressure, start=1)}
