"""Readers of files under random bytes: each gives a description, or one line that says what is wrong."""

import json
import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optim.experiments.tables import read_records
from optim.pipeline.task import read_task
from optim.runs import checkpoint
from optim.runs.config import CONFIG, SEAL, identity, read_config
from optim.runs.folder import TIMING
from optim.runs.generation import Generation
from optim.runs.history import read_history, read_progress
from optim.runs.products import PRODUCTS, known_products
from optim.runs.robust import ROBUST_FILE, checked_robust
from optim.search import build_method
from optim.space import Space, Variable
from robots.calibration import load_calibration
from robots.calibration.measurements import read_measurements
from robots.control.neural import load_weights
from robots.ground import Ground
from robots.hardware import PneumaticRig
from robots.hardware.stream import read_any_table
from robots.inflatable.design import load_design as load_gait
from robots.lattice_robot.record import load_saved_robot
from robots.tasks import find_task
from taichi_sim.base import files, line_files
from taichi_sim.base.results_folder import ResultsFolder, read_settings
from taichi_sim.lattice import Material
from taichi_sim.lattice.files import load_voxel_file
from taichi_sim.lattice.files.mesh import body_from_mesh
from taichi_sim.rigid.model.files import load_model
from taichi_sim.rigid.model.resizing import resized_text

LARGEST = 20_000  # bytes of an input; what is larger only takes longer
SETTINGS = 'format = 1\ngenerations = 2\n\n[problem]\nkind = "x"\n\n[method]\nname = "cma"\n'
LINE = Generation(0, 4, 0, 1.0, 0.5, 0.5, [1.0, None], {"a": 1.0}, {"speed": 1.0}, {"spread": 0.1}).to_json()
TIME = '{"generation": 0, "seconds": 0.5, "finished": "2026-01-02T03:04:05+0000"}'
ROOT = Path(__file__).resolve().parents[2]
CORPUS = Path(__file__).parent / "corpus"


@dataclass(frozen=True)
class Target:
    """A reader of one kind of file.

    Attributes:
        file: name that its input gets.
        read: reads the file at a path; raises ValueError or OSError for what it refuses.
        seeds: files of the repository that it reads, as patterns of ``Path.glob``.
        seal: what comes after the bytes, so that they pass a checksum.
    """

    file: str
    read: Callable[[Path], object]
    seeds: tuple[str, ...] = ()
    seal: Callable[[bytes], bytes] = bytes


def _mesh(path: Path) -> object:
    """Coarse voxels: the mesh of a file may be as large as it likes, but not its body."""
    return body_from_mesh(path, 0.5, Material(1e6, 1e3), most_voxels=20_000, most_memory=1e8)


def _heights(path: Path) -> object:
    return Ground(f"{path}:0.1" if path.suffix == ".npy" else f"{path}:0.1,0.1").relief(0, 0.05)


def _rigid(path: Path) -> object:
    """A robot, and its file with bodies of another size, on hinges of another stiffness."""
    model = load_model(path)
    heavy = [body.mass > 0 for body, _ in model.tree.ordered]
    actuation = ([factor] * len(heavy) for factor in (1.7, 0.6))  # stiffness and torques of hinges
    return model, resized_text(files.read_text(path), [0.7 if each else 1.0 for each in heavy], *actuation)


def _weights(path: Path) -> object:
    return load_weights(path, 2, 2)


def _measurements(path: Path) -> object:
    return read_measurements(path, load_gait)


def _config(path: Path) -> object:
    return identity(read_config(path.parent))


def _history(path: Path) -> object:
    """A run whose checkpoint has the right checksums of whatever log and times it has."""
    folder = path.parent
    for name, content in ((CONFIG, _sealed(SETTINGS.encode())), (checkpoint.LOG, f"{LINE}\n".encode())):
        if path.name != name:
            (folder / name).write_bytes(content)
    sums = {name: files.sha256(b"".join(line_files.complete_lines(folder / name))) for name in (checkpoint.LOG, TIMING)}
    record = checkpoint.Record(
        len(line_files.complete_lines(folder / checkpoint.LOG)),
        sums[checkpoint.LOG],
        sums[TIMING],
        "",
        identity(read_config(folder)),
    )
    own = {"run/record": np.frombuffer(json.dumps(record.__dict__).encode(), np.uint8)}
    (folder / checkpoint.CHECKPOINT).write_bytes(files.pack(own))
    progress = read_history(folder).progress
    assert repr(read_progress(folder)) == repr(progress)
    return progress.pace, progress.seconds_left


