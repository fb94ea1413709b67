"""Robots as run folders of earlier versions describe them, which lack what was added since."""

from collections.abc import Callable, Mapping
from typing import Any

# What was not told, and whether a robot that is given again with such a value may be that of the run.
UNTOLD: Mapping[str, Callable[[Any], bool]] = {
    "origin": lambda value: True,  # of a robot made of a mesh; nothing that is simulated depends on it
    "slip": lambda value: value is None,  # not asked for: the run goes on with its own
}


def is_described_by(known: object, asked: object) -> bool:
    """Whether a robot that is given again is the one that a run began with, by their descriptions."""
    if not isinstance(known, Mapping) or not isinstance(asked, Mapping):
        return known == asked
    untold = {name for name, allowed in UNTOLD.items() if name not in known and name in asked and allowed(asked[name])}
    return dict(known) == {name: value for name, value in asked.items() if name not in untold}
