"""Cases of run folders: a search's log and its designs are the same bytes, also of a run that was continued."""

import tempfile
from pathlib import Path

import places
from case_methods import SEARCHES, StandIn
from cases import Arrays, as_bytes, case

GENERATIONS, FIRST = 8, 4
FILES = ("log.jsonl", "best.json", "front.json")


def run(name: str) -> Arrays:
    """The files of a run that stopped half-way and went on."""
    from optim.search import build_method

    method, settings, space, objectives = SEARCHES[name]
    problem = StandIn(space, objectives)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        for generations in (FIRST, GENERATIONS):
            config = {"problem": problem.describe(), "method": {"name": method, **settings}, "generations": generations}
            with places.open_run(path, config, resume=generations > FIRST) as opened:
                searching = build_method(method, problem.space, settings)
                places.run_search(problem, searching, opened, generations)
        return {file: as_bytes((path / file).read_bytes()) for file in FILES if (path / file).exists()}


for name in SEARCHES:
    case(f"runs/{name}", name, quick=True)(run)
