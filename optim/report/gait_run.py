"""Reports of the inflatable robot: its terrains, its best gait, and what that asks of the pneumatic rig."""

import dataclasses
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from optim.problems.inflatable.problem import RIG_FILE, GaitProblem
from optim.report.charts import chart, image
from optim.report.kinds import Best, Progress, Replay, finite
from optim.report.markup import Html, Section, Text, facts, joined, number, paragraph, picture, table
from optim.report.rig import KPA_PER_PSI, rig_section
from optim.runs.generation import Generation
from robots.calibration import NAMES, UNITS, Properties
from robots.hardware import PneumaticRig
from robots.inflatable import gaits
from robots.inflatable.cores import Pressure, common_pressure
from robots.inflatable.gaits import GaitDesign
from robots.view.motion import record_every
from robots.world import Terrain
from taichi_sim.base.arrays import Floats

UNIT = "BL/s"
PIXELS = 110  # an inch


@dataclass(frozen=True)
class GaitRun:
    """A run that designs shape, orientation and gait of the inflatable robot."""

    problem: GaitProblem

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> Self:
        """The run of a problem as described."""
        return cls(GaitProblem.from_description(description))

    @property
    def task(self) -> str:
        """Where the robot travels."""
        return f"inflatable robot, {' and '.join(terrain.spoken for terrain in self.problem.terrains)}"

    @property
    def score(self) -> tuple[str, str]:
        """Speed."""
        return ("speed" if len(self.problem.terrains) == 1 else "mean speed"), UNIT

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """Terrains, what is free, what is fixed, and the simulation."""
        problem, geometry = self.problem, self.problem.body
        held = [f"orientation {problem.orientation:g}°"] if problem.orientation is not None else []
        held += [f"pressure {_pascals(problem.pressure)}"] if problem.pressure is not None else []
        held += ["gait"] if problem.schedule is not None else []
        aim = "mean speed over the terrains" if problem.objectives == "mean" else "speed on each terrain"
        if len(problem.terrains) == 1:
            aim = "speed"
        return [
            ("Robot", f"inflatable shape-changing robot, {problem.geometry} geometry, {geometry.body_length:g} m long"),
            ("Terrains", joined(_described(terrain) for terrain in problem.terrains)),
            ("Objective", f"{aim}, in body lengths a second {self._convention} ({UNIT})"),
            ("Free", ", ".join(problem.free)),
            ("Fixed", ", ".join(held) or "nothing"),
            ("Gait", f"{problem.columns} columns, played {self._often}, encoded as {problem.encoding}"),
            *([("Rig", _fitted(problem.properties))] if problem.properties else []),
            ("Simulation", f"{problem.precision} on {problem.device}, weight of bladders {problem.weight}"),
        ]

    @property
    def _convention(self) -> str:
        """How time is counted."""
        steps = self.problem.steps
        return "by the published convention" if steps is None else f"of {steps:,} time steps"

    @property
    def _often(self) -> str:
        """How often gaits are played."""
        if not self.problem.graded:
            return _times(self.problem.repeats)
        return f"as often as {self.problem.most_steps:,} time steps allow"

    @property
    def curves(self) -> Mapping[str, str]:
        """The speed on each terrain, of several."""
        terrains = self.problem.terrains
        return {f"speed_{terrain.name}": terrain.spoken for terrain in terrains} if len(terrains) > 1 else {}

    @property
    def _robot(self) -> dict[str, Any]:
        return {"geometry": self.problem.body, "actuation": self.problem.actuation}

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Simulate a design on all terrains."""
        from robots.view.picture import inflatable_title, motion_picture
        from robots.view.soft_motion import inflatable_motion

        problem, design = self.problem, self.problem.design(point)
        every = record_every(gaits.steps_of(design, self._robot["actuation"]), frames)
        where = {name: getattr(problem, name) for name in ("precision", "device", "threads")}
        motions, speeds, pictures = [], [], []
        for n, terrain in enumerate(problem.terrains):
            result = gaits.simulate(
                [design],
                terrain,
                **self._robot,
                **where,
                record_every=every,
                progress=lambda part, n=n: progress((n + part) / len(problem.terrains)),
            )
            result = dataclasses.replace(result, speed=problem.speeds(result))
            drive, name = self._robot["actuation"], terrain.spoken
            motion = inflatable_motion(result, design, terrain, actuation=drive, name=name)
            strip = motion_picture(motion, title=inflatable_title(result, design, terrain))
            alt = f"Six poses of the best gait {name}, above the chart of its actuators"
            motions.append(motion)
            speeds.append(finite(float(result.speed[0])))
            pictures.append(picture(image(strip, alt, pixels=PIXELS), alt))
        return Replay(motions, speeds, pictures)

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """Numbers on each terrain, the gait chart, and the rig."""
        design, details = self.problem.design(point), last.best_details or {}
        rows, told = [], []
        for n, terrain in enumerate(self.problem.terrains):
            speed = finite(details.get(f"speed_{terrain.name}"))
            distance = None if speed is None else speed * self._metres_per_speed(design)
            again = replay.numbers[n] if n < len(replay.numbers) else None
            rows.append([terrain.spoken, *map(number, (speed, distance, again)[: 3 if replay.numbers else 2])])
            told.append({"terrain": terrain.name, "speed": speed, "distance": distance, "replayed": again})
        header = ["Terrain", f"Speed [{UNIT}]", "Distance [m]"]
        header += [f"Replayed here [{UNIT}]"] if replay.numbers else []
        shape: list[tuple[str, Text]] = [
            *(
                (name, Html(f"{number(kpa, 2, 'kPa')} ({number(kpa / KPA_PER_PSI, 2, 'psi')})"))
                for name, kpa in _kilopascals("Core pressure", design).items()
            ),
            ("Orientation", Html(f"{number(design.orientation, 1)}°, where 0° rolls and 90° inches")),
            (
                "Gait",
                f"{design.schedule.columns} columns, played {_times(design.schedule.repeats)}, "
                f"{self._seconds(design):.2f} s simulated",
            ),
        ]
        # Prints show poses above the same chart instead of the player.
        printed = [Html(f'<div class="print-only">{joined(replay.pictures, "")}</div>')] if replay.pictures else []
        kind = "medium screen-only" if printed else "medium"
        content = [
            table("The best design on each terrain", header, rows),
            facts("Its body and gait", shape),
            picture(self._gait_chart(design), "When its actuators are on: bladders inflate, feet grip.", kind),
            *printed,
        ]
        limits, document = self._on_rig(design, rig)
        body: dict[str, Any] = {"pressure": design.pressure, "orientation": design.orientation}
        return Best(content, [limits], {"terrains": told, **body, "rig": document})

    def _on_rig(self, design: GaitDesign, rig: PneumaticRig | None) -> tuple[Section, dict[str, Any] | None]:
        """What the gait asks of the rig, which plays one core pressure only."""
        if common_pressure(design.pressure) is None:
            why = "Its cores have different pressures; a rig has one line for the core, so it has no gait table."
            return Section("On the pneumatic rig", [paragraph(why, "note")]), None
        return rig_section(design, rig, self._seconds(design))

    def _gait_chart(self, design: GaitDesign) -> Html:
        from robots.view.drawing import draw_schedule

        gait = gaits.played(design, self._robot["actuation"])
        edges = gait.edges * self._robot["geometry"].time_step

        def draw(axes: Any) -> None:
            draw_schedule(axes, design.schedule, edges)
            axes.set_xlabel("time [s]")

        share = 100 * gait.levels.mean()
        alt = f"Gait chart: ten actuators over {edges[-1]:.1f} s, on in {share:.0f} % of the columns"
        return chart(draw, alt, size=(4.8, 2.1))

    def _metres_per_speed(self, design: GaitDesign) -> float:
        """Metres that a speed of 1 comes to."""
        geometry = self._robot["geometry"]
        return float(geometry.body_length * self.problem.counted_steps(design) * geometry.time_step)

    def _seconds(self, design: GaitDesign) -> float:
        """Time of the gait, simulated."""
        return float(gaits.steps_of(design, self._robot["actuation"]) * self._robot["geometry"].time_step)

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """Pressures and orientation."""
        designs = [self.problem.design(point) for point in points]
        each = [_kilopascals("Pressure", design) for design in designs]
        names = list(each[0]) if each else ["Pressure"]
        return {
            **{f"{name} [kPa]": [number(pressures[name], 2) for pressures in each] for name in names},
            "Orientation [°]": [number(design.orientation, 1) for design in designs],
        }

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """Simulating, watching and exporting the best design."""
        problem = self.problem
        where, best = (shlex.quote(str(path)) for path in (folder, folder / "best.json"))
        named = ("geometry", "weight", "precision", "device")
        options = " ".join(f"--{name} {getattr(problem, name)}" for name in named)
        if problem.properties is not None:
            options += f" --calibration {shlex.quote(str(folder / RIG_FILE))}"
        return [
            ("Go on with the run, if it was interrupted", f"morpholab codesign --resume --out {where}"),
            *(
                (
                    f"Simulate the best design {terrain.spoken}",
                    f"morpholab simulate --gait {best} {_where(terrain)} {options}",
                )
                for terrain in problem.terrains
            ),
            ("Watch it", f"morpholab view {where} --out best.html"),
            *(
                [("Write its pressures for the rig", f"morpholab export {where} --csv gait.csv --units psi")]
                if problem.body.cores == 1
                else []
            ),
        ]


def _kilopascals(name: str, design: GaitDesign) -> dict[str, float]:
    """Pressure of the core by that name, or of several by the name and a number [kPa]."""
    if not isinstance(design.pressure, tuple):
        return {name: design.pressure / 1000}
    return {f"{name} {number}": one / 1000 for number, one in enumerate(design.pressure, start=1)}


def _pascals(pressure: Pressure) -> str:
    return ", ".join(f"{one:g}" for one in np.atleast_1d(pressure)) + " Pa"


def _fitted(properties: Properties) -> str:
    """The properties of a rig, in a line."""
    each = (f"{name.replace('_', ' ')} {getattr(properties, name):.4g} {UNITS[name]}" for name in NAMES)
    return ", ".join(text.strip() for text in each)


def _where(terrain: Terrain) -> str:
    """A terrain as options of the command line."""
    return f"--terrain {terrain.name}" if terrain.is_fluid else f"--slope {terrain.slope:g}"


def _described(terrain: Terrain) -> str:
    friction = {"gripping": terrain.high_friction, "sliding": terrain.low_friction}
    given = [f"friction {name} {value:g}" for name, value in friction.items() if value is not None]
    return " with ".join([terrain.name, *given])


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