def _robust(path: Path) -> object:
    return checked_robust(path.parent)


def _products(path: Path) -> object:
    return known_products(path.parent)


def _state(path: Path) -> object:
    method = build_method("hill-climb", Space((Variable("x", -1.0, 1.0, step=0.1),)), {"climbers": 2})
    return checkpoint.restore(path.parent, method, files.unpack(path.read_bytes()))


def _study(path: Path) -> object:
    return read_settings(path.parent, "study")


def _package(path: Path) -> object:
    return files.unpack(path.read_bytes())


def _part(path: Path) -> object:
    (path.parent / "study.json").write_text(json.dumps({"format": "morpholab-study-1"}, indent=2) + "\n")
    return list(ResultsFolder(path.parent, "study", {}).load("part"))


def _sealed(content: bytes) -> bytes:
    return content + SEAL.encode() + files.sha256(content).encode() + b"\n"


def _with_digest(content: bytes) -> bytes:
    return content + files.sha256(content).encode()


TARGETS = {
    "vxa": Target("robot.vxa", load_voxel_file, ("examples/*.vxa",)),
    "vxd": Target("robot.vxd", load_voxel_file),
    "vxl-json": Target("robot.vxl.json", load_voxel_file),
    "rigid": Target("robot.xml", _rigid),
    "stl": Target("mesh.stl", _mesh),
    "glb": Target("mesh.glb", _mesh),
    "heights-npy": Target("heights.npy", _heights),
    "heights-png": Target("heights.png", _heights),
    "gait-table": Target("gait.csv", read_any_table, ("tests/data/v1_files/*.csv",)),
    "gait-json": Target("gait.json", load_gait, ("tests/data/v1_files/*.json", "docs/gaits/*.json")),
    "robot-json": Target("robot.json", load_saved_robot, ("tests/data/v1_files/block.json",)),
    "weights-json": Target("weights.json", _weights),
    "weights-npy": Target("weights.npy", _weights),
    "task": Target("task.toml", find_task, ("robots/tasks.toml", "examples/pipeline/*.toml")),
    "pipeline-task": Target("task.toml", read_task),
    "rig": Target("rig.toml", PneumaticRig.load),
    "measurements": Target("measured.toml", _measurements),
    "run-config": Target(CONFIG, _config, seal=_sealed),
    "run-log": Target(checkpoint.LOG, _history),
    "run-timing": Target(TIMING, _history),
    "run-robust": Target(ROBUST_FILE, _robust),
    "run-products": Target(PRODUCTS, _products, ("tests/data/v1_runs/*/products.json",)),
    "run-state": Target("state.npz", _state, seal=_with_digest),
    "calibration": Target("calibration.json", load_calibration, ("tests/data/v1_files/calibration.json",)),
    "table": Target("table.csv", read_records, ("tests/data/v1_files/sweep/table.csv", "docs/data/bench-history.csv")),
    "study-settings": Target("study.json", _study),
    "package": Target("package.npz", _package, seal=_with_digest),
    "study-part": Target("part-0.npz", _part),
}


def attack(name: str, content: bytes, root: Path | None = None) -> bool:
    """Give bytes to a reader; whether it took them.

    Raises:
        AssertionError: if it refuses them with more than one line, or with nothing.
        Exception: whatever else it raises, which is a bug.
    """
    target = TARGETS[name]
    with tempfile.TemporaryDirectory(dir=root) as folder, warnings.catch_warnings(action="ignore"):
        if name == "vxd":
            (Path(folder) / "base.vxa").write_bytes((ROOT / "examples/voxel_walker.vxa").read_bytes())
        (Path(folder) / target.file).write_bytes(target.seal(content[:LARGEST]))
        try:
            target.read(Path(folder) / target.file)
        except (ValueError, OSError) as error:
            message = files.why_unread(error) if isinstance(error, OSError) else str(error)
            assert message and "\n" not in message, message
            return False
    return True


def seeds(name: str) -> list[bytes]:
    """Inputs that a target begins with: its corpus, and the files of the repository that it reads."""
    kept = sorted((CORPUS / name).glob("*"))
    return [
        path.read_bytes() for path in [*kept, *(p for each in TARGETS[name].seeds for p in sorted(ROOT.glob(each)))]
    ]


def room() -> Path:
    """A folder in memory, if there is one: fuzzing writes thousands of files a second."""
    memory = Path("/dev/shm")
    return memory if os.access(memory, os.W_OK) else Path(tempfile.gettempdir())
