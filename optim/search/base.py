"""The base class of search methods: settings are dataclass fields, and state is arrays and numbers."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Literal, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from optim.search.method import Method
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays


def whole(default: int | None, low: int | str, high: int | str = 2**31 - 1) -> Any:
    """Declare a setting that is a whole number from ``low`` to ``high``; a bound may be the name of another setting."""
    return _checked(default, checks.integer, low, high)


def number(default: float | None, low: float | str, high: float | str) -> Any:
    """Declare a setting that is a number from ``low`` to ``high``; a bound may be the name of another setting."""
    return _checked(default, checks.number, low, high)


def positive(default: float, high: float) -> Any:
    """Declare a setting that is a number above 0, up to ``high``."""
    return _checked(default, checks.positive, high)


def table() -> Any:
    """Declare a setting that is a table of values by name, None by default."""
    return _checked(None, checks.table)


def hidden(default: object) -> Any:
    """Hide a setting of the base class that this method does not take."""
    return field(default=default, init=False)


def _checked(default: object, check: Callable[..., object], *bounds: float | str) -> Any:
    return field(default=default, metadata={"check": check, "bounds": bounds})


@dataclass(eq=False, kw_only=True)
class Search(Method):
    """Base class of search methods, with settings as dataclass fields and state as arrays and numbers.

    A method is a dataclass (``eq=False, kw_only=True``). Its settings are fields, which are checked when it is built:
    by ``whole``, ``number`` and so on, or by their types, if these are ``bool`` or ``Literal``. A setting may be None
    where that is its default. ``__post_init__`` sets up the rest.

    Attributes:
        space: the variables that may change.

    Raises:
        ValueError: for a setting that is not allowed.
    """

    several_objectives: ClassVar[bool] = False
    arrays: ClassVar[tuple[str, ...]] = ("generation",)  # attributes that change, beside those of the classes above

    space: Space = field(kw_only=False)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if value is None and each.default is None:
                continue
            if get_origin(each.type) is Literal:
                checks.choice(each.name, value, get_args(each.type))
            if each.type is bool:
                checks.flag(each.name, value)
            if each.metadata:
                bounds = (getattr(self, b) if isinstance(b, str) else b for b in each.metadata["bounds"])
                each.metadata["check"](each.name, value, *bounds)
        self.generation = 0

    def state(self) -> Arrays:
        """Return everything that changes during the search, as arrays by name."""
        changing = {name: getattr(self, name, None) for name in self._changing()}
        for part, arrays in self._groups().items():
            changing |= {f"{part}/{name}": values for name, values in arrays.items()}
        return {name: _as_array(name, value) for name, value in changing.items()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue the search from what :meth:`state` returned.

        Raises:
            ValueError: if arrays are missing, unknown, or of another type or shape.
        """
        self._check(state)
        for name in self._changing():
            setattr(self, name, state[name].copy() if state[name].ndim else state[name].item())
        for part, arrays in self._groups().items():
            arrays.update({name: state[f"{part}/{name}"].copy() for name in arrays})

    def _check(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Raise a one-line ValueError unless these are the arrays of such a method, and their numbers are sound."""
        own = self.state()
        for name in [*own, *state]:
            if name not in state:
                raise ValueError(f"state: {name} is missing")
            if name not in own:
                raise ValueError(f"state: {checks.shown(name)} is unknown; arrays are {', '.join(own)}")
        for name in sorted(own, key=lambda name: name != "points"):  # what people know comes first
            known, given = own[name], state[name]
            # A number that a method begins with as a whole one may become another.
            alike = {given.dtype.kind, known.dtype.kind} <= set("iuf") and name != "points"
            if given.dtype.kind != known.dtype.kind and not alike:
                raise ValueError(f"state: {name} of type {given.dtype} is not allowed; give {known.dtype}")
            # What begins empty grows; how many points an archive holds changes, and so do objectives with the problem.
            fixed = slice(known.ndim if name.endswith("objectives") else 0 if name == "points" else 1, None)
            sizes = zip(given.shape[fixed], known.shape[fixed], strict=False)
            if given.ndim != known.ndim or any(size != usual for size, usual in sizes if usual):
                raise ValueError(f"state: {name} of shape {given.shape}, expected {known.shape}")
        if np.isinf(state.get("points", 0.0)).any():  # a climber without any success has none: NaN
            raise ValueError("state: points that are infinite are not allowed")
        checks.whole_number("state: generation", state["generation"].item(), 0)

    @classmethod
    def _changing(cls) -> list[str]:
        """Names of the attributes, arrays or numbers, that change."""
        return [name for each in cls.__mro__ for name in vars(each).get("arrays", ())]

    def _groups(self) -> Mapping[str, Arrays]:
        """Arrays that change and are held by parts of the method, by the name of the part."""
        return {}


def _as_array(name: str, value: object) -> NDArray[Any]:
    """What changes of a method, as an array.

    Raises:
        ValueError: for what files of arrays do not hold, such as None, a dictionary or lists of several lengths.
    """
    with contextlib.suppress(ValueError):
        if not (array := np.array(value)).dtype.hasobject:
            return array
    raise ValueError(f"state: {name} of type {type(value).__name__} is not allowed; give a number or an array")
