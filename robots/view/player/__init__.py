"""Interactive player of motions: one HTML file that needs no network, no server and no installation.

It works from disk, in notebooks and on any site; what it needs is a browser with WebGL 2. three.js (MIT licence, see
``LICENSE.three``) is part of the file.
"""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike

from robots.view.motion import Motion
from robots.view.player.page import MOST_MOTIONS, page
from taichi_sim.base.checks import whole_number
from taichi_sim.base.files import new_path, write_text

__all__ = ["MOST_MOTIONS", "Player", "embedded", "page", "save_player", "show"]


def save_player(motions: Motion | Sequence[Motion], path: str | PathLike[str], *, title: str = "") -> int:
    """Write an HTML page that plays motions.

    Args:
        motions: one, or up to four to see side by side.
        path: path of the file, which must not exist yet.
        title: above them.

    Returns:
        Bytes written.

    Raises:
        ValueError: for a file that exists, no motions or too many of them.
    """
    new_path(path)
    text = page(motions, title)
    write_text(path, text)
    return len(text.encode())


@dataclass(frozen=True)
class Player:
    """A player that notebooks show below a cell.

    Attributes:
        page: as text.
        height: in the notebook [px].
    """

    page: str = field(repr=False)
    height: int

    def _repr_html_(self) -> str:
        return embedded(self.page, f"width:100%;height:{self.height}px;border:0")


def show(motions: Motion | Sequence[Motion], *, title: str = "", height: int = 860) -> Player:
    """Show a player of motions below a notebook's cell.

    Args:
        motions: one, or up to four to see side by side.
        title: above them.
        height: height of the player [px].
    """
    return Player(page(motions, title), whole_number("height", height, 200))


def embedded(page: str, style: str = "", title: str = "Player of motions") -> str:
    """HTML element that contains a player, for use in another page.

    Args:
        page: as text.
        style: CSS of the element.
        title: for screen readers.
    """
    look = f' style="{html.escape(style)}"' if style else ""
    return f'<iframe title="{html.escape(title)}" srcdoc="{html.escape(page)}"{look}></iframe>'
