"""Exports of a lattice robot: tables for rigs, parts to print, moulds, files of other simulators; and its trust."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.robot import HERE, Judgement, Progress, Robot, World
from robots.world import terrain_of
from taichi_sim.base.compute import Compute

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

DECIDES = "one with reflexes has no table of channels; it decides while it moves"


class LatticeExports(Robot):
    """A lattice robot as hardware, printers and other simulators see it."""

    @property
    @abstractmethod
    def fixed(self) -> "LatticeRobot":
        """The robot with nothing free."""

    @property
    def has_table(self) -> bool:  # type: ignore[override]
        """Whether a rig has lines for its channels, once nothing is free; reflexes decide on the way."""
        return not self.no_table_reason

    @property
    def no_table_reason(self) -> str:  # type: ignore[override]
        """Why no rig plays it; empty if one can."""
        from robots.lattice_robot.on_rig import unplayed

        return unplayed(self.fixed) if self.plays_on_rigs else DECIDES

    @property
    def plays_on_rigs(self) -> bool:
        """Whether it does not decide on the way, as it does with reflexes."""
        return not self.feels

    def table(self, *, rig: Any = None, full_scale: str | None = None, **settings: Any) -> Any:
        """Pressures of a rig's lines that play the channels.

        Args:
            rig: the dissertation's if None.
            full_scale: what pressures of lines stand for, see ``robots.lattice_robot.on_rig.full_scale_of``.
            settings: others of ``robots.hardware.channel_table.channel_table``.
        """
        from robots.hardware.channel_table import channel_table
        from robots.hardware.rig import PneumaticRig
        from robots.lattice_robot.on_rig import full_scale_of, rhythm_of, waves_of

        rig, robot = rig or PneumaticRig(), self._decided
        scale = None if full_scale is None else full_scale_of(full_scale)
        return channel_table(robot.name, waves_of(robot, rig, scale), rhythm_of(robot), rig, **settings)

    def rig_report(self, rig: Any) -> tuple[Any, float]:
        """What its channels ask of the lines of a rig, and the time of the cycles in the simulation [s]."""
        from robots.hardware.channel_table import channel_report
        from robots.hardware.rig import PneumaticRig
        from robots.lattice_robot.on_rig import rhythm_of, waves_of

        rig, robot = rig or PneumaticRig(), self._decided
        return channel_report(waves_of(robot, rig), rhythm_of(robot), rig), (robot.cycles + 1) / robot.frequency

    @property
    def _decided(self) -> "LatticeRobot":
        """The robot with nothing free; raises ValueError if it decides on the way."""
        if not self.plays_on_rigs:
            raise ValueError(f"robot: {DECIDES}")
        return self.fixed

    def save_parts(self, path: Path, mould: str | None = None) -> list[str]:
        """Write surfaces for printers, or a mould, see ``robots.lattice_robot.printing``; tells what it wrote."""
        from robots.lattice_robot.printing import MouldSettings, save_parts

        settings = None if mould is None else MouldSettings.from_text(mould)
        written = save_parts(self.fixed, path, settings)
        return [f"{name}: {1e6 * part.surface.volume:.4g} cm^3" for name, part in written.items()]

    def save_voxels(self, path: Path) -> None:
        """Write the robot for VoxCAD (``.vxa``), or its body for Voxelyze (``.vxl.json``)."""
        from robots.lattice_robot.voxel_files import save_voxels

        save_voxels(self.fixed, path)

    def changed(self, options: Mapping[str, Any]) -> Robot:
        """This robot with ``own_measures`` and ``links``; driven by a table of ``channels``, played by a ``rig``."""
        from robots.hardware.channel_table import read_channels
        from robots.hardware.rig import IDEAL, PneumaticRig
        from robots.lattice_robot.on_rig import played_robot

        if "rig" in options and "channels" not in options:
            raise ValueError(f"rig: {options['rig']} is not allowed without --channels, whose rows it plays")
        own = {name: value for name, value in options.items() if name not in ("channels", "links", "rig")}
        robot: Any = super().changed(own)
        if "links" in options:
            robot = replace(robot, body=replace(robot.body, links=options["links"]))
        if "channels" not in options:
            return robot
        named = options.get("rig", IDEAL)
        rig = None if named == IDEAL else PneumaticRig.load(named)
        return played_robot(robot.fixed, read_channels(options["channels"]), rig)

    def judge(
        self, world: World, *, seed: int = 0, compute: Compute = HERE, progress: Progress | None = None
    ) -> Judgement:
        """What remains of its speed from noisy starts, with other friction, half the time step, and balanced links."""
        from robots.lattice_robot.robustness import trust_in

        return trust_in(self.fixed, terrain_of(world), seed=seed, compute=compute, progress=progress).judgement
