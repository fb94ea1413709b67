"""Co-design by gradients beside hill climbing, at equal CPU time: the small robot on flat ground, from random gaits.

Every method designs orientation, pressure and a gait of two columns, on one thread, until it has used the same CPU
time; five seeds each. Only true, binary gaits count, judged by the same simulation. The runs are ordinary run folders
and resume where they were cut off; a larger ``--budget`` continues them.

    python benchmarks/gradient_codesign.py --out runs/gradients [--budget 300] [--seeds 0,1] [--plot curves.png]
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from optim.gait_problem import GaitProblem
from optim.runs import open_run, run_search
from optim.runs.environment import environment
from optim.search import build_method
from robots.terrain import Terrain

SEEDS = range(5)
METHODS: dict[str, dict[str, Any]] = {
    "hill climbing": {"name": "hill-climb", "climbers": 16},
    "exact gradient": {"name": "gradient", "climbers": 16, "learning_rate": 0.15, "verify": True, "stage": 4},
    "smoothed gradient": {
        "name": "gradient", "climbers": 2, "gradient": "smoothed", "samples": 4, "smoothing": 0.1,
        "learning_rate": 0.1, "verify": True, "stage": 10,
    },
}  # fmt: skip


def problem() -> GaitProblem:
    """What is designed."""
    return GaitProblem((Terrain(),), columns=2, repeats=1, encoding="bits", geometry="small", threads=1)


def run(name: str, seed: int, out: Path, budget: float) -> None:
    """One run, until its CPU time [s] is used up; the time of each generation is kept beside the run."""
    settings = METHODS[name] | {"seed": seed}
    designed = problem()
    method = settings.pop("name")
    config = {"problem": designed.describe(), "method": {"name": method, **settings}, "generations": 0}
    folder = out / f"{name.replace(' ', '-')}-{seed}"
    clock = folder / "cpu.jsonl"
    about = environment(device="cpu", precision="f32", threads=1, seed=seed)
    known = curve(folder)
    with open_run(folder, config, resume=True, environment=about) as opened:
        while not known or known[-1]["cpu"] < budget:
            begun = time.process_time()
            last = run_search(designed, build_method(method, designed.space, settings), opened, len(known))
            cpu = time.process_time() - begun + (known[-1]["cpu"] if known else 0.0)
            known.append({"cpu": cpu, "best": last.best, "mean": last.mean, "evaluations": last.evaluations})
            with clock.open("a") as file:
                file.write(json.dumps(known[-1]) + "\n")
    print(f"{folder.name}: {len(known)} generations, best {known[-1]['best']:.4f} BL/s", flush=True)


def curve(folder: Path) -> list[dict[str, float]]:
    """Generations of a run: CPU time [s] so far, best and mean speed of the climbers' best gaits [BL/s]."""
    clock = folder / "cpu.jsonl"
    return [json.loads(line) for line in clock.read_text().splitlines()] if clock.exists() else []


def table(out: Path, budget: float) -> str:
    """Medians over the seeds, and the best of each seed, as Markdown."""
    lines = [
        "| method | evaluations | mean of the climbers, start | end | best, start | end | best of each seed | wins |",
        "| --- | ---: | ---: | ---: | ---: | ---: | --- | ---: |",
    ]
    best = np.array([[_at(_curve(out, name, s), budget, "best") for s in SEEDS] for name in METHODS])
    for name, row in zip(METHODS, best, strict=True):
        curves = [_curve(out, name, seed) for seed in SEEDS]
        evaluations = np.median([_at(c, budget, "evaluations") for c in curves])
        first = {what: np.median([c[0][what] for c in curves]) for what in ("best", "mean")}
        mean = np.median([_at(c, budget, "mean") for c in curves])
        each, wins = ", ".join(f"{b:.3f}" for b in row), int((best.max(axis=0) == row).sum())
        lines.append(
            f"| {name} | {evaluations:.0f} | {first['mean']:.3f} | {mean:.3f} | {first['best']:.3f} | "
            f"{np.median(row):.3f} | {each} | {wins} |"
        )
    return "\n".join(lines)


def _curve(out: Path, name: str, seed: int) -> list[dict[str, float]]:
    return curve(out / f"{name.replace(' ', '-')}-{seed}")


def _at(points: list[dict[str, float]], cpu: float, what: str) -> float:
    """The last value known at a CPU time."""
    known = [p[what] for p in points if p["cpu"] <= cpu]
    return known[-1] if known else np.nan


def save_plot(out: Path, budget: float, path: Path) -> None:
    """Best speed, and mean over the climbers, over CPU time: a thin line for each seed, a thick one for the median."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    times = np.linspace(0, budget, 200)
    for axes, what in zip(figure.subplots(1, 2), ("best", "mean"), strict=True):
        for number, name in enumerate(METHODS):
            rows = np.array([[_at(_curve(out, name, seed), t, what) for t in times] for seed in SEEDS])
            axes.plot(times, rows.T, color=f"C{number}", linewidth=0.6, alpha=0.5)
            axes.plot(times, np.median(rows, axis=0), color=f"C{number}", linewidth=2.2, label=name)
        axes.set_title({"best": "best gait so far", "mean": "mean of the climbers' best gaits"}[what], fontsize=10)
        axes.set_xlabel("CPU time [s]")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("speed [body lengths/s]")
    figure.axes[1].legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Run what is missing; then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--budget", type=float, default=300.0, help="CPU time of each run [s] (default: 300)")
    parser.add_argument("--seeds", default="0,1,2,3,4", help="which to run (default: all)")
    parser.add_argument("--plot", type=Path, help="file for the curves")
    args = parser.parse_args()
    for seed in [int(s) for s in args.seeds.split(",") if s]:
        for name in METHODS:
            run(name, seed, args.out, args.budget)
    if all(_curve(args.out, name, seed) for name in METHODS for seed in SEEDS):
        print(table(args.out, args.budget))
        if args.plot:
            save_plot(args.out, args.budget, args.plot)


if __name__ == "__main__":
    main()
