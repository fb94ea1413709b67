"""What only some kinds of robots can do; the others say in one line that they cannot."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.kind import KINDS
from robots.outcome import Judgement, World
from robots.trial import HERE, Progress
from taichi_sim.base.compute import Compute

if TYPE_CHECKING:
    from robots.abstract import Robot


class Abilities:
    """Tables for rigs, files for printers and other simulators, checks: a kind overrides what its robots can do."""

    kind: str  # by its name, one of ``KINDS``

    def judge(
        self, world: World, *, seed: int = 0, compute: Compute = HERE, progress: Progress | None = None
    ) -> Judgement:
        """Tell how far the measures of a robot, of which nothing is free, can be trusted.

        Raises:
            ValueError: if robots of this kind have no such check.
        """
        raise ValueError(f"judge: {KINDS.of(self).title} has no such check; leave it out")

    def table(self, **settings: Any) -> Any:
        """The gait table of a robot of which nothing is free; settings as of ``robots.hardware.gait_table``.

        Raises:
            ValueError: if no hardware plays robots of this kind.
        """
        raise ValueError(f"source: {KINDS.of(self).title} has no gait table; no rig plays it")

    def rig_report(self, rig: Any) -> tuple[Any, float]:
        """What a robot, of which nothing is free, asks of a rig, and the time that it takes in the simulation [s].

        Raises:
            ValueError: if no hardware plays it.
        """
        raise ValueError(f"source: {KINDS.of(self).title} has no gait table; no rig plays it")

    def save_parts(self, path: Path, mould: str | None = None) -> list[str]:
        """Write closed surfaces for printers [mm]: a ``.3mf`` or ``.stl`` file, or a folder; tells what it wrote.

        Args:
            path: of the file or folder.
            mould: settings of a mould to cast the robot in, to be written instead, such as ``"draft=2,wall=3"``.

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

    def at_horizon(self, length: int) -> tuple[str, "Robot"]:
        """The robot in trials of another length, in a unit of its kind, and what that length is called.

        Raises:
            ValueError: if trials of this kind have one length only.
        """
        raise ValueError(f"horizons: trials of {KINDS.of(self).title} have one length; leave it out")
