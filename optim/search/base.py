"""What all search methods share: settings that are fields, and state that is arrays."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.method import SearchResult, Wants
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Floats

Check = Callable[[str, Any, "Search"], object]  # raises ValueError for a name and a value that is not allowed


def setting(default: object, check: Check | None = None) -> Any:
    """A setting of a method, with its default, which is not checked if it is None."""
    return field(default=default, metadata={"check": check})


def whole(default: int | None, low: int | str, high: int | str = 2**31 - 1) -> Any:
    """A setting that is a whole number from ``low`` to ``high``; a bound may be the name of another setting."""
    return setting(default, lambda name, value, of: checks.integer(name, value, _bound(low, of), _bound(high, of)))


def number(default: float | None, low: float | str, high: float | str) -> Any:
    """A setting that is a number from ``low`` to ``high``; a bound may be the name of another setting."""
    return setting(default, lambda name, value, of: checks.number(name, value, _bound(low, of), _bound(high, of)))


def positive(default: float, high: float) -> Any:
    """A setting that is a number above 0, up to ``high``."""
    return setting(default, lambda name, value, of: checks.positive(name, value, high))


def choice(default: str, names: tuple[str, ...]) -> Any:
    """A setting that is one of some names."""
    return setting(default, lambda name, value, of: checks.choice(name, value, names))


def flag(default: bool) -> Any:
    """A setting that is true or false."""
    return setting(default, lambda name, value, of: checks.flag(name, value))


def table() -> Any:
    """A setting that is a table of values by name, None by default."""
    return setting(None, lambda name, value, of: checks.table(name, value))


def hidden(default: object) -> Any:
    """A setting of the class above that this method does not take."""
    return field(default=default, init=False)


def _bound(bound: Any, method: "Search") -> Any:
    return getattr(method, bound) if isinstance(bound, str) else bound


@dataclass(eq=False, kw_only=True)
class Search(ABC):
    """A search method whose settings are fields and whose state is arrays.

    A method is a dataclass (``eq=False, kw_only=True``). Its settings are fields, made by ``whole``, ``number``,
    ``choice`` and so on, which are checked when it is built; ``__post_init__`` sets up the rest.

    Attributes:
        space: the variables that may change.
    """

    several_objectives: ClassVar[bool] = False
    always: ClassVar[tuple[str, ...]]  # names of the arrays that change in every method of a family
    arrays: ClassVar[tuple[str, ...]] = ()  # names of the attributes, arrays all of them, that change beside those

    space: Space = field(kw_only=False)

    def __post_init__(self) -> None:
        for each in fields(self):
            value, check = getattr(self, each.name), each.metadata.get("check")
            if check and not (value is None and each.default is None):
                check(each.name, value, self)
        self.generation = 0

    @property
    def wants(self) -> Wants:
        """How points are evaluated: as true points of the space, unless a method says otherwise."""
        return "points"

    @property
    def sharpness(self) -> float:
        """Unused: this method evaluates true points only."""
        return 0.0

    @abstractmethod
    def ask(self) -> Floats:
        """The points to evaluate next, shape (M, D)."""

    @abstractmethod
    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Take in the judgement of the points asked for."""

    @abstractmethod
    def result(self) -> SearchResult:
        """The best so far."""

    def state(self) -> Arrays:
        """Everything that changes, as arrays by name."""
        own = {name: getattr(self, name).copy() for name in (*self.always, *self.arrays)}
        parts = self._groups().items()
        grouped = {f"{part}/{name}": values.copy() for part, arrays in parts for name, values in arrays.items()}
        return {"generation": np.array(self.generation)} | own | grouped

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from :meth:`state`."""
        expected = self.state()["points"].shape
        if state["points"].shape != expected:
            raise ValueError(f"state: points of shape {state['points'].shape}, expected {expected}")
        self.generation = int(state["generation"])
        for name in (*self.always, *self.arrays):
            setattr(self, name, state[name].copy())
        for group, arrays in self._groups().items():
            arrays.update({name: state[f"{group}/{name}"].copy() for name in arrays})

    def _groups(self) -> Mapping[str, Arrays]:
        """Arrays that change and are held by parts of the method, by the name of the part."""
        return {}
