"""Fuzz the readers of files, guided by coverage: ``make fuzz``, or ``python tests/fuzz/fuzz.py --seconds 300 vxa``.

What a reader may not do - raise anything but one line, take a gigabyte, or hang - ends its target, and leaves the input
in ``build/fuzz/NAME/``. Add it to ``tests/fuzz/corpus/NAME/`` with the mended cause. What was tried by time is a row of
``docs/data/fuzzing.csv``, whose sums are in ``docs/faults.md``; ``--runs`` gives the same inputs each time, so it adds
none.
"""

import argparse
import hashlib
import io
import os
import re
import sys
import tempfile
import time
from contextlib import ExitStack, redirect_stderr, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import fuzz_log  # noqa: E402  it lies beside this script

# MB, and s of CPU time of one input, which on a busy machine may take many times that.
MEMORY, PATIENCE, HANGS = 1000, 5, 60


def instrumented_targets() -> ModuleType:
    """The targets, imported so that atheris sees which lines of them, and of what they read with, are run.

    Readers import some of it when they first read; this is done here, as it would take long within an input's time.
    """
    import atheris

    packages = ["taichi_sim", "robots", "optim", "fuzz_targets"]
    with redirect_stderr(io.StringIO()), atheris.instrument_imports(include=packages):  # it tells of each module
        import fuzz_targets

        for name in fuzz_targets.TARGETS:
            for content in fuzz_targets.seeds(name):
                with suppress(Exception):  # what is wrong is found, and told, by fuzzing
                    fuzz_targets.attack(name, content, fuzz_targets.room())
    return fuzz_targets


def fuzz(targets: ModuleType, name: str, corpus: Path, options: list[str]) -> None:
    """Fuzz one target in this process; never returns."""
    import atheris

    folder = ROOT / "build/fuzz" / name
    folder.mkdir(parents=True, exist_ok=True)
    corpus.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(targets.seeds(name)):
        (corpus / f"seed-{number}").write_bytes(content[: targets.LARGEST])
    options = [*options, f"-rss_limit_mb={MEMORY}", f"-timeout={HANGS}", f"-max_len={targets.LARGEST}"]
    options += [f"-artifact_prefix={folder}/", "-print_final_stats=1", "-verbosity=0"]

    def attack(content: bytes) -> None:
        begun = time.process_time()
        try:
            targets.attack(name, content, targets.room())
            if (seconds := time.process_time() - begun) > PATIENCE:
                raise TimeoutError(f"it takes {seconds:.1f} s of CPU time, more than {PATIENCE}")
        except Exception:  # libFuzzer keeps what hangs or takes too much, but not this
            found = folder / f"crash-{hashlib.sha256(content).hexdigest()[:16]}"
            found.write_bytes(content)
            print(f"the input is {found}", flush=True)
            raise

    atheris.Setup([sys.argv[0], *options, str(corpus)], attack)
    atheris.Fuzz()


@dataclass(frozen=True)
class Outcome:
    """What came of fuzzing a target in a process of its own.

    Attributes:
        code: exit code of the process.
        said: what it wrote.
        cpu_seconds: that it took.
        memory: the most that it took, in MB as libFuzzer counts them.
    """

    code: int
    said: str
    cpu_seconds: float
    memory: float

    @property
    def inputs(self) -> str:
        """How many inputs the target got; empty where the process did not live to tell."""
        return next(iter(re.findall(r"number_of_executed_units:\s*(\d+)", self.said)), "")

    @property
    def failure(self) -> str:
        """Why the target ended early: timeout, memory or crash; empty where it did not."""
        if self.code == 0:
            return ""
        kinds = {"ERROR: libFuzzer: timeout": "timeout", "TimeoutError: ": "timeout", "out-of-memory": "memory"}
        return next((kind for told, kind in kinds.items() if told in self.said), "crash")

    def row(self, name: str) -> dict[str, object]:
        """A row of the table of all fuzzing."""
        told = (f"{datetime.now(UTC):%Y-%m-%d}", fuzz_log.commit(), name, self.inputs)
        measured = (f"{self.cpu_seconds:.1f}", f"{self.memory:.0f}", self.failure)
        return dict(zip(fuzz_log.COLUMNS, told + measured, strict=True))


def fuzz_apart(targets: ModuleType, name: str, corpus: Path, options: list[str]) -> Outcome:
    """Fuzz one target in a copy of this process, which has all imports already."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if not child:
            for stream in (1, 2):
                os.dup2(said.fileno(), stream)
            try:
                fuzz(targets, name, corpus, options)
            finally:
                os._exit(1)
        _, status, used = os.wait4(child, 0)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return Outcome(os.waitstatus_to_exitcode(status), text, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def fuzz_one(targets: ModuleType, name: str, args: argparse.Namespace, seed: int) -> Outcome:
    """Fuzz one target for so long, from all that was found before, or with so many inputs, from what is kept."""
    with ExitStack() as held:
        options, corpus = [f"-max_total_time={args.seconds}"], ROOT / "build/fuzz" / name / "corpus"
        if args.runs is not None:  # they do not depend on what was found before
            options = [f"-runs={args.runs}"]
            corpus = Path(held.enter_context(tempfile.TemporaryDirectory()))
        return fuzz_apart(targets, name, corpus, [*options, f"-seed={seed}"])


def arguments() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names of targets; all by default")
    parser.add_argument("--seconds", type=int, default=120, help="for each target (default: 120)")
    parser.add_argument("--runs", type=int, help="inputs for each target, instead: the same ones each time")
    parser.add_argument("--rounds", type=int, default=1, help="how often each target has its turn (default: 1)")
    parser.add_argument("--seed", type=int, help="of changes, one more each round (default: 1 with --runs, else new)")
    parser.add_argument("--log", type=Path, help="the table that gets a row for each target, instead of docs/data's")
    return parser


def main() -> int:
    """Fuzz the given targets in processes of their own, one after the other; 1 if one of them fails."""
    parser = arguments()
    args = parser.parse_args()
    targets = instrumented_targets()
    if unknown := [name for name in args.targets if name not in targets.TARGETS]:
        parser.error(f"unknown targets {', '.join(unknown)}; known are {', '.join(targets.TARGETS)}")
    log = args.log or (None if args.runs is not None else fuzz_log.TABLE)
    # From the same corpus, the same seed would try what was tried before, which then counted twice.
    new = 1 if args.runs is not None else time.time_ns() % 2**31
    first = new if args.seed is None else args.seed
    failed: list[str] = []
    for turn in range(args.rounds):
        for name in args.targets or targets.TARGETS:
            if name in failed:
                continue
            outcome = fuzz_one(targets, name, args, first + turn)
            state = f"FAILED, {outcome.failure}" if outcome.failure else "ok"
            print(f"{name}: {outcome.inputs or '?'} executions in {outcome.cpu_seconds:.0f} s, {state}", flush=True)
            if outcome.failure:
                failed.append(name)
                print(outcome.said[-3000:], flush=True)
            if log is not None:
                fuzz_log.append(outcome.row(name), log)
            if log is not None and log.resolve() == fuzz_log.TABLE:
                fuzz_log.write_page()
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
