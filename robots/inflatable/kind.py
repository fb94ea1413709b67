"""The inflatable robot as a kind of robot: a design of its gait and shape, by name or from a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.robot import Option, Robot
from robots.world import TerrainKind
from taichi_sim.base import checks
from taichi_sim.base.options import checked, number, value_of, whole

if TYPE_CHECKING:
    from robots.inflatable.cores import Pressure
    from robots.inflatable.design import InflatableDesign

GAITS = ("inching", "rolling")
GEOMETRIES = ("published", "small", "two-core")
WEIGHTS = ("published", "physical")
FORMATS = ("morpholab-inflatable-design-1", "morpholab-graded-design-1")
RIG_OPTION = Option(
    "calibration",
    "properties of a rig, the calibration.json of morpholab calibrate; its geometry is the default",
    Path,
    "FILE",
)


def pressure(high: float = float("inf")) -> Any:
    """The type of an option with pressures from 0 to a bound [Pa]: one, or one for each core, with commas between."""

    def convert(text: str) -> "Pressure":
        each = tuple(checks.number("", value_of(part), 0.0, high, "Pa") for part in text.split(","))
        return each[0] if len(each) == 1 else each

    return checked(convert)


class InflatableKind(TerrainKind):
    """The shape-changing robot: designs in JSON files or gait tables."""

    name = "inflatable"
    title = "inflatable robot"
    designs = GAITS
    search_precision = "f32"
    options = (
        Option("geometry", "the robot's body (default: published, of a run its own)", choices=GEOMETRIES),
        Option("columns", "columns of the gait that are played (default: all)", whole(1), "T"),
        Option("repeats", "how often the columns are played (default: the gait's own)", whole(1), "N"),
        Option(
            "weight",
            "of bladders: none while they move or stay inflated, or always (default: published, of a run its own)",
            choices=WEIGHTS,
        ),
        RIG_OPTION,
        Option(
            "pressure",
            "of the core, or such as 12000,0 of each of several (default: the gait's own)",
            pressure(),
            "PA",
        ),
        Option(
            "orientation",
            "0 rolls, 90 inches uphill (default: the gait's own)",
            number(0.0, 90.0, "degrees"),
            "DEGREES",
        ),
        Option(
            "from_rows",
            "of a gait table, what its rows play, by the inverse of its pressure map, not the design in its header",
            None,
            commands=("simulate",),
        ),
        Option(
            "perturbation",
            "standard deviation of noise on the start positions (default: 0)",
            number(0.0, unit="m"),
            "M",
            commands=("simulate",),
        ),
        Option("seed", "of the noise (default: 0)", whole(0), "N", commands=("simulate",)),
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a known gait, of a design file, or of a gait table; by default inching."""
        from robots.calibration import load_calibration
        from robots.inflatable.offered import InflatableRobot

        named = source or GAITS[0]
        name = named if named in GAITS else Path(named).stem
        gait = load_gait(named, bool(options.get("from_rows")))
        geometry = load_calibration(options["calibration"])[1] if "calibration" in options else GEOMETRIES[0]
        return InflatableRobot(gait, geometry, name=name).changed(options)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Designs and gait tables."""
        return form in FORMATS or path.suffix.lower() == ".csv"


def load_gait(text: str, from_rows: bool = False) -> "InflatableDesign":
    """The design of a known gait's name, or of a file; with ``from_rows`` what the rows of a gait table play.

    Raises:
        ValueError: for anything else.
    """
    from robots.hardware import read_design
    from robots.inflatable.design import INCHING, ROLLING

    known = dict(zip(GAITS, (INCHING, ROLLING), strict=True))
    if text in known and not from_rows:
        return known[text]
    if text not in known and not Path(text).is_file():
        raise ValueError(f"gait: {text!r} is neither a known gait ({', '.join(known)}) nor a file")
    return read_design(Path(text), from_rows)
