"""Disks and memory that fail: each command, with the n-th call that changes the disk, or the n-th large array,
failing, ends in one line; nothing is half.

What was there before is as it was, what is there after is whole or absent, and the same command then gives what it
gives where nothing fails.
"""

import argparse
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from articulated_files import CRAWLER
from faults import Disk, Memory, contents
from measurements import GRIPPING
from shortened_commands import shorten
from small_pipeline import write_task

from optim.cli import build_parser
from optim.problem import Request, evaluate_request
from optim.problems import problem_of_run
from optim.runs.config import read_config
from optim.runs.workers import folder_files, shared_folder
from optim.runs.workers.folder_files import Offer
from robots.calibration import read_measurements
from taichi_sim.base import files

pytestmark = [pytest.mark.kernels, pytest.mark.long]

ROOT = Path(__file__).resolve().parents[1]
BRIEF = "--time-step 0.5 --steps 60 --threads 1 --quiet"
RUN = "codesign --robot vehicle --climbers 2 --generations 2 --quiet --out"
EXAMPLES = ("starfish.py", "voxel_walker.vxa")


@dataclass(frozen=True)
class Case:
    """A command, in a folder with the examples, a task of the pipeline and measurements.

    Attributes:
        line: the words after ``morpholab``.
        before: commands that prepare the folder.
        again: what gives the result after a failure that has left a run, if that is another command.
        many: whether it makes so many arrays, or takes so long, that one fails for each place of the code, not each.
    """

    line: str
    before: tuple[str, ...] = ()
    again: str = ""
    keeps: bool = True
    needs: str = ""
    many: bool = False


CASES = {
    "export": Case("export inching --csv gait.csv --plain plain.csv --c-header gait.h --plot gait.png"),
    "export a mould": Case("export starfish.py --parts parts --mould draft=2,wall=3"),
    "export a model": Case("export crawler.xml --body-sizes front=1.3 --model sized.xml --commands told.csv"),
    "export voxels": Case("export voxel_walker.vxa --voxels walker.vxl.json --parts walker.3mf"),
    "view": Case(
        "view vehicle --out page.html --picture still.png --glb motion.glb --strip strip.png --quiet", many=True
    ),
    "films": Case("view vehicle --gif motion.gif --mp4 motion.mp4 --seconds 0.5 --quiet", many=True),
    "recording": Case("view vehicle --rerun motion.rrd --quiet", needs="rerun"),
    "paraview": Case("view vehicle --paraview frames --frames 20 --quiet"),
    "simulate": Case("simulate --robot vehicle --record-every 100 --out results", many=True),
    "simulate a gait": Case("simulate --gait round.json --geometry small --precision f32 --out results", many=True),
    "simulate many": Case("simulate-all vehicle voxel_walker.vxa --threads 1 --quiet --out results", many=True),
    "check gradients": Case(
        "gradient-check --robot vehicle --horizons 4 --directions 2 --quiet --out results", many=True
    ),
    "codesign": Case(f"{RUN} results", again="codesign --resume --quiet --out results"),
    "codesign with seeds": Case(f"{RUN} results --seeds 2,3", again=f"{RUN} results --seeds 2,3 --resume"),
    "codesign with workers": Case(
        f"{RUN} results --workers-dir shared --workers 2",
        again="codesign --resume --quiet --out results --workers-dir shared --workers 2",
    ),
    "compare": Case("compare one two --out curves.png", (f"{RUN} one", f"{RUN} two --seed 1")),
    "report": Case("report one --out page.html --no-player --quiet", (f"{RUN} one",)),
    "track": Case("track one --parquet runs.parquet", (f"{RUN} one",)),
    "track events": Case("track one --tensorboard events", (f"{RUN} one",)),
    "sweep": Case(f"sweep --designs 162,6553 --weights 5 {BRIEF} --out results"),
    "train": Case(f"train --designs 162 --methods nes --repetitions 2 --budget-evaluations 6 {BRIEF} --out results"),
    "measure": Case("measure --robot vehicle --controllers 4 --success closest<=1 --quiet --out results"),
    "interference": Case(
        "interference --robots legged --fitness sum --runs 1 --generations 2 --population 3 --steps 50 --threads 1 "
        "--quiet --alone --figures --out results",
        many=True,
    ),
    "reproduce": Case("reproduce forgetting --budget small --quiet --out results", many=True),
    "reproduce from data": Case(f"reproduce light-seeking --from-data {ROOT}/docs/data --quiet --out results"),
    "calibrate": Case("calibrate drags.toml --threads 1 --quiet --out results", many=True),
    "example of measurements": Case("calibrate --example example.toml --threads 1 --quiet"),
    "pipeline": Case("pipeline task.toml --threads 1 --quiet --out results", many=True),
    "play": Case("play gait.csv --to lines.jsonl --no-wait", ("export inching --csv gait.csv",), many=True),
    "work": Case("work shared --idle 0.1 --threads 1 --quiet", (f"{RUN} one",), keeps=False),
}
# Commands that write nothing, and what others only read: no case is needed.
WRITES_NOTHING = ("tasks", "status", "bench")
READ = {
    "compare": ("runs",),
    "report": ("runs",),
    "track": ("runs",),
    "export": ("source",),
    "play": ("table",),
    "pipeline": ("task", "--replay"),
    "calibrate": ("data",),
    "codesign": ("--problem",),
    "work": ("--problem",),
    "simulate": ("--table",),
    "simulate-all": ("sources",),
    "train": ("--sweep",),
    "reproduce": ("--from-data", "--sweep"),
}
# What tells times, or checksums of such.
VOLATILE = ("timing.jsonl", "environment.json", ".lock", "checkpoint.npz", "checkpoint.previous.npz")
FAULTS = {"disk": Disk, "memory": Memory}
# What is tried at every call in every run of the tests, as it takes no second; and of which arrays fail there.
QUICK = ("example of measurements", "export a model", "track", "track events")
QUICK_OF_MEMORY = ("simulate", "codesign")
NO_ARRAYS = ("report", "track events", "reproduce from data", "example of measurements")  # that are large


