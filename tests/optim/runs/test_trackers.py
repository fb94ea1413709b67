"""What runs logged, for trackers."""

import json
import sys
from types import ModuleType, SimpleNamespace

import pytest

PROBLEM = """
bounds = {"x": (0.0, 1.0), "y": (0.0, 1.0)}


def evaluate(points):
    return -((points - 0.3) ** 2).sum(axis=1)
"""


@pytest.fixture
def searched(morpholab, tmp_path):
    """Makes a run of so many generations, or lets it go on."""
    (tmp_path / "own.py").write_text(PROBLEM)

    def search(folder, generations):
        how = "--resume" if (tmp_path / folder).exists() else "--method random --climbers 4"
        code, _, error = morpholab(
            f"codesign {how} --problem own.py --generations {generations} --out {folder} --quiet --threads 1"
        )
        assert code == 0, error
        return [json.loads(line) for line in (tmp_path / folder / "log.jsonl").read_text().splitlines()]

    return search


def test_tensorboard_reads_every_generation_once(morpholab, searched, tmp_path):
    """Also after a run went on; then the file begins as before."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    searched("a", 2)
    assert morpholab("track a --tensorboard events")[0] == 0
    (file,) = (tmp_path / "events/a").iterdir()
    before = file.read_bytes()
    log = searched("a", 4)
    code, out, _ = morpholab("track a --tensorboard events --json")
    assert code == 0 and json.loads(out) == {"runs": ["a"], "generations": 5, "tensorboard": "events"}
    assert file.read_bytes().startswith(before[: len(before) // 2])
    read = accumulator.EventAccumulator(str(file.parent))
    read.Reload()
    assert [(each.step, each.value) for each in read.Scalars("best")] == [
        (each["generation"], pytest.approx(each["best"])) for each in log
    ]
    assert [each.value for each in read.Scalars("evaluations")] == [4, 8, 12, 16, 20]


def test_a_table_has_a_row_for_each_generation_of_each_run(morpholab, searched, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    (tmp_path / "b").mkdir()
    logs = {"a": searched("a", 2), "b-a": searched("b/a", 1)}
    assert morpholab("track a b/a --parquet runs.parquet")[0] == 0
    table = pandas.read_parquet(tmp_path / "runs.parquet")
    assert len(table) == 5 and set(table["run"]) == {f"{tmp_path.name}-a", "b-a"}
    assert table[table["run"] == "b-a"]["best"].tolist() == [each["best"] for each in logs["b-a"]]
    assert (table["method"] == "random").all()
    assert morpholab("track a --parquet runs.parquet")[0] == 0
    code, _, err = morpholab("track a --parquet a/log.jsonl")
    assert code == 2 and "parquet: a/log.jsonl is there and is no table of Parquet; give another name" in err


def test_weights_and_biases_gets_what_it_does_not_have(morpholab, searched, monkeypatch):
    """The same run under the same name, from the step that it wants next."""
    sent, begun = [], []

    def init(**given):
        begun.append(given)
        return SimpleNamespace(
            step=len(sent), log=lambda row, step: sent.append((step, row["best"])), finish=lambda: None
        )

    fake = ModuleType("wandb")
    fake.init = init
    monkeypatch.setitem(sys.modules, "wandb", fake)
    searched("a", 2)
    assert morpholab("track a --wandb robots")[0] == 0
    log = searched("a", 4)
    assert morpholab("track a --wandb robots")[0] == 0
    assert sent == [(each["generation"], each["best"]) for each in log]
    assert begun[0]["id"] == begun[1]["id"] and begun[0]["config"]["method.name"] == "random"


class FakeMlflow:
    """Keeps what a client of MLflow sends, and refuses folders as MLflow 3 does."""

    def __init__(self):
        self.metrics, self.tags = [], None
        self.modules = {name: ModuleType(name) for name in ("mlflow", "mlflow.entities", "mlflow.exceptions")}
        self.modules["mlflow.exceptions"].MlflowException = type("MlflowException", (Exception,), {})
        self.modules["mlflow.entities"].Metric = lambda key, value, timestamp, step: SimpleNamespace(**locals())
        self.modules["mlflow.entities"].Param = lambda key, value: SimpleNamespace(key=key, value=value)
        self.modules["mlflow"].MlflowClient = self._client

    def _client(self, tracking_uri):
        if tracking_uri.startswith("file:"):
            raise self.modules["mlflow.exceptions"].MlflowException("folders are\nno longer taken")
        return self

    def get_experiment_by_name(self, name):
        return SimpleNamespace(experiment_id=name)

    def search_runs(self, experiments, filter_string):
        found = self.tags and filter_string.endswith(f"'{self.tags['morpholab.run']}'")
        return [SimpleNamespace(info=SimpleNamespace(run_id="r"))] if found else []

    def create_run(self, experiment, tags):
        self.tags = tags
        return SimpleNamespace(info=SimpleNamespace(run_id="r"))

    def log_batch(self, run, params=(), metrics=()):
        self.metrics += metrics

    def get_metric_history(self, run, key):
        return [each for each in self.metrics if each.key == key]

    def set_terminated(self, run):
        pass


def test_mlflow_gets_what_it_does_not_have(morpholab, searched, monkeypatch):
    """Each generation once, though runs go on; what MLflow refuses is told in its words."""
    fake = FakeMlflow()
    for name, module in fake.modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    searched("a", 2)
    assert morpholab("track a --mlflow sqlite:///runs.db")[0] == 0
    log = searched("a", 4)
    assert morpholab("track a --mlflow sqlite:///runs.db")[0] == 0
    sent = [(each.step, each.value) for each in fake.metrics if each.key == "best"]
    assert sent == [(each["generation"], each["best"]) for each in log]
    code, _, error = morpholab("track a --mlflow file:runs")
    assert code == 2 and "mlflow: 'file:runs' does not take it: folders are no longer taken" in error


def test_bad_input(morpholab, searched, monkeypatch):
    searched("a", 1)
    for line, told in (
        ("track a", "track: no tracker is given; give --tensorboard, --parquet, --wandb or --mlflow"),
        ("track none --parquet a.parquet", "run: none does not exist"),
        ("track a --wandb robots", "wandb: it is missing; install the extra trackers"),
        ("track a --mlflow sqlite:///x.db", "mlflow: it is missing; install the extra trackers"),
        ("track a --tensorboard own.py", "out: own.py/a cannot be made"),
    ):
        for name in ("wandb", "mlflow"):
            monkeypatch.setitem(sys.modules, name, None)
        code, out, error = morpholab(line)
        assert (code, out) == (2, "") and told in error and error.count("\n") == 1, error


def test_maps_of_elites_are_compared(morpholab, searched, tmp_path):
    """By the QD score and the share of cells, with intervals over seeds."""
    searched("plain", 1)
    for seed in range(2):
        how = f"--method map-elites --population 6 --set bins=4 --seed {seed} --out map-{seed}"
        assert morpholab(f"codesign {how} --problem own.py --generations 3 --quiet --threads 1")[0] == 0
    code, out, _ = morpholab("compare map-0 map-1 plain --json")
    assert code == 0
    shown = json.loads(out)["maps"]
    assert [(one["label"], one["name"], one["runs"]) for one in shown] == [
        ("map-elites", "qd_score", 2),
        ("map-elites", "coverage", 2),
    ]
    logs = [json.loads((tmp_path / f"map-{n}/log.jsonl").read_text().splitlines()[0]) for n in range(2)]
    covered = [log["numbers"]["coverage"] for log in logs]  # the other run ended after 8 evaluations
    assert shown[1]["mean"] == pytest.approx(sum(covered) / 2)
    text = morpholab("compare map-0 map-1")[1]
    assert "maps of elites after 24 evaluations: mean over runs" in text and "  map-elites, QD score (2 runs): " in text
