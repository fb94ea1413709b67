"""Does this tree compute the same bits as version 1.0? Runs cases in both and compares them on this machine.

make same-bits                              every case, some minutes
make same-bits SAME_BITS="--quick"          those that cover most in a minute
make same-bits SAME_BITS="--only gradients --only 'lattice/*slip'"

Where a law was rewritten and its last bit moved, accepted.json says of which cases, how far and why; beyond it fails:

{"lattice/floor_slip:end.velocities": {"bound": 1e-9, "absolute": 1e-13, "why": "almost at rest"},
 "lattice/*": {"bound": 1e-12, "why": "the law of springs is one for both ways"}}

The entry that fits first counts. Names that moved are told in places.py.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import cases
import probe
import trees
from comparison import Accepted, Verdict, judge, read_accepted

REFERENCE = "ed12070"  # version 1.0


def main() -> int:
    """Compare; 0 if nothing differs more than accepted, 1 if something does, 2 for bad input."""
    given = _parser().parse_args()
    probe.load_cases()
    try:
        names = cases.chosen(given.only, given.quick)
        accepted = {} if given.strict else read_accepted(given.accepted)
        if given.list:
            print("\n".join(f"{name}{'  (quick)' if cases.CASES[name].quick else ''}" for name in names))
            return 0
        old = trees.reference_tree(given.reference)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    started = time.perf_counter()
    kept = trees.results_folder(given.reference, trees.fingerprint())
    _compute_old(old, kept, names, given.fresh)
    with tempfile.TemporaryDirectory(dir=trees.CACHE) as folder:
        print("in this tree:", file=sys.stderr)
        trees.run_probe(given.tree, old, Path(folder), names)
        verdicts = [verdict(name, kept, Path(folder), accepted) for name in names]
    return _report(verdicts, given.reference, time.perf_counter() - started)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "same_bits", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="a case, a group or a pattern")
    parser.add_argument("--quick", action="store_true", help="those that cover most in a minute")
    parser.add_argument("--list", action="store_true", help="name the cases and do nothing else")
    parser.add_argument("--strict", action="store_true", help="accept no deviation, whatever the table says")
    parser.add_argument("--accepted", type=Path, default=trees.HERE / "accepted.json", metavar="FILE",
                        help="table of accepted deviations (default: accepted.json beside this file)")  # fmt: skip
    parser.add_argument("--fresh", action="store_true", help="compute the old tree's results again, too")
    parser.add_argument("--reference", default=REFERENCE, metavar="COMMIT", help="the old tree (default: version 1.0)")
    parser.add_argument("--tree", type=Path, default=trees.ROOT, help="the new tree (default: this one)")
    return parser


def _compute_old(old: Path, kept: Path, names: list[str], fresh: bool) -> None:
    """Compute in the old tree what is not kept from earlier."""
    missing = [name for name in names if fresh or not probe.file_of(kept, name).is_file()]
    if missing:
        print(f"in version 1.0, kept in {kept}:", file=sys.stderr)
        for name in missing:
            probe.file_of(kept, name).unlink(missing_ok=True)
        trees.run_probe(old, old, kept, missing)


def verdict(name: str, kept: Path, folder: Path, accepted: Mapping[str, Accepted]) -> Verdict:
    """What became of one case."""
    for tree, where in (("old", kept), ("new", folder)):
        path = probe.file_of(where, name)
        if not path.is_file():
            told = path.with_suffix(".txt")
            reason = told.read_text().strip().splitlines()[-1] if told.is_file() else "the process ended before it"
            return Verdict(name, False, f"FAILED in the {tree} tree: {reason}")
    old, new = (trees.load(probe.file_of(where, name)) or {} for where in (kept, folder))
    return judge(name, old, new, accepted)


def _report(verdicts: list[Verdict], reference: str, seconds: float) -> int:
    width = max(len(verdict.case) for verdict in verdicts)
    for verdict in verdicts:
        print(f"{verdict.case:<{width}}  {verdict.text}")
    bad = sum(not verdict.ok for verdict in verdicts)
    print(f"{len(verdicts) - bad} of {len(verdicts)} cases as in {reference}, {seconds:.0f} s")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
