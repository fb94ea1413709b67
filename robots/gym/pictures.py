"""Pictures of the robots of a batch, each with a camera that stays through an episode."""

from typing import TYPE_CHECKING

from robots.gym.batch import Batch
from taichi_sim.base.arrays import Bytes, Ints
from taichi_sim.base.checks import choice

if TYPE_CHECKING:
    from robots.view.onlooker import Onlooker

RENDER_MODES = ("rgb_array",)


class Pictures:
    """Draws the robots of a batch, if there is a render mode."""

    def __init__(self, batch: Batch, render_mode: str | None) -> None:
        """Take the robots.

        Raises:
            ValueError: for an unknown render mode.
        """
        self._batch, self._wanted = batch, render_mode is not None
        if render_mode is not None:
            choice("render_mode", render_mode, RENDER_MODES)
        self._onlookers: dict[int, Onlooker] = {}

    def begin(self, which: Ints) -> None:
        """Have someone look at robots whose episodes begin."""
        if not self._wanted:
            return
        from robots.view.onlooker import Onlooker

        for robot in which.tolist():
            self._onlookers[robot] = Onlooker(self._batch.motion(robot))

    def draw(self, robot: int) -> Bytes:
        """A picture of a robot as it is: red, green, blue, shape (H, W, 3).

        Raises:
            RuntimeError: before the first episode.
        """
        if robot not in self._onlookers:
            raise RuntimeError("reset the environment before its first picture")
        return self._onlookers[robot].picture(self._batch.motion(robot))
