"""What the comparison of freeform robots designs, where, in how much CPU time, and by which searches."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from optim.experiments.equal_cost import Arm
from robots.freeform.grid import Grid
from robots.freeform.palette import SILICONE, Palette, Tissue
from robots.freeform.robot import FreeformActuation, FreeformRobot
from robots.world import Terrain
from taichi_sim.lattice import Material

BONE = Tissue(
    Material(2e5, 1e3, static_friction=0.3, kinetic_friction=0.2, internal_damping=1.0, name="slippery rubber"),
    muscle=False,
)


@dataclass(frozen=True)
class Problem:
    """What is designed, where, and how much CPU time a run may take.

    Attributes:
        shape: cells along x, y and z.
        seconds: of CPU time.
        settings: of the robot.
        terrain: where it moves.
        condition: what differs from the usual, two cycles on flat ground that grips, or in water; in words.
    """

    shape: tuple[int, int, int]
    seconds: float
    settings: Mapping[str, Any] = field(default_factory=dict)
    terrain: Terrain = field(default_factory=Terrain)
    condition: str = ""

    @property
    def robot(self) -> FreeformRobot:
        """The robot, with all that is free."""
        return FreeformRobot(Grid(self.shape), **self.settings)

    @cached_property
    def variables(self) -> int:
        """How many numbers are free."""
        return len(self.robot.parameters)

    @property
    def place(self) -> str:
        """Where it moves, in words."""
        place = "water" if self.terrain.is_fluid else "ground"
        return ", ".join(filter(None, (place, self.condition)))


_BLOCK: Mapping[str, Any] = {"full": True}
_SMOOTH = Palette((Tissue(replace(SILICONE, static_friction=0.1, kinetic_friction=0.08)),))
_LONG = FreeformActuation(cycles=8)
_MIXED: Mapping[str, Any] = {"palette": Palette((Tissue(SILICONE), BONE))}
PROBLEMS = {
    "tuning": Problem((10, 4, 4), 90.0, _BLOCK),
    "ground-288": Problem((12, 4, 3), 90.0, _BLOCK),
    "ground-960": Problem((12, 8, 5), 150.0, _BLOCK),
    "water-288": Problem((12, 4, 3), 90.0, _BLOCK, Terrain.water()),
    "attempts-1536": Problem((12, 8, 4), 60.0, _MIXED),
    "large-3000": Problem((20, 10, 5), 600.0),
    "ground-48": Problem((6, 2, 2), 15.0, _BLOCK),
    "ground-120": Problem((10, 3, 2), 38.0, _BLOCK),
    "ground-2000": Problem((20, 10, 5), 312.0, _BLOCK),
    "water-48": Problem((6, 2, 2), 15.0, _BLOCK, Terrain.water()),
    "water-960": Problem((12, 8, 5), 150.0, _BLOCK, Terrain.water()),
    "cycles-8-288": Problem((12, 4, 3), 250.0, {**_BLOCK, "actuation": _LONG}, condition="8 cycles"),
    "smooth-288": Problem((12, 4, 3), 90.0, {**_BLOCK, "palette": _SMOOTH}, condition="friction 0.1 and 0.08"),
    "rough-288": Problem((12, 4, 3), 90.0, _BLOCK, Terrain(ground="rough:0.01"), "hills of 1 cm"),
}


# Where cells may be missing, and few gradients fit into the time; chosen on 12 x 8 x 4 cells of one tissue.
QUICK: Mapping[str, Any] = {"climbers": 2, "halving": 4, "moves": 40, "mixed": 0.5, "learning_rate": 0.1}
WHOLE: Mapping[str, Any] = {"climbers": 16, "halving": 4, "moves": 100}
RETURNING: Mapping[str, Any] = {**WHOLE, "returning": 0.5}
ARMS = {
    "race": Arm("gradient race", "race", WHOLE),
    "race-back": Arm("gradient race, returning", "race", RETURNING),
    "race-quick": Arm("gradient race, short rounds", "race", QUICK),
    "genetic": Arm("genetic", "genetic", {"population": 32, "mutation": 0.1}),
    "hill-climb": Arm("hill climbing", "hill-climb", {"climbers": 1}),
    "nes": Arm("NES", "nes", {"population": 16, "random_mean": True, "sigma": 0.1}),
    "cma": Arm("CMA-ES", "cma", {"population": 16, "random_mean": True, "sigma": 0.1}),
}
