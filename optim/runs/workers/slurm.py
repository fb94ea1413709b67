"""An array job of Slurm whose tasks are workers of a shared folder."""

import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from taichi_sim.base.files import make_folder, write_text

SCRIPT, LOGS = "workers.sbatch", "logs"
_PATIENCE = 60.0  # s for sbatch to answer


def check_options(options: Sequence[str]) -> None:
    """Raise ValueError unless these are options of sbatch, such as ``--partition=x``, one line each."""
    for option in options:
        if not option.startswith("-") or "\n" in option:
            raise ValueError(
                f'slurm-option: {option!r} is not allowed; give an option of sbatch, as in "--partition=x"'
            )


def job_script(folder: Path, tasks: int, options: Sequence[str] = (), problem: Path | None = None) -> str:
    """The script of an array job.

    Args:
        folder: of the workers; absolute in the script.
        tasks: number of workers.
        options: of sbatch, which come after those written here, so they win.
        problem: file of the problem, which workers need to be given.
    """
    folder = folder.absolute()
    work = [sys.executable, "-m", "morpholab", "work", str(folder)]
    work += ["--problem", str(problem.absolute())] if problem else []
    lines = [
        "#!/bin/bash",
        "#SBATCH --job-name=morpholab-workers",
        f"#SBATCH --array=0-{tasks - 1}",
        f"#SBATCH --chdir={_quoted(Path.cwd())}",
        f"#SBATCH --output={_quoted(folder / LOGS)}/%A_%a.txt",
        *(f"#SBATCH {option}" for option in options),
        "# A worker ends with the search; one that is killed is replaced by whoever is left.",
        f'exec {shlex.join(work)} --threads "${{SLURM_CPUS_PER_TASK:-1}}"',
    ]
    return "\n".join(lines) + "\n"


def submit_workers(folder: Path, tasks: int, options: Sequence[str] = (), problem: Path | None = None) -> str:
    """Write the script of an array job into the folder of its workers, and submit it; one line about what was done.

    Raises:
        ValueError: if the script cannot be written.
        RuntimeError: if sbatch refuses it.
    """
    script = folder / SCRIPT
    make_folder(folder / LOGS)
    write_text(script, job_script(folder, tasks, options, problem))
    if shutil.which("sbatch") is None:
        return f"slurm: there is no sbatch on this machine; submit {script} where there is one"
    try:
        done = subprocess.run(["sbatch", str(script)], capture_output=True, text=True, timeout=_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"slurm: sbatch has not answered for {_PATIENCE:g} s; {script} is not submitted") from None
    if done.returncode:
        reason = " ".join(done.stderr.split()) or f"exit code {done.returncode}"
        raise RuntimeError(f"slurm: sbatch refused {script} ({reason})")
    return f"slurm: {' '.join(done.stdout.split())}, {tasks} workers ({script})"


def _quoted(path: Path) -> str:
    """A path as lines of options take it."""
    text = str(path)
    return f'"{text}"' if " " in text else text
