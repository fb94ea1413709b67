"""Optional abilities of robots; a kind that lacks one raises a one-line error or returns an empty result."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from numpy.typing import ArrayLike

from robots.kind import KINDS
from robots.outcome import Facts, Judgement, Outcome, Picture, Replay, World
from robots.trial import HERE, Progress
from taichi_sim.base.compute import Compute

if TYPE_CHECKING:
    from robots.abstract import Robot
    from robots.uncertainty import Perturbation
    from robots.world import Terrain


FORMER = {
    "exportable": "has_table",
    "on_rigs": "plays_on_rigs",
    "untabled": "no_table_reason",
    "tabled_by": "table_option",
    "judged_by": "usual_measure",
}  # names up to 2.0 of what plug-ins may define, by which nobody asks any more


def refuse_former_names(cls: type) -> None:
    """Raise a TypeError if a class defines something by its name up to 2.0, which would be ignored without a word."""
    for old, new in FORMER.items():
        if old in vars(cls):
            raise TypeError(f"{cls.__name__}: {old} is called {new} now; rename it")


class Abilities:
    """Base class with default answers for optional abilities; each kind overrides those that its robots have."""

    kind: str  # by its name, one of ``KINDS``

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        refuse_former_names(cls)

    def judge(
        self, world: World, *, seed: int = 0, compute: Compute = HERE, progress: Progress | None = None
    ) -> Judgement:
        """Judge how far the measures of a robot without free variables can be trusted.

        Raises:
            ValueError: if robots of this kind have no such check.
        """
        raise ValueError(f"judge: {KINDS.of(self).title} has no such check; leave it out")

    @property
    def can_be_judged(self) -> bool:
        """Whether :meth:`judge` tells how far this robot can be trusted."""
        return type(self).judge is not Abilities.judge

    def table(self, **settings: Any) -> Any:
        """Gait table of a robot without free variables; ``settings`` are those of ``robots.hardware.gait_table``.

        Raises:
            ValueError: if no hardware plays robots of this kind.
        """
        raise ValueError(f"source: {KINDS.of(self).title} has no gait table; no rig plays it")

    @property
    def plays_on_rigs(self) -> bool:
        """Whether rigs can play robots like this one: by default, whether its class has a :meth:`rig_report`.

        This one may still have no table: ``has_table`` and ``no_table_reason`` say so.
        """
        return type(self).rig_report is not Abilities.rig_report

    def rig_report(self, rig: Any) -> tuple[Any, float]:
        """Report on what a robot without free variables requires of a rig, and its duration in the simulation [s].

        Raises:
            ValueError: if no hardware plays it.
        """
        raise ValueError(f"source: {KINDS.of(self).title} has no gait table; no rig plays it")

    def save_parts(self, path: Path, mould: str | None = None) -> list[str]:
        """Write closed surfaces for 3D printers [mm] to a ``.3mf`` or ``.stl`` file, or a folder; return what it wrote.

        Args:
            path: path of the file or folder.
            mould: settings of a casting mould that is written instead of the robot, such as ``"draft=2,wall=3"``.

        Raises:
            ValueError: if robots of this kind have no such surfaces.
        """
        raise ValueError(f"parts: {KINDS.of(self).title} has no surfaces to print; leave it out")

    def save_voxels(self, path: Path) -> None:
        """Write the robot as a file of voxels for other simulators, ``.vxa`` or ``.vxl.json``.

        Raises:
            ValueError: if robots of this kind have no voxels, or the file cannot hold them.
        """
        raise ValueError(f"voxels: {KINDS.of(self).title} has no such file; leave it out")

    def save_model(self, point: ArrayLike, path: Path) -> list[str]:
        """Write the bodies of a design as a model of rigid bodies for other simulators; return what it leaves out.

        Raises:
            ValueError: if robots of this kind are no such model, or the file cannot hold it.
        """
        raise ValueError(f"model: {KINDS.of(self).title} has no such file; leave it out")

    def save_commands(self, point: ArrayLike, path: Path) -> None:
        """Write what the drives of a design are told over time as a CSV table.

        Raises:
            ValueError: if robots of this kind have no such drives, or decide as they move.
        """
        raise ValueError(f"commands: {KINDS.of(self).title} has no such table; leave it out")

    @property
    def lasts(self) -> float:
        """Time that a motion takes, if nothing ends it before [s]; infinite where only a simulation tells."""
        return math.inf

    def check_gradients(self, world: World) -> None:
        """Refuse, before any work, a world in which a robot with gradients has none.

        Raises:
            ValueError: that says what to change.
        """

    def at_horizon(self, length: int) -> tuple[str, "Robot"]:
        """Name of a trial length, in the unit of this kind, and this robot with trials of that length.

        Raises:
            ValueError: if trials of this kind have one length only.
        """
        raise ValueError(f"horizons: trials of {KINDS.of(self).title} have one length; leave it out")

    def as_terrain(self, world: World) -> World:
        """Convert a world of this robot to a terrain, whose slope can be drawn; other worlds are returned unchanged."""
        return world

    def perturbed(self, drawn: "Perturbation") -> Self:
        """This robot with the values of a draw that concern itself, such as its actuators, rather than its world."""
        return self

    def drawn_terrain(self, terrain: "Terrain", drawn: "Perturbation") -> "Terrain":
        """The terrain of this robot with the values of a draw."""
        return drawn.under(terrain)

    def title_of(self, outcome: Outcome, world: World) -> str:
        """Title of the picture of a motion; empty for a plain one."""
        return ""

    def facts_of(self, point: ArrayLike) -> Facts:
        """Rows for a report about one design."""
        return []

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """Pictures of one design, for a report; ``replays`` has its trials in all worlds, if it was tried again."""
        return []

    def document(self) -> dict[str, Any]:
        """Further JSON entries of a robot without free variables, beside its measures."""
        return {}

    def caution(self, point: ArrayLike) -> str:
        """Reason why gradients or differences at a point, shape (P,), may mislead; empty if none is known."""
        return ""

    def doubts(self) -> tuple[str, ...]:
        """Settings that are allowed but likely mistakes, one line each that names the field."""
        return ()

    def doubts_in(self, world: World) -> tuple[str, ...]:
        """What is likely a mistake in a world, such as feet without friction on the ground, a line each."""
        return ()

    def doubts_about(self, outcome: Outcome) -> tuple[str, ...]:
        """Why a trial's numbers may be less sure than they look, such as steps left unsolved, a line each."""
        return ()

    def save_picture(self, world: World, path: Path) -> None:
        """Write a picture special to this kind, if ``pictured``, of a robot without free variables (PNG, SVG or PDF).

        ``robots.view.picture.save_robot_picture`` draws robots of all kinds.
        """
        raise NotImplementedError

    def command_options(self) -> dict[str, Any]:
        """Options, by name, that a command needs beside a saved design to repeat its trial, except defaults."""
        return {}
