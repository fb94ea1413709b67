"""``morpholab track``: what runs logged, for TensorBoard, Weights & Biases, MLflow or a table."""

import argparse
from collections.abc import Callable
from typing import Any

from optim.commands import Report, options
from optim.commands.options import Command, Option, path_to
from taichi_sim.base.short_text import counted

COMMAND = Command(
    "track",
    "give what runs logged to TensorBoard, Weights & Biases, MLflow or a Parquet table",
    "Give what runs logged to trackers: scores, evaluations, times and details of the best design by generation. Runs "
    "may go on meanwhile; the same command again adds what is new.",
    (
        options.RUNS,
        path_to("tensorboard", "DIR", "folder of event files, one for each run"),
        path_to("parquet", "FILE", "one table of all runs, to write or replace"),
        Option("wandb", "project of Weights & Biases; its own variables say where and who", metavar="PROJECT"),
        Option("mlflow", "a server, or a file as sqlite:///FILE.db; the experiment is morpholab", metavar="URI"),
    ),
)
WAYS = "tensorboard", "parquet", "wandb", "mlflow"


def run(args: argparse.Namespace) -> Report:
    """Send what was asked for."""
    from optim.runs import trackers
    from optim.runs.history import read_histories, runs_below

    wanted = [name for name in WAYS if getattr(args, name) is not None]
    if not wanted:
        raise ValueError(f"track: no tracker is given; give {', '.join('--' + name for name in WAYS[:-1])} or --mlflow")
    histories, damaged = read_histories(runs_below(args.runs), lambda history: history)
    if damaged and args.parquet is not None and args.parquet.exists():
        raise ValueError(f"parquet: {args.parquet} keeps what it has while a run cannot be read: {damaged[0]}")
    runs = trackers.labels(histories)
    send: dict[str, Callable[[Any, Any], None]] = {
        "tensorboard": trackers.to_tensorboard,
        "parquet": trackers.to_parquet,
        "wandb": trackers.to_wandb,
        "mlflow": trackers.to_mlflow,
    }
    for name in wanted:
        send[name](runs, getattr(args, name))
    generations = sum(len(history.generations) for history in runs.values())
    where = {name: str(getattr(args, name)) for name in wanted}
    told = ", ".join(f"{name} {place}" for name, place in where.items())
    text = f"{counted(len(runs), 'run')}, {counted(generations, 'generation')}: {told}"
    return Report({"runs": list(runs), "generations": generations, **where}, text).but_for(damaged)
