"""Designs of the inflatable robot out of files of either kind: JSON, or a gait table."""

from pathlib import Path

from robots.hardware.csv_files import read_csv
from robots.inflatable.gaits import GaitDesign, design_of, load_gait


def read_design(path: Path, from_rows: bool = False) -> GaitDesign:
    """The design of a design file, or of a gait table (``.csv``): that of its header, or what its rows play.

    Raises:
        ValueError: in one line, for any other file, and for rows asked of one that has none.
    """
    if path.suffix.lower() != ".csv":
        if from_rows:
            raise ValueError(f"from-rows: {str(path)!r} has no rows; name a gait table (.csv)")
        return load_gait(path)
    table = read_csv(path)
    design = table.played() if from_rows else table.design
    return design_of(design.pressure, design.orientation, design.schedule)
