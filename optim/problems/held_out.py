"""How a search's best design does over draws of what is uncertain that the search has not seen: ``robust.json``."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from robots.robot import Robot, World
from robots.uncertainty import JUDGED_DRAWS, Risk, Uncertainty, judge_uncertain
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text

ROBUST_FILE = "robust.json"


def held_out_products(
    robot: Callable[[], Robot], worlds: Sequence[World], uncertain: str, risk: str, compute: Compute
) -> Mapping[str, Callable[[Path], None]]:
    """What writes that file; nothing, if nothing is uncertain.

    Args:
        robot: makes the best one.
        worlds: where it was designed for, an entry each.
        uncertain, risk: as texts, see ``robots.uncertainty``.
        compute: device, precision and threads.
    """

    def write(path: Path) -> None:
        unknown, measure, best = Uncertainty.parse(uncertain), Risk.parse(risk), robot()
        found = {
            world.name: judge_uncertain(best, world, unknown, measure, JUDGED_DRAWS, compute=compute).document
            for world in worlds
        }
        write_text(path, json.dumps({"risk": risk, "terrains": found}, indent=1) + "\n")

    return {ROBUST_FILE: write} if uncertain else {}
