"""The two trees: getting the old one, running the probe in either, and keeping what the old one gave."""

import hashlib
import os
import platform
import subprocess
import sys
import tarfile
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CACHE = ROOT / ".same-bits"
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


def reference_tree(commit: str) -> Path:
    """A folder with the files of a commit; taken out of the repository once.

    Raises:
        ValueError: in one line, if the repository does not have it.
    """
    folder = CACHE / commit
    if folder.is_dir():
        return folder
    CACHE.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=CACHE) as aside:
        archive = Path(aside) / "tree.tar"
        command = ["git", "-C", str(ROOT), "archive", "--format=tar", f"--output={archive}", commit]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ValueError(f"commit {commit}: not in this repository ({done.stderr.strip().splitlines()[-1]})")
        tree = Path(aside) / "tree"
        with tarfile.open(archive) as packed:
            packed.extractall(tree, filter="data")
        tree.rename(folder)
    return folder


def results_folder(commit: str, computing: str) -> Path:
    """Where results of the old tree are kept: for the same commit, the same cases, and the same machine."""
    folder = CACHE / f"results-{commit}-{computing}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def fingerprint() -> str:
    """What results may depend on beside a tree: the cases, the processor, and the libraries."""
    digest = hashlib.sha256()
    for path in sorted(HERE.glob("*.py")):
        if path.name.startswith(("case", "probe")):
            digest.update(path.read_bytes())
    digest.update(_processor().encode())
    digest.update(f"{platform.python_version()} {np.__version__}".encode())
    for package in ("taichi", "scipy", "cmaes", "pymoo"):
        digest.update(f"{package} {_version(package)}".encode())
    return digest.hexdigest()[:12]


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


def _processor() -> str:
    """Model and instructions of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


def run_probe(tree: Path, inputs: Path, folder: Path, names: list[str]) -> int:
    """Compute cases in a tree in a process of their own; its exit code."""
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(tree)}
    command = [sys.executable, str(HERE / "probe.py"), str(tree), str(inputs), str(folder), *names]
    return subprocess.run(command, env=environment, stdout=sys.stderr, check=False).returncode


def load(path: Path) -> dict[str, np.ndarray] | None:
    """The arrays of a case; None if there are none."""
    if not path.is_file():
        return None
    with np.load(path) as arrays:
        return dict(arrays)
