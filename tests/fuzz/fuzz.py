"""Fuzz the readers of files, guided by coverage: ``make fuzz``, or ``python tests/fuzz/fuzz.py --seconds 300 vxa``.

What a reader may not do - raise anything but one line, take a gigabyte, or hang - ends its target, and leaves the input
in ``build/fuzz/NAME/``. Add it to ``tests/fuzz/corpus/NAME/`` with the mended cause.
"""

import argparse
import hashlib
import io
import os
import re
import sys
import tempfile
from contextlib import ExitStack, redirect_stderr, suppress
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]
MEMORY, PATIENCE = 1000, 5  # MB and s of one input


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
    options = [*options, f"-rss_limit_mb={MEMORY}", f"-timeout={PATIENCE}", f"-max_len={targets.LARGEST}"]
    options += [f"-artifact_prefix={folder}/", "-print_final_stats=1", "-verbosity=0"]

    def attack(content: bytes) -> None:
        try:
            targets.attack(name, content, targets.room())
        except Exception:  # libFuzzer keeps what hangs or takes too much, but not this
            found = folder / f"crash-{hashlib.sha256(content).hexdigest()[:16]}"
            found.write_bytes(content)
            print(f"the input is {found}", flush=True)
            raise

    atheris.Setup([sys.argv[0], *options, str(corpus)], attack)
    atheris.Fuzz()


def fuzz_apart(targets: ModuleType, name: str, corpus: Path, options: list[str]) -> tuple[int, str]:
    """Fuzz one target in a copy of this process, which has all imports already; its exit code and what it wrote."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if not child:
            for stream in (1, 2):
                os.dup2(said.fileno(), stream)
            try:
                fuzz(targets, name, corpus, options)
            finally:
                os._exit(1)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        return code, said.read().decode(errors="replace")


def main() -> int:
    """Fuzz the given targets in processes of their own, one after the other; 1 if one of them fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names of targets; all by default")
    parser.add_argument("--seconds", type=int, default=120, help="for each target")
    parser.add_argument("--runs", type=int, help="inputs for each target, instead: the same ones each time")
    parser.add_argument("--seed", type=int, default=1, help="of the changes")
    args = parser.parse_args()
    targets = instrumented_targets()
    failed = []
    for name in args.targets or targets.TARGETS:
        with ExitStack() as held:
            options, corpus = [f"-max_total_time={args.seconds}"], ROOT / "build/fuzz" / name / "corpus"
            if args.runs is not None:  # they do not depend on what was found before
                options = [f"-runs={args.runs}"]
                corpus = Path(held.enter_context(tempfile.TemporaryDirectory()))
            code, said = fuzz_apart(targets, name, corpus, [*options, f"-seed={args.seed}"])
        runs = next(iter(re.findall(r"number_of_executed_units:\s*(\d+)", said)), "?")
        print(f"{name}: {runs} executions, {'ok' if code == 0 else 'FAILED'}", flush=True)
        if code:
            failed.append(name)
            print(said[-3000:], flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
