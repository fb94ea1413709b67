"""Compute random robots in every way there is, and their gradients: ``make fuzz-physics CASES=10000``.

Drivers, batches and runs in parts must give the same bits; exact gradients must agree with central differences where
nothing happens in between. What was done is kept line by line in ``build/fuzz/physics``, in a folder for each state of
the physics and of the cases, so a run that is cut off goes on; ``--case N`` computes a case again and tells of it.
"""

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from physics_bits import differences  # noqa: E402
from physics_cases import make_case  # noqa: E402
from physics_gradients import AGREES, STEPS, check_gradients  # noqa: E402

from taichi_sim.base.line_files import append_line, complete_lines, keep_lines  # noqa: E402

SOURCES = ("taichi_sim/lattice", "taichi_sim/ground", "taichi_sim/autodiff")  # with the cases, what results depend on
FIRST_GRADIENT = 1_000_000  # cases of gradients are others than those of bits


def folder() -> Path:
    """Where the lines of these sources are."""
    paths = [path for part in SOURCES for path in sorted((ROOT / part).rglob("*.py"))]
    paths += sorted(Path(__file__).parent.glob("physics_*.py"))
    told = hashlib.sha256(b"".join(path.read_bytes() for path in paths))
    return ROOT / "build/fuzz/physics" / told.hexdigest()[:12]


def forwards(number: int) -> dict:
    """What came of a case in all drivers, as a line of the log."""
    case = make_case(number)
    differs, packed = differences(case)
    voxels, robots = case.bodies[0].voxel_count, len(case.bodies)
    lost = int((packed["status"] != "ok").sum())
    line = {"features": case.features, "voxels": voxels, "robots": robots, "diverged": lost, "differs": differs}
    return line | {"steps": int(packed["steps"].sum())}


def backwards(number: int) -> dict:
    """What came of the gradients of a case, as a line of the log."""
    case = make_case(number)
    return {"features": case.features, "directions": check_gradients(case)}


TASKS = {"forwards": forwards, "gradients": backwards}


def do(name: str, first: int, count: int, seconds: float) -> list[dict]:
    """The lines of all cases, those in the log and those still to do; no more once the time is over."""
    path = folder() / f"{name}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = complete_lines(path)
    keep_lines(path, len(whole))  # the last may be cut off
    lines = {line["case"]: line for line in map(json.loads, whole)}
    wanted, started, task = range(first, first + count), time.monotonic(), TASKS[name]
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
            print(f"{name}: {number - first + 1} of {count}", file=sys.stderr, flush=True)
    return [lines[number] for number in wanted if number in lines]


def report(bits: list[dict], gradients: list[dict]) -> list[str]:
    """What came of all cases, in lines for people and for docs/faults.md."""
    lines = []
    if bits:
        whole = [line for line in bits if "raised" not in line]
        robots, lost = (sum(line[key] for line in whole) for key in ("robots", "diverged"))
        steps = sum(line["steps"] for line in whole)
        lines += [f"{len(bits)} cases, {robots} robots of which {lost} diverged, {steps} steps of robots: "
                  f"{sum(_failed(line) for line in bits)} cases differ or fail.", "",
                  "| cases with | cases | differ or fail |", "| --- | ---: | ---: |"]  # fmt: skip
        counts = Counter(feature for line in bits for feature in line["features"])
        failed = Counter(feature for line in bits if _failed(line) for feature in line["features"])
        lines += [f"| {feature} | {count} | {failed[feature]} |" for feature, count in counts.most_common()]
        lines += [f"case {line['case']}: {line.get('raised') or line['differs']}" for line in bits if _failed(line)]
    return lines + (report_gradients(gradients) if gradients else [])


def _failed(line: dict) -> bool:
    return bool(line.get("raised") or line.get("differs"))


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
    found = ["", f"{len(lines)} cases with gradients, {lost} diverged; {len(every)} directions, {beyond} of them "
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
    parser.add_argument("--cases", type=int, default=1000, help="to compute in all drivers")
    parser.add_argument("--gradients", type=int, default=50, help="cases with gradients")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="for each of the two; then report")
    parser.add_argument("--case", type=int, help="compute this case only, and tell all")
    args = parser.parse_args()
    if args.case is not None:
        found = (backwards if args.case >= FIRST_GRADIENT else forwards)(args.case)
        print(json.dumps(found, indent=1))
        return 0
    gradients = do("gradients", FIRST_GRADIENT, args.gradients, args.seconds) if args.gradients else []
    bits = do("forwards", 0, args.cases, args.seconds) if args.cases else []
    print("\n".join(report(bits, gradients)), flush=True)
    odd = any(one.get("because", "").startswith("unexplained") or one.get("differs")
              for line in gradients for one in line.get("directions") or ())  # fmt: skip
    return int(odd or any(map(_failed, [*bits, *gradients])))


if __name__ == "__main__":
    raise SystemExit(main())