def prepare(folder, case, morpholab):
    """Fill a folder with what the command of a case reads."""
    for name in EXAMPLES:
        shutil.copy(ROOT / "examples" / name, folder)
    (folder / "drags.toml").write_text(GRIPPING)
    (folder / "crawler.xml").write_text(CRAWLER)
    write_task(folder)
    for line in case.before:
        assert morpholab(line)[0] == 0, line
    if case.line.startswith("work "):
        offer(folder)


def offer(folder):
    """Leave in a folder for workers what a search that was killed leaves there: an offer, and two parts that wait."""
    problem = problem_of_run(folder / "one", read_config(folder / "one"))
    made = Offer.here(problem.describe(), silence=60.0)
    folder_files.make_folders(folder / "shared")
    made.write(folder / "shared")
    for points in problem.space.sample(np.random.default_rng(0), 4).reshape(2, 2, -1):
        name, content = folder_files.packed_request(Request(points), made.digest)
        files.write_bytes(folder_files.part_path(folder / "shared", folder_files.OPEN, name), content)


def simplify(monkeypatch, case, fault):
    """Let commands take little effort where that is not what fails: no simulation for an example, workers at hand."""
    shorten(monkeypatch)
    measured = lambda laboratory, seed: read_measurements(Path("drags.toml"), None).experiments  # noqa: E731
    monkeypatch.setattr("robots.calibration.example.example", measured)

    def answer(waited):
        """Work for a search that waits, on a disk that does not fail."""
        count, fails_at = fault.count, fault.fails_at
        fault.begin(0)
        part, claim = folder_files.claim_any(Path("shared"), "worker")
        _, request = folder_files.unpacked_request(claim.read_bytes())
        problem = problem_of_run(Path("results"), read_config(Path("results")))
        content = folder_files.packed_answer(part, "worker", evaluate_request(problem, request))
        files.write_bytes(folder_files.part_path(Path("shared"), folder_files.DONE, part), content)
        claim.unlink()
        fault.fails_at, fault.count = fails_at, count

    if "--workers-dir" in case.line:
        monkeypatch.setattr(shared_folder.protocol, "nap", answer)


def lasting(folder):
    """Files below a folder that must not depend on failures; of answers of workers all but the worker's name.

    Recordings have numbers of their own in each row, so only that they are there.
    """
    found = contents(folder, VOLATILE)
    for path in found:
        if path.endswith(".rrd"):
            found[path] = b""
        if Path(path).parent.name == folder_files.DONE:
            _, told = folder_files.unpacked_answer(found[path], Path(path).stem, 2)
            found[path] = told.objectives.tobytes()
    return found


def written_by_commands():
    """Commands that may write, each with the options and arguments that name files or folders it does not only read."""
    commands = next(a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction)).choices
    for command, parser in commands.items():
        if command not in WRITES_NOTHING:
            of_paths = [a for a in parser._actions if a.type is Path or a.metavar in ("FILE", "DIR", "PATH", "FOLDER")]
            yield command, {(a.option_strings or [a.dest])[0] for a in of_paths} - set(READ.get(command, ()))


def test_every_file_that_a_command_writes_is_in_a_case():
    for command, names in written_by_commands():
        words = {word for case in CASES.values() for word in case.line.split() if case.line.startswith(f"{command} ")}
        assert words, f"{command}: which case lets its disk fail?"
        missing = {name for name in names if name.startswith("--")} - words
        assert not missing, f"{command}: in which case is {missing} written?"


