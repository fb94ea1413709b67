"""Export the logs of runs to experiment trackers: TensorBoard, Weights & Biases, MLflow; and to Parquet tables.

Everything is read from the log, so runs can be exported again after they continued; what a tracker already has is
left unchanged.
"""

import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.runs.config import identity, score_in
from optim.runs.history import History
from taichi_sim.base.files import make_folder, read_bytes, write_bytes
from taichi_sim.base.foreign import needing, said_by

EVENTS = "events.out.tfevents.0.morpholab"
MLFLOW_AT_ONCE = 1000  # metrics of a request
MLFLOW_TAG = "morpholab.run"


def scalars(history: History) -> Iterator[tuple[int, float, dict[str, float]]]:
    """For each generation of a run, its number, the seconds since the start, and all finite numbers by name.

    Generations of unknown duration count as 0 s.
    """
    seconds = np.nan_to_num(np.array(history.seconds, float)).cumsum()
    for number, each in enumerate(history.generations):
        found: dict[str, Any] = {
            "evaluations": each.evaluations,
            "failed": each.failed,
            "best": each.best,
            "mean": each.mean,
            "median": each.median,
            **each.numbers,
            **{f"best/{name}": value for name, value in (each.best_details or {}).items()},
        }
        told = {name: float(v) for name, v in found.items() if isinstance(v, int | float) and math.isfinite(v)}
        yield each.generation, float(seconds[number]) if number < len(seconds) else 0.0, told


def settings(history: History) -> dict[str, Any]:
    """Settings of a run (method, seed, score, problem) as a flat dictionary of hyperparameters."""
    problem, method = history.config["problem"], history.config["method"]
    flat = {f"problem.{name}": value for name, value in problem.items() if isinstance(value, str | int | float | bool)}
    return {
        **{f"method.{name}": _plain(value) for name, value in method.items()},
        **flat,
        "score": score_in(history.config).label,
    }


def key_of(history: History) -> str:
    """Identifier of a run that does not change when its folder is moved or the run continues."""
    return hashlib.sha256(json.dumps(identity(history.config), sort_keys=True).encode()).hexdigest()[:16]


def to_tensorboard(runs: Mapping[str, History], folder: Path) -> None:
    """Write a folder of events for each run, by label; when a log has grown, its file only gains bytes at the end.

    Raises:
        ValueError: if tensorboard is missing, or the folder cannot be written.
    """
    with needing("tensorboard", "it", "trackers"):
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.compat.proto.summary_pb2 import Summary
        from tensorboard.summary.writer.record_writer import RecordWriter
    for label, history in runs.items():
        content = io.BytesIO()
        writer = RecordWriter(content)
        writer.write(Event(file_version="brain.Event:2", wall_time=0.0).SerializeToString())
        for step, seconds, found in scalars(history):
            values = [Summary.Value(tag=name, simple_value=value) for name, value in found.items()]
            event = Event(step=step, wall_time=seconds, summary=Summary(value=values))
            writer.write(event.SerializeToString(deterministic=True))
        make_folder(folder / label)
        write_bytes(folder / label / EVENTS, content.getvalue())


def to_parquet(runs: Mapping[str, History], path: Path) -> None:
    """Write one table with a row for each generation of each run, replacing an older table.

    Raises:
        ValueError: if pandas or pyarrow is missing, another kind of file is there, or it cannot be written.
    """
    with needing("parquet", "pandas or pyarrow", "trackers"):
        import pandas
        import pyarrow  # noqa: F401 - what pandas writes it with
    if path.exists() and not read_bytes(path).startswith(b"PAR1"):
        raise ValueError(f"parquet: {path} is there and is no table of Parquet; give another name")
    rows = [
        {
            "run": label,
            "method": history.config["method"]["name"],
            "seed": history.config["method"].get("seed"),
            "generation": step,
        }
        | {"seconds": seconds, **found}
        for label, history in runs.items()
        for step, seconds, found in scalars(history)
    ]
    content = io.BytesIO()
    pandas.DataFrame(rows).to_parquet(content, index=False)
    write_bytes(path, content.getvalue())


def to_wandb(runs: Mapping[str, History], project: str) -> None:
    """Send runs to a project of Weights & Biases; generations that it already has are not sent again.

    Raises:
        ValueError: if wandb is missing.
    """
    with needing("wandb", "it", "trackers"):
        import wandb
    for label, history in runs.items():
        run: Any = wandb.init(project=project, id=key_of(history), name=label, resume="allow", config=settings(history))
        known = int(run.step or 0)  # the step that would come next
        for step, seconds, found in scalars(history):
            if step >= known:
                run.log({**found, "seconds": seconds}, step=step)
        run.finish()


def to_mlflow(runs: Mapping[str, History], address: str) -> None:
    """Send runs to the experiment ``morpholab`` of an MLflow server or database; only generations that it lacks.

    Raises:
        ValueError: if mlflow is missing, or refuses the address or what is sent.
    """
    with needing("mlflow", "it", "trackers"):
        from mlflow import MlflowClient
        from mlflow.exceptions import MlflowException
    try:
        _send_to_mlflow(runs, MlflowClient(tracking_uri=address))
    except MlflowException as error:
        raise ValueError(f"mlflow: {address!r} does not take it: {said_by(error)}") from None


def _send_to_mlflow(runs: Mapping[str, History], client: Any) -> None:
    """Send runs by a client of MLflow."""
    from mlflow.entities import Metric, Param

    known = client.get_experiment_by_name("morpholab")
    experiment = known.experiment_id if known else client.create_experiment("morpholab")
    for label, history in runs.items():
        same = client.search_runs([experiment], filter_string=f"tags.`{MLFLOW_TAG}` = '{key_of(history)}'")
        if same:
            run = same[0].info.run_id
        else:
            run = client.create_run(experiment, tags={MLFLOW_TAG: key_of(history), "mlflow.runName": label}).info.run_id
            client.log_batch(run, params=[Param(name, str(value)[:500]) for name, value in settings(history).items()])
        last = max((each.step for each in client.get_metric_history(run, "evaluations")), default=-1)
        new = [
            Metric(name.replace("=", "_"), value, round(1000 * seconds), step)
            for step, seconds, found in scalars(history)
            for name, value in sorted(found.items(), key=lambda item: item[0] == "evaluations")  # it says what is whole
            if step > last
        ]
        for first in range(0, len(new), MLFLOW_AT_ONCE):
            client.log_batch(run, metrics=new[first : first + MLFLOW_AT_ONCE])
        if history.state == "finished":
            client.set_terminated(run)


def labels(histories: Sequence[History]) -> dict[str, History]:
    """Runs by the names of their folders, with as much of the path as distinguishes them.

    Raises:
        ValueError: if one is given twice.
    """
    paths = [history.path.resolve() for history in histories]
    for count in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["-".join(path.parts[-count:]).replace("/", "") for path in paths]
        if len(set(names)) == len(names):
            return dict(zip(names, histories, strict=True))
    raise ValueError(f"run: {next(str(path) for path in paths if paths.count(path) > 1)} is given twice")


def _plain(value: Any) -> Any:
    """A setting as trackers take it."""
    return value if isinstance(value, str | int | float | bool) or value is None else json.dumps(value)
