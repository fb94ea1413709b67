"""Computes cases in the tree that is on PYTHONPATH, and writes the arrays of each into a file; run by ``__main__``."""

import argparse
import importlib
import sys
import time
import traceback
from pathlib import Path

import numpy as np
import places
from cases import CASES

FILES = ("case_lattice", "case_gaits", "case_machines", "case_gradients", "case_methods", "case_runs")


def load_cases() -> None:
    """Import the files of cases, which adds them to the list; imports nothing of a tree yet."""
    for name in FILES:
        importlib.import_module(name)


def file_of(folder: Path, case: str) -> Path:
    """Where the arrays of a case are; what went wrong is beside it, with the ending ``.txt``."""
    return folder / f"{case.replace('/', '.')}.npz"


def main() -> None:
    """Compute the cases named, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", type=Path, help="the tree that is on PYTHONPATH")
    parser.add_argument("inputs", type=Path, help="the tree that data are read from")
    parser.add_argument("folder", type=Path, help="where the results go")
    parser.add_argument("names", nargs="+", help="of cases")
    given = parser.parse_args()
    check_tree(given.tree)
    places.inputs = given.inputs
    load_cases()
    for name in given.names:
        started = time.perf_counter()
        done = compute(name, file_of(given.folder, name))
        if found := places.strangers(given.tree):
            file_of(given.folder, name).unlink(missing_ok=True)
            sys.exit(f"error: {name} imports what is not of {given.tree}: {', '.join(found)}")
        print(f"  {name}: {time.perf_counter() - started:.1f} s{'' if done else ', failed'}", file=sys.stderr)


def check_tree(tree: Path) -> None:
    """Make sure that packages come from the tree meant, and nothing of them from one installed."""
    sys.meta_path[:] = places.without_editable()
    for name in places.PACKAGES:
        importlib.import_module(name)
    if found := places.strangers(tree):
        sys.exit(f"error: not imported from {tree}: {', '.join(found)}")


def compute(name: str, path: Path) -> bool:
    """Compute a case and write its arrays, or what went wrong; whether it went well."""
    try:
        arrays = {key: np.asarray(value) for key, value in CASES[name].compute().items()}
        if not arrays or any(array.dtype == object for array in arrays.values()):
            raise TypeError(f"arrays of numbers or text are needed, not {sorted(arrays)}")
    except Exception:  # whatever it is, the other cases can still be compared
        path.with_suffix(".txt").write_text(traceback.format_exc())
        return False
    aside = path.with_suffix(".part.npz")
    np.savez(aside, **arrays)
    aside.replace(path)
    return True


if __name__ == "__main__":
    main()