def misses(error, fault, places):
    """What is missing from what a command said of a fault: that it is one line, which names the fault and the place."""
    if "Traceback" in error or len(error.splitlines()) > 2:
        return "it is not told in a line"
    if not any(words in error for words in fault.TOLD):
        return "it is not told what failed"
    if fault.NAMES_PATHS and not any(place in error for place in places):
        return "it is not told what could not be written"
    return ""


def wrong_after(n, case, fault, morpholab, whole):
    """What is wrong with what comes of a command in the working directory whose n-th call fails; empty if nothing."""
    folder = Path.cwd()
    before = lasting(folder)
    fault.begin(n)
    code, _, error = morpholab(case.line)
    calls = fault.count
    fault.begin(0)
    found = lasting(folder)
    strangers = [path for path in found if path not in whole and path not in before]
    places = {Path(path).parts[0] for path in whole.keys() - before.keys()} | {tempfile.gettempdir()}
    wrong = [
        calls < n and f"it calls only {calls} times",
        code not in (0, 1) and f"it ends with code {code}",  # 0 where nothing was lost, see the end
        code and misses(error, fault, places),
        case.keeps and not before.items() <= found.items() and "something that was there has changed",
        strangers and f"{strangers} are left",
    ]
    if code:
        again = case.again if case.again and any(folder.glob("results/**/config.toml")) else case.line
        code, _, after = morpholab(again)
        wrong.append(code and f"{again} ends with code {code}: {after}")
    wrong.append(lasting(folder) != whole and "it gives something else than where nothing fails")
    told = "; ".join(filter(None, wrong))
    return told and f"{told}; {error.strip()}"


def is_slow(kind, name, every):
    """Whether ``make validate`` alone tries a case: at every call, unless that takes no second; with little memory."""
    if kind == "memory":
        return every or name not in QUICK_OF_MEMORY
    return every and name not in QUICK


def tried(case, fault, every):
    """Numbers of calls that fail, of those that a fault has counted: the middle one; or all, or one of each place."""
    calls = range(1, fault.count + 1)
    if not every:
        return calls[fault.count // 2 :][:1]
    return fault.one_of_each_place() if case.many and isinstance(fault, Memory) else calls


def test_an_array_fails_for_each_place_of_the_lab_that_makes_some(monkeypatch):
    fault, module = Memory(monkeypatch), {"__name__": "robots.made", "np": np}
    source = "for n in range(3):\n np.zeros(100)\nnp.zeros(1)\nnp.zeros(100)\n"
    exec(compile(source, "made.py", "exec"), module)
    assert (fault.count, fault.one_of_each_place()) == (4, [2, 4])
    fault.begin(2)
    with pytest.raises(MemoryError, match="800 bytes"):
        exec(compile(source, "made.py", "exec"), module)


CHOSEN = [
    (kind, name, every)
    for kind in FAULTS
    for name in CASES
    for every in (False, True)
    if kind == "disk" or name not in NO_ARRAYS
]


@pytest.mark.parametrize(
    ("kind", "name", "every"),
    [
        pytest.param(
            *(kind, name, every),
            marks=pytest.mark.slow if is_slow(kind, name, every) else (),
            id=f"{kind}-{name}-{'all' if every else 'one'}",
        )
        for kind, name, every in CHOSEN
        if every or kind == "memory" or name not in QUICK
    ],
)
def test_a_fault_costs_nothing_but_the_command(kind, name, every, morpholab, tmp_path, monkeypatch):
    case = CASES[name]

    def enter(folder):
        shutil.copytree(tmp_path / "prepared", folder)
        monkeypatch.chdir(folder)

    if case.needs:
        pytest.importorskip(case.needs)
    fault = FAULTS[kind](monkeypatch)
    simplify(monkeypatch, case, fault)
    (tmp_path / "prepared").mkdir()
    monkeypatch.chdir(tmp_path / "prepared")
    prepare(tmp_path / "prepared", case, morpholab)
    if every:  # then the calls are the same in all runs, and what is made once a process must be there
        enter(tmp_path / "first")
        assert morpholab(case.line)[0] == 0
    enter(tmp_path / "whole")
    before = lasting(tmp_path / "whole")
    fault.begin(0)
    code, _, error = morpholab(case.line)
    calls, whole = fault.count, lasting(tmp_path / "whole")
    assert code == 0 and calls, error
    assert whole.keys() - before.keys()
    wrong = []
    for n in tried(case, fault, every):
        enter(tmp_path / f"fails{n}")
        if found := wrong_after(n, case, fault, morpholab, whole):
            wrong.append(f"{n}: {found}")
    assert not wrong, "\n".join([f"of {calls} calls", *wrong])
