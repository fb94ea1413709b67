"""Compute random robots in every way there is, and their gradients: ``make fuzz-physics CASES=10000``.

Soft robots and articulated ones: drivers, batches and runs in parts must give the same bits; exact gradients must agree
with central differences where nothing happens in between. What was done is kept line by line in ``build/fuzz/physics``,
in a folder for each state of the physics and of the cases, so a run that is cut off goes on; ``--case N`` computes a
case again and tells of it.
"""

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import physics_bits  # noqa: E402
import physics_cases  # noqa: E402
import physics_gradients  # noqa: E402
import rigid_bits  # noqa: E402
import rigid_cases  # noqa: E402
import rigid_gradients  # noqa: E402
from physics_directions import AGREES, STEPS  # noqa: E402

from taichi_sim.base.line_files import append_line, complete_lines, keep_lines  # noqa: E402

EACH = 1_000_000  # numbers of cases: those of bits and of gradients of soft robots, then of articulated ones


@dataclass(frozen=True)
class Robots:
    """Robots of an engine, and what is done with them.

    Attributes:
        sources: folders of files on which results depend, beside those of all.
        make_case: the case of a number.
        differences: what differs between ways to compute a case, and what one of them found.
        make_smooth: the case of a number, with derivatives.
        check_gradients: a line for each direction of a case; None if it diverged.
    """

    sources: tuple[str, ...]
    make_case: Callable[[int], Any]
    differences: Callable[[Any], tuple[list[str], dict[str, np.ndarray]]]
    make_smooth: Callable[[int], Any]
    check_gradients: Callable[[Any], list[dict] | None]

    def bits(self, number: int) -> dict:
        """What came of a case in all drivers, as a line of the log."""
        case = self.make_case(number)
        differs, found = self.differences(case)
        lost, steps = int((found["status"] != "ok").sum()), int(found["steps"].sum())
        line = {"features": case.features, "robots": len(found["status"]), "diverged": lost, "differs": differs}
        return line | {"steps": steps}

    def gradients(self, number: int) -> dict:
        """What came of the gradients of a case, as a line of the log."""
        case = self.make_smooth(number)
        return {"features": case.features, "directions": self.check_gradients(case)}

    def folder(self) -> Path:
        """Where the lines of these sources are."""
        parts = ("taichi_sim/ground", "taichi_sim/autodiff", "tests/fuzz", *self.sources)
        paths = [path for part in parts for path in sorted((ROOT / part).rglob("*.py"))]
        told = hashlib.sha256(b"".join(path.read_bytes() for path in paths))
        return ROOT / "build/fuzz/physics" / told.hexdigest()[:12]


KINDS = {
    "soft": Robots(
        ("taichi_sim/lattice",),
        physics_cases.make_case,
        physics_bits.differences,
        physics_cases.make_case,
        physics_gradients.check_gradients,
    ),
    "articulated": Robots(
        ("taichi_sim/rigid",),
        rigid_cases.make_case,
        rigid_bits.differences,
        rigid_gradients.make_smooth_case,
        rigid_gradients.check_gradients,
    ),
}
TASKS = [(kind, task) for kind in KINDS for task in ("bits", "gradients")]


def do(which: int, count: int, seconds: float) -> list[dict]:
    """The lines of so many cases of one of ``TASKS``, in the log and still to do; no more once the time is over."""
    kind, name = TASKS[which]
    robots, first = KINDS[kind], which * EACH
    path = robots.folder() / f"{kind}-{name}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = complete_lines(path)
    keep_lines(path, len(whole))  # the last may be cut off
    lines = {line["case"]: line for line in map(json.loads, whole)}
    wanted, started, task = range(first, first + count), time.monotonic(), getattr(robots, name)
    for number in wanted:
        if number in lines:
            continue
        if time.monotonic() - started > seconds:
            break
        try:
            line = {"case": number} | task(number)
        except Exception as error:  # a case that cannot be computed is a finding
            line = {"case": number, "features": [], "raised": f"{type(error).__name__}: {error}"}
        append_line(path, json.dumps(line))
        lines[number] = json.loads(json.dumps(line))
        if number % 100 == 99:
            print(f"{kind}, {name}: {number - first + 1} of {count}", file=sys.stderr, flush=True)
    return [lines[number] for number in wanted if number in lines]


