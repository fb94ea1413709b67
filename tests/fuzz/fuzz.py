"""Fuzz the readers of files, guided by coverage: ``make fuzz``, or ``python tests/fuzz/fuzz.py --seconds 300 vxa``.

What a reader may not do - raise anything but one line, take a gigabyte, or hang - ends its target, and leaves the input
in ``build/fuzz/NAME/``. Add it to ``tests/fuzz/corpus/NAME/`` with the mended cause.
"""

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]
MEMORY, PATIENCE = 1000, 5  # MB and s of one input


def fuzz(name: str, seconds: int, seed: int) -> None:
    """Fuzz one target in this process; never returns."""
    import atheris

    with atheris.instrument_imports(include=["taichi_sim", "robots", "optim", "fuzz_targets"]):
        import fuzz_targets as targets

    folder = ROOT / "build/fuzz" / name
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(targets.seeds(name)):
        (corpus / f"seed-{number}").write_bytes(content[: targets.LARGEST])
    options = [f"-max_total_time={seconds}", f"-seed={seed}", f"-rss_limit_mb={MEMORY}", f"-timeout={PATIENCE}"]
    options += [f"-max_len={targets.LARGEST}", f"-artifact_prefix={folder}/", "-print_final_stats=1", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], lambda content: targets.attack(name, content, targets.room()))
    atheris.Fuzz()


def main() -> int:
    """Fuzz the given targets in processes of their own, one after the other; 1 if one of them fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", help="names of targets; all by default")
    parser.add_argument("--seconds", type=int, default=120, help="for each target")
    parser.add_argument("--seed", type=int, default=1, help="of the changes")
    parser.add_argument("--here", action="store_true", help="fuzz the one target in this process")
    args = parser.parse_args()
    if args.here:
        fuzz(args.targets[0], args.seconds, args.seed)
    import fuzz_targets as targets

    failed = []
    for name in args.targets or targets.TARGETS:
        command = [sys.executable, __file__, "--here", name, "--seconds", str(args.seconds), "--seed", str(args.seed)]
        ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        runs = next((line.split()[-1] for line in ended.stdout.splitlines() if "number_of_executed_units" in line), "?")
        print(f"{name}: {runs} executions, {'ok' if ended.returncode == 0 else 'FAILED'}", flush=True)
        if ended.returncode:
            failed.append(name)
            print(ended.stdout[-3000:], flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
