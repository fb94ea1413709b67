"""A widget for notebooks: controls, measures and a player, which follow one another. Needs anywidget."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import anywidget
import traitlets

from optim.explorer.exploration import Exploration, Tried
from robots.view.player import MOST_MOTIONS
from robots.view.player import page as player_page
from taichi_sim.base.foreign import class_and_message, failure_of

HERE = Path(__file__).parent


class Explorer(anywidget.AnyWidget):
    """Sliders and menus of a robot, what it measures, and how it moves.

    Attributes:
        exploration: the robot and what can be chosen of it.
        latest: the last trial; None if the values are none of a robot.
        kept: trials to compare with, at most three.
        values: of the controls, by name; assign to move them.
    """

    _esm = HERE / "explorer.js"
    _css = HERE / "explorer.css"
    controls: traitlets.List[Any] = traitlets.List().tag(sync=True)
    values = traitlets.Dict().tag(sync=True)
    measured: traitlets.List[Any] = traitlets.List().tag(sync=True)
    page = traitlets.Unicode().tag(sync=True)
    message = traitlets.Unicode().tag(sync=True)
    busy = traitlets.Float(allow_none=True).tag(sync=True)
    height = traitlets.Int().tag(sync=True)

    def __init__(self, exploration: Exploration, height: int) -> None:
        self.exploration = exploration
        self.latest: Tried | None = None
        self.kept: list[tuple[str, Tried]] = []
        controls = [{**vars(control), "choices": list(control.choices)} for control in exploration.controls]
        super().__init__(controls=controls, values=exploration.first, height=height)
        self.observe(self._try, "values")
        self.on_msg(self._asked)
        self._try()

    def __repr__(self) -> str:
        """What a front end shows that has no widgets; JupyterLab needs them where it runs, not where Python does."""
        return f"install jupyterlab_widgets and anywidget where Jupyter runs for sliders of {', '.join(self.values)}"

    def keep(self) -> None:
        """Keep the last trial to compare others with; the oldest goes if there are too many."""
        if self.latest is not None:
            changed = {c.name: self.values[c.name] for c in self.exploration.controls}
            spoken = ", ".join(f"{name.replace('_', ' ')} {_shown(value)}" for name, value in changed.items())
            self.kept = [*self.kept, (spoken, self.latest)][1 - MOST_MOTIONS :]
            self._show()

    def drop(self) -> None:
        """Forget what was kept."""
        self.kept = []
        self._show()

    def _try(self, change: Any = None) -> None:
        """Try the robot that the values are of, and show it; values that are left out are as at first."""
        self.message, self.latest, self.busy = "", None, 0.0
        try:
            self._try_and_show()
        finally:  # also after Ctrl-C
            self.busy = None

    def _try_and_show(self) -> None:
        try:
            whole = self.exploration.checked(self.values)
            if whole != self.values:
                self.values = whole  # which tries them
                return
            self.latest = self.exploration.tried(whole, self._progress)
            self.message = self.latest.failure
        except BaseException as raised:  # of the user's function, or the simulator: the notebook goes on
            is_refusal = isinstance(failure_of(raised), ValueError)
            self.message = f"{raised}" if is_refusal else class_and_message(raised)
        self._show()

    def _progress(self, fraction: float) -> None:
        if self.busy is not None and fraction - self.busy > 0.02:
            self.busy = fraction

    def _show(self) -> None:
        """Bring the table and the player up to date."""
        now = [self.latest] if self.latest is not None else []
        kept = [(f"kept {n}", f"kept {n}: {spoken}", tried) for n, (spoken, tried) in enumerate(self.kept, start=1)]
        shown = [*kept, *(("now", "now", tried) for tried in now)]
        with self.hold_sync():
            self.measured = [{"title": title, "rows": [list(row) for row in tried.rows]} for _, title, tried in shown]
            motions = [replace(tried.replay.motion, name=name) for name, _, tried in shown]
            self.page = player_page(motions) if shown else ""

    def _asked(self, _: Any, content: Any, buffers: Any) -> None:
        """Do what a button of the front end asks for."""
        asked = {"keep": self.keep, "drop": self.drop}.get(content if isinstance(content, str) else "")
        if asked is not None:
            asked()


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