def report(lines: list[dict]) -> list[str]:
    """What came of cases of bits, in lines for people and for docs/faults.md."""
    whole = [line for line in lines if "raised" not in line]
    robots, lost, steps = (sum(line[key] for line in whole) for key in ("robots", "diverged", "steps"))
    counts = Counter(feature for line in lines for feature in line["features"])
    failed = Counter(feature for line in lines if _failed(line) for feature in line["features"])
    found = [f"{len(lines)} cases, {robots} robots of which {lost} diverged, {steps} steps of robots: "
             f"{sum(map(_failed, lines))} cases differ or fail.", "",
             "| cases with | cases | differ or fail |", "| --- | ---: | ---: |"]  # fmt: skip
    found += [f"| {feature} | {count} | {failed[feature]} |" for feature, count in counts.most_common()]
    return found + [f"case {line['case']}: {line.get('raised') or line['differs']}" for line in lines if _failed(line)]


def _failed(line: dict) -> bool:
    every = line.get("directions") or ()
    odd = any(one.get("because", "").startswith("unexplained") or one.get("differs") for one in every)
    return bool(line.get("raised") or line.get("differs") or odd)


def report_gradients(lines: list[dict]) -> list[str]:
    """The shares of directions beyond the tolerance, by kind, and what explains them."""
    whole = [line for line in lines if line.get("directions")]
    lost = sum("directions" in line and line["directions"] is None for line in lines)
    every = [(line, one) for line in whole for one in line["directions"] if one["kind"] != "drivers"]
    table: dict[str, Counter] = {}
    why, odd = Counter(), [f"case {line['case']}: {line['raised']}" for line in lines if "raised" in line]
    for line, one in every:
        because = one.get("because", "")
        table.setdefault(one["kind"], Counter()).update(
            ["all", *["depends"] * (one["usual"] > 0), *["beyond"] * bool(because)]
            + ["unexplained"] * because.startswith("unexplained")
        )
        why.update([because.split(": with")[0]] if because else [])
        if because.startswith("unexplained"):
            odd.append(f"case {line['case']}: {one['kind']}, errors {one['errors']}, {because}")
    drivers = [(line["case"], one["differs"]) for line in whole for one in line["directions"] if one.get("differs")]
    odd += [f"case {number}: {differs}" for number, differs in drivers]
    beyond = sum(counts["beyond"] for counts in table.values())
    found = [f"{len(lines)} cases with gradients, {lost} diverged; {len(every)} directions, {beyond} of them "
             f"({100 * beyond / max(len(every), 1):.2f} %) beyond {AGREES:g} at steps of "
             f"{', '.join(f'{step:g}' for step in STEPS)}; {len(drivers)} cases in which drivers differ.", "",
             "| direction | directions | cost depends on it | beyond | unexplained |",
             "| --- | ---: | ---: | ---: | ---: |"]  # fmt: skip
    found += [
        f"| {kind} | {n['all']} | {n['depends']} | {n['beyond']} | {n['unexplained']} |" for kind, n in table.items()
    ]
    return [*found, "", *(f"{count} {text}" for text, count in why.most_common()), *odd]


def main() -> int:
    """Do the cases, report; 1 if any differs, fails, or has gradients that nothing explains."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="to compute in all drivers, of each kind of robots")
    parser.add_argument("--gradients", type=int, default=50, help="cases with gradients, of each kind of robots")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="for each of these; then report")
    parser.add_argument("--only", choices=sorted(KINDS), help="robots of this kind")
    parser.add_argument("--case", type=int, help="compute this case only, and tell all")
    args = parser.parse_args()
    if args.case is not None:
        kind, name = TASKS[args.case // EACH]
        print(json.dumps(getattr(KINDS[kind], name)(args.case), indent=1))
        return 0
    odd = False
    for which, (kind, name) in enumerate(TASKS):
        count = args.gradients if name == "gradients" else args.cases
        if count and args.only in (None, kind):
            lines = do(which, count, args.seconds)
            told = report_gradients(lines) if name == "gradients" else report(lines)
            print(f"{kind.capitalize()} robots, {name}", *told, "", sep="\n", flush=True)
            odd = odd or any(map(_failed, lines))
    return int(odd)


if __name__ == "__main__":
    raise SystemExit(main())
