"""Tables of a study that stand alone: what follows from them is made again, and nothing is computed."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from optim.experiments.results import check_folder
from optim.experiments.tables import read_records
from taichi_sim.base.files import read_text

RAW = "runs"  # folder of raw results


def read_alone(
    folder: Path, kind: str, tables: Sequence[str], files: Sequence[str], settings: Mapping[str, Any]
) -> list[list[dict[str, Any]]]:
    """Check a study's folder, and read its tables where it holds these without the runs that they were made from.

    Args:
        folder: the folder of the study, which may be new.
        kind: kind of study, kept in a file of the folder.
        tables: names of the tables.
        files: names of all files and folders that the study puts there.
        settings: the values asked for, by their names in ``summary.json``.

    Returns:
        The records of each table; none for any other folder of the study.

    Raises:
        ValueError: if the folder holds something else, or tables whose summary tells of other settings.
    """
    check_folder(folder, files, kind)
    if (folder / RAW).exists() or not all((folder / name).is_file() for name in tables):
        return []
    path = folder / "summary.json"
    known = json.loads(read_text(path)) if path.is_file() else {}
    for name, value in settings.items():
        if name in known and known[name] != value:
            raise ValueError(
                f"out: {folder} holds tables of another study ({name}: {known[name]!r}, not {value!r}) without its "
                "runs; name another folder"
            )
    return [read_records(folder / name) for name in tables]
