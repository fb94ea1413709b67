"""Explore a robot in Jupyter: sliders and menus for body, behaviour and world, beside a player and numbers.

``exploration`` makes robots and worlds of the controls' values and tries them; ``widget`` shows that in a notebook.
"""

from typing import TYPE_CHECKING

from optim.explorer.exploration import Choice, Exploration, Source
from taichi_sim.base.checks import whole_number
from taichi_sim.base.foreign import install_extra

if TYPE_CHECKING:
    from optim.explorer.widget import Explorer


def explore(
    source: Source,
    *,
    measures: tuple[str, ...] = (),
    precision: str | None = None,
    threads: int | None = None,
    height: int = 700,
    **choices: Choice,
) -> "Explorer":
    """Explore a robot in a notebook with sliders: whenever one moves, the robot is simulated and shown again.

    Args:
        source: the robot, or what ``morpholab.robot`` makes one of; or a function that makes a robot of some of the
            choices, which it takes by name.
        measures: names of those to show; all by default.
        precision: of numbers, ``"f32"`` or ``"f64"``; that of views by default.
        threads: of the processor; all by default.
        height: of the player [px].
        choices: by the name of a parameter of the robot, of an option of its kind or of its world, such as ``slope``,
            or of an argument of ``source``. A pair, lowest and highest, is a slider; a list is a menu; anything else
            is fixed. Without any slider or menu there are those that robots of the kind suggest.

    Raises:
        ValueError: for a name that is unknown or a value that is not allowed, or if anywidget is not installed.

    Example (in a notebook)::

        explore("soft-quadruped", terrain=["flat", "rough:0.01"], ground_friction=["1,0.8", "0.3,0.2"])
    """
    height = whole_number("height", height, 200)
    exploration = Exploration(source, choices, measures, precision, threads)
    try:
        from optim.explorer.widget import Explorer
    except ModuleNotFoundError as error:
        if error.name != "anywidget":
            raise
        raise ValueError(f"explore: anywidget is not installed; {install_extra('notebook')}") from None
    return Explorer(exploration, height)
