"""``morpholab calibrate``: the inflatable robot's properties, fitted to what was measured on a rig."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import Report, options
from optim.commands.options import QUIET, THREADS, Command, Option, count, path_to
from optim.progress import shown_progress
from robots.inflatable.kind import GAITS, GEOMETRIES, load_gait

if TYPE_CHECKING:
    from robots.inflatable.design import InflatableDesign

COMMAND = Command(
    "calibrate",
    "fit friction, modulus and inflation rate to a rig",
    "Fit properties of the inflatable robot to measurements: dragged feet, diameters of the pouch, gaits; see "
    "docs/calibration.md.",
    (
        path_to("data", "DATA", "file of measurements (TOML)", words="?"),
        Option(
            "fit",
            "of friction, low_friction, modulus, inflation_rate (default: all that the experiments are made for)",
            options.names,
            "NAMES",
        ),
        Option(
            "bounds",
            "of a property, such as modulus=200e3:800e3 (Pa) or inflation_rate=0.5:8 (1/s); may be repeated",
            metavar="NAME=LOW:HIGH",
            several=True,
        ),
        path_to("out", "DIR", "new folder for calibration.json and calibration.png"),
        path_to("example", "FILE", "write measurements of a robot of known properties instead, with 2 %% noise"),
        Option("geometry", "of the example's robot (default: small); files name theirs", choices=GEOMETRIES),
        count("seed", 0, "of all noise (default: 0)", default=0),
        options.precision("f32", "f32"),
        THREADS,
        QUIET,
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Fit, or write the example."""
    if (args.data is None) == (args.example is None):
        raise ValueError("data: give either a file of measurements, or --example FILE to write one")
    for name in ("fit", "bounds", "out"):
        if args.example is not None and getattr(args, name):
            raise ValueError(f"{name}: it is of a fit; leave it out with --example, which writes one file")
    return _write_example(args) if args.data is None else _fit(args)


def _write_example(args: argparse.Namespace) -> Report:
    from robots.calibration import Laboratory, write_measurements
    from robots.calibration.example import TRUTH, example
    from robots.inflatable.body import NAMED_GEOMETRIES
    from taichi_sim.base.claims import claimed_path, undone_if_it_fails

    path, geometry = args.example, args.geometry or "small"
    args.held.enter_context(claimed_path("path", path))
    more = {"stiffest": TRUTH.modulus, "precision": args.precision, "threads": args.threads}
    laboratory = Laboratory(NAMED_GEOMETRIES[geometry], **more)
    with shown_progress("simulating the experiments", 1.0, args.quiet):
        measured = example(laboratory, args.seed)
    with undone_if_it_fails() as made:  # also where the file is written, but not that its folder has it
        made.append(path)
        write_measurements(path, geometry, measured)
    truth = ", ".join(f"{name} {value:g}" for name, value in vars(TRUTH).items())
    return Report({"file": str(path), "geometry": geometry, "truth": vars(TRUTH)}, f"{path}: measurements of {truth}")


def _fit(args: argparse.Namespace) -> Report:
    from optim.calibration import calibrate, check_names, document, table
    from robots.calibration import CALIBRATION_FORMAT, NAMES, Laboratory, read_measurements
    from robots.inflatable.actuation import InflatableActuation
    from robots.inflatable.body import NAMED_GEOMETRIES
    from taichi_sim.base.claims import undone_if_it_fails
    from taichi_sim.base.files import write_record

    if args.geometry is not None:
        raise ValueError(f"geometry: {args.geometry} is not allowed beside {args.data}, which names its own")
    options.claim_folder(args, "calibration.json", "calibration.png")
    found = read_measurements(args.data, lambda name: _load(args.data.parent, name))
    made_for = {experiment.informs[0] for experiment in found.experiments}
    names = args.fit or tuple(name for name in NAMES if name in made_for)
    bounds = _bounds(args.bounds or ())
    if unused := [text for text in args.bounds or () if text.partition("=")[0] not in names]:
        raise ValueError(f"bounds: {unused[0]!r} is not used; fitted are {', '.join(names)}")
    check_names(found.experiments, names)
    geometry = NAMED_GEOMETRIES[found.geometry]
    stiffest = bounds["modulus"][1] if "modulus" in names else geometry.youngs_modulus
    drive = InflatableActuation(weight=found.weight)
    more = {"seed": args.seed, "precision": args.precision, "threads": args.threads}
    laboratory = Laboratory(geometry, drive, stiffest, **more)
    with shown_progress("fit", 1.0, args.quiet) as update:
        result = calibrate(found.experiments, laboratory, names, bounds, update)
    record = document(result, found.geometry, found.weight)

    def write() -> str:
        from optim.calibration.report import save_calibration

        args.out.mkdir(parents=True, exist_ok=True)
        with undone_if_it_fails() as made:
            made.append(args.out / "calibration.json")
            write_record(args.out / "calibration.json", CALIBRATION_FORMAT, record)
        with undone_if_it_fails() as made:  # the fit stays if there is no room for its picture
            made.append(args.out / "calibration.png")
            save_calibration(found.experiments, result.predictions, args.out / "calibration.png")
        return f"{args.out}: calibration.json, calibration.png"

    report = Report(record, table(result))
    return report if args.out is None else report.written_by(write)


def _load(folder: Path, name: str) -> "InflatableDesign":
    """A gait of a file of measurements; names of files are relative to its folder."""
    return load_gait(name if name in GAITS else str(folder / name))


def _bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    from robots.calibration import BOUNDS

    bounds = dict(BOUNDS)
    for text in texts:
        name, _, interval = text.partition("=")
        if name not in BOUNDS:
            raise ValueError(f"bounds: {name!r} is unknown; choose of {', '.join(BOUNDS)}")
        try:
            low, high = map(float, interval.split(":"))
        except ValueError:
            low = high = 0.0
        if not 0 < low < high < float("inf"):
            raise ValueError(f"bounds: {text!r} is not allowed; give {name}=LOW:HIGH, both positive, the lower first")
        bounds[name] = low, high
    return bounds
