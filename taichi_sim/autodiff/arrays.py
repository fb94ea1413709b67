"""Reverse mode for NumPy code: a function of arrays is written once; run on traced arrays, it also gives derivatives.

    >>> def lengths(vectors):
    ...     return np.sqrt((vectors * vectors).sum(axis=-1))
    >>> value, pull_back = trace(lengths, np.array([[3.0, 4.0]]))
    >>> value.tolist()
    [5.0]
    >>> pull_back(np.array([1.0]))[0].tolist()
    [[0.6, 0.8]]

Values come out with the same bits as without tracing. Laws (see ``tracing``) run on traced arrays too.
Known are: arithmetic and elementary functions with broadcasting (``RULES``), comparisons and roundings (constants to
derivatives), reductions and others (``_FUNCTIONS``), every index, and all that moves elements (``_MOVES``). What is not
known raises a TypeError of NumPy's. Of equal extremes the first has the derivative. Instead of assigning to parts of an
array, which would not be traced, use :func:`placed`; number-by-number functions of ``math`` are :func:`sine` and
:func:`cosine`.

Source: Griewank & Walther, Evaluating Derivatives, 2nd ed., 2008, ch. 3.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Union

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from taichi_sim.autodiff.array_rules import CONSTANTS, RULES
from taichi_sim.autodiff.tracing import Contributions, Traced, plain, run_back
from taichi_sim.base.arrays import Floats

Array = Union[Floats, "TracedArray"]
Cotangents = tuple[Floats, ...]
_PLAIN = (int, np.integer, slice, type(Ellipsis))  # of an index that finds no element twice


class TracedArray(NDArrayOperatorsMixin, Traced):
    """An array of numbers whose origin is remembered."""

    __array_priority__ = 100.0

    def __init__(self, tape: list[Traced], value: Any, pull: Callable[[Any], Contributions] | None = None) -> None:
        """Note an array, which is never part of a kernel; ``pull`` of a constant is None."""
        self.tape, self.value, self.pull, self.cotangent = tape, value, pull, None
        if pull is not None:
            tape.append(self)

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        raise TypeError("an array that is traced does not become a plain one; use NumPy's functions, such as np.stack")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            return NotImplemented
        values = [plain(x) for x in inputs]
        if ufunc in CONSTANTS:
            return ufunc(*values)
        if ufunc not in RULES:
            return NotImplemented
        out = ufunc(*values)
        shares = [lambda g, rule=rule: rule(g, out, *values) for rule in RULES[ufunc]]
        return _derived(out, *zip(inputs, shares, strict=True))

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        if function in _FUNCTIONS:
            return _FUNCTIONS[function](*arguments, **options)
        if function in _MOVES:
            return _moved(function, *arguments, **options)
        return NotImplemented

    def __getitem__(self, index: Any) -> "TracedArray":
        if not all(
            each is None or isinstance(each, _PLAIN) for each in (index if isinstance(index, tuple) else [index])
        ):
            return _moved(lambda array: array[index], self)
        value = self.value

        def pull(g: Any) -> Contributions:
            whole = np.zeros(value.shape)
            whole[index] += g  # no place occurs twice
            return [(self, whole)]

        return self.derived(value[index], pull)  # type: ignore[return-value]

    def __iter__(self) -> Iterator["TracedArray"]:
        return (self[i] for i in range(len(self)))

    def __len__(self) -> int:
        return len(self.value)

    @property
    def shape(self) -> tuple[int, ...]:
        """The value's shape."""
        return self.value.shape

    @property
    def ndim(self) -> int:  # noqa: D102
        return self.value.ndim

    @property
    def size(self) -> int:
        """How many numbers it holds."""
        return self.value.size

    @property
    def T(self) -> "TracedArray":  # noqa: D102
        return self.derived(self.value.T, lambda g: [(self, np.transpose(g))])  # type: ignore[return-value]

    def reshape(self, *shape: Any) -> "TracedArray":  # noqa: D102
        own = self.value.shape
        return self.derived(self.value.reshape(*shape), lambda g: [(self, np.reshape(g, own))])  # type: ignore[return-value]

    def ravel(self) -> "TracedArray":  # noqa: D102
        return self.reshape(-1)

    def sum(self, axis: Any = None, keepdims: bool = False) -> Any:  # noqa: D102
        return _sum(self, axis, keepdims=keepdims)

    def mean(self, axis: Any = None, keepdims: bool = False) -> Any:  # noqa: D102
        return _mean(self, axis, keepdims=keepdims)

    def max(self, axis: Any = None, keepdims: bool = False) -> Any:  # noqa: D102
        return _extreme(np.argmax, self, axis, keepdims)

    def min(self, axis: Any = None, keepdims: bool = False) -> Any:  # noqa: D102
        return _extreme(np.argmin, self, axis, keepdims)

    def clip(self, low: Any = None, high: Any = None) -> Any:  # noqa: D102
        return _clip(self, low, high)

    def var(self, axis: Any = None, ddof: float = 0, keepdims: bool = False) -> Any:  # noqa: D102
        return _var(self, axis, ddof=ddof, keepdims=keepdims)

    def std(self, axis: Any = None, ddof: float = 0, keepdims: bool = False) -> Any:  # noqa: D102
        return _std(self, axis, ddof=ddof, keepdims=keepdims)


def trace(function: Callable[..., Any], *inputs: Any) -> tuple[Any, Callable[..., Cotangents]]:
    """Run a function of arrays and remember how its results came about.

    Args:
        function: of the inputs; returns an array or a tuple of arrays.
        inputs: numbers to differentiate by.

    Returns:
        The results as plain arrays, and a function that takes the cotangents of all results (None for one that
        nothing depends on) and returns those of all inputs, of their shapes; it may be called several times.
    """
    tape: list[Traced] = []
    leaves = [TracedArray(tape, np.asarray(x, float), lambda g: []) for x in inputs]
    results = function(*leaves)
    several = results if isinstance(results, tuple) else (results,)

    def pull_back(*cotangents: Any) -> Cotangents:
        seeds = [None if g is None else np.broadcast_to(g, np.shape(plain(r))) for r, g in _pairs(several, cotangents)]
        found = run_back(tape, leaves, several, seeds)
        return tuple(np.zeros(x.shape) if g is None else np.array(g) for x, g in zip(leaves, found, strict=True))

    values = tuple(plain(result) for result in several)
    return (values if isinstance(results, tuple) else values[0]), pull_back


def value_of(array: Any) -> Floats:
    """The numbers of an array, traced or not: constants to derivatives."""
    value: Floats = plain(array)
    return value


def revalued(array: Any, values: Floats) -> Any:
    """Other values of the same shape, with the derivatives of an array."""
    return array.derived(values, lambda g: [(array, g)]) if isinstance(array, TracedArray) else values


def placed(shape: tuple[int, ...], index: Any, values: Any) -> Any:
    """Zeros of a shape, with values at an index of which no place occurs twice."""
    result = np.zeros(shape)
    result[index] = plain(values)
    return _derived(result, (values, lambda g: g[index]))


def mapped(matrix: Any, values: Any) -> Any:
    """A matrix of shape (M, N), sparse or dense, times the last axis of an array, shape (..., N); row by row.

    So what becomes of a row has the same bits whatever the others are.
    """

    if not isinstance(values, TracedArray):
        return _row_by_row(matrix, values)
    return _derived(_row_by_row(matrix, values.value), (values, lambda g: _row_by_row(matrix.T, np.asarray(g))))


def _row_by_row(matrix: Any, values: Any) -> Any:
    shape = *values.shape[:-1], matrix.shape[0]
    rows = values.reshape(-1, matrix.shape[1])
    found = matrix @ rows[0] if len(rows) == 1 else np.array([matrix @ row for row in rows])
    return found.reshape(shape)


def sine(angle: Any) -> Any:
    """Sine of an angle [rad]."""
    return _by_number(math.sin, math.cos, angle)


def cosine(angle: Any) -> Any:
    """Cosine of an angle [rad]."""
    return _by_number(math.cos, lambda x: -math.sin(x), angle)


def _by_number(function: Callable[[float], float], slope: Callable[[float], float], x: Any) -> Any:
    """Number by number: NumPy's own functions may differ from those of ``math`` in the last bit."""
    found = np.vectorize(function, otypes=[float])(plain(x))
    return _derived(found, (x, lambda g: g * np.vectorize(slope, otypes=[float])(plain(x))))


def _derived(value: Any, *operands: tuple[Any, Callable[[Any], Any]]) -> Any:
    """The result of an operation: plain if all its operands are.

    Args:
        value: of the result.
        operands: each with its cotangent as a function of that of the result.
    """
    traced = [(x, share) for x, share in operands if isinstance(x, TracedArray)]
    if not traced:
        return value
    active = [(x, share) for x, share in traced if x.pull is not None]

    def pull(g: Any) -> Contributions:
        return [(x, _gathered(share(g), x.value.shape)) for x, share in active]

    return TracedArray(traced[0][0].tape, value, pull if active else None)


def _pairs(results: Sequence[Any], cotangents: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    if len(results) != len(cotangents):
        raise ValueError(f"cotangents: {len(cotangents)} are not allowed; give one for each of {len(results)} results")
    return zip(results, cotangents, strict=True)


def _gathered(cotangent: Any, shape: tuple[int, ...]) -> Any:
    """The cotangent of an operand, summed over the axes along which it was broadcast."""
    if np.shape(cotangent) == shape:
        return cotangent
    extra = np.ndim(cotangent) - len(shape)
    axes = tuple(range(extra)) + tuple(extra + i for i, n in enumerate(shape) if n == 1)
    return np.broadcast_to(cotangent, np.shape(cotangent)).sum(axis=axes, keepdims=True).reshape(shape)


def _moved(function: Any, given: Any, *arguments: Any, **options: Any) -> TracedArray:
    """What a function that only moves elements makes of an array, or of a sequence of arrays.

    It is applied to the places of the elements too, which tell where cotangents belong.
    """
    parts = list(given) if isinstance(given, list | tuple) else [given]
    values = [np.asarray(plain(x)) for x in parts]
    ends = np.cumsum([x.size for x in values])
    places = [end - x.size + np.arange(x.size).reshape(x.shape) for end, x in zip(ends, values, strict=True)]

    def apply(arrays: list[Any]) -> Any:
        return function(arrays if isinstance(given, list | tuple) else arrays[0], *arguments, **options)

    where = apply(places)
    traced = [(x, end) for x, end in zip(parts, ends, strict=True) if isinstance(x, TracedArray)]

    def pull(g: Any) -> Contributions:
        total = np.bincount(np.ravel(where), np.ravel(g), minlength=ends[-1])
        return [(x, total[end - x.value.size : end].reshape(x.shape)) for x, end in traced]

    return traced[0][0].derived(apply(values), pull, *(x for x, _ in traced))  # type: ignore[return-value]


def _sum(x: TracedArray, axis: Any = None, keepdims: bool = False, **options: Any) -> Any:
    kept = np.sum(x.value, axis=axis, keepdims=True, **options).shape
    value = np.sum(x.value, axis=axis, keepdims=keepdims, **options)
    return _derived(value, (x, lambda g: np.broadcast_to(np.reshape(g, kept), x.shape)))


def _mean(x: TracedArray, axis: Any = None, keepdims: bool = False) -> Any:
    kept = np.mean(x.value, axis=axis, keepdims=True)
    weight = kept.size / x.value.size
    value = np.mean(x.value, axis=axis, keepdims=keepdims)
    return _derived(value, (x, lambda g: np.broadcast_to(np.reshape(g, kept.shape) * weight, x.shape)))


def _extreme(best: Callable[..., Any], x: TracedArray, axis: Any = None, keepdims: bool = False) -> Any:
    """The largest or smallest elements, where ``best`` says which it is along the last axis."""
    axes = tuple(range(x.ndim)) if axis is None else tuple(n % x.ndim for n in np.atleast_1d(axis))
    rest = [n for n in range(x.ndim) if n not in axes]
    rows: Any = _moved(np.transpose, x, (*rest, *axes)).reshape(*(x.shape[n] for n in rest), -1)
    found: Any = np.take_along_axis(rows, best(value_of(rows), axis=-1)[..., None], axis=-1)[..., 0]
    return found.reshape([1 if n in axes else length for n, length in enumerate(x.shape)]) if keepdims else found


def _var(x: TracedArray, axis: Any = None, ddof: float = 0, keepdims: bool = False) -> Any:
    middle = np.mean(x.value, axis=axis, keepdims=True)
    weight = 2.0 / (x.value.size / middle.size - ddof)
    value = np.var(x.value, axis=axis, ddof=ddof, keepdims=keepdims)
    return _derived(value, (x, lambda g: np.reshape(g, middle.shape) * (x.value - middle) * weight))


def _std(x: TracedArray, axis: Any = None, ddof: float = 0, keepdims: bool = False) -> Any:
    value = np.std(x.value, axis=axis, ddof=ddof, keepdims=keepdims)
    twice = np.where(value > 0, 2.0 * value, np.inf)  # where all are equal it has no derivative: 0
    return _derived(value, (_var(x, axis, ddof=ddof, keepdims=keepdims), lambda g: g / twice))


def _norm(x: TracedArray, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    if ord not in (None, 2) or np.size(axis) > 1 or (ord == 2 and axis is None and x.ndim > 1):
        raise TypeError(f"norm: ord {ord!r} along {axis!r} is not traced; give lengths of vectors")
    length: Any = np.linalg.norm(x.value, axis=axis, keepdims=True)
    slope = x.value / np.where(length > 0, length, np.inf)  # at 0 it has no derivative: 0
    value = length if keepdims else np.squeeze(length, axis)
    return _derived(value, (x, lambda g: np.reshape(g, length.shape) * slope))


def _clip(x: Any, a_min: Any = None, a_max: Any = None, *, min: Any = None, max: Any = None) -> Any:
    low, high = a_min if min is None else min, a_max if max is None else max
    return np.minimum(np.maximum(x, -np.inf if low is None else low), np.inf if high is None else high)


def _cumsum(x: TracedArray, axis: int) -> Any:
    return _derived(np.cumsum(x.value, axis=axis), (x, lambda g: np.flip(np.cumsum(np.flip(g, axis), axis=axis), axis)))


def _diff(x: TracedArray, n: int = 1, axis: int = -1) -> Any:
    last: Any = _moved(np.moveaxis, x, axis, -1)
    for _ in range(n):
        last = last[..., 1:] - last[..., :-1]
    return np.moveaxis(last, -1, axis)


def _where(condition: Any, x: Any, y: Any) -> Any:
    chosen = plain(condition)
    value = np.where(chosen, plain(x), plain(y))
    return _derived(value, (x, lambda g: np.where(chosen, g, 0.0)), (y, lambda g: np.where(chosen, 0.0, g)))


def _cross(a: Any, b: Any) -> Any:
    """Cross product of vectors along the last axis."""
    u, v = plain(a), plain(b)
    return _derived(np.cross(u, v), (a, lambda g: np.cross(v, g)), (b, lambda g: np.cross(g, u)))


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.sum: _sum,
    np.mean: _mean,
    **dict.fromkeys((np.max, np.amax), partial(_extreme, np.argmax)),
    **dict.fromkeys((np.min, np.amin), partial(_extreme, np.argmin)),
    np.var: _var,
    np.std: _std,
    np.linalg.norm: _norm,
    np.clip: _clip,
    np.cumsum: _cumsum,
    np.diff: _diff,
    np.cross: _cross,
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.size: lambda x: x.size,
    np.dot: lambda x, y: x @ y,
    np.zeros_like: lambda x: np.zeros(x.shape),
    np.ones_like: lambda x: np.ones(x.shape),
}
_MOVES = {np.reshape, np.ravel, np.moveaxis, np.swapaxes, np.transpose, np.expand_dims, np.squeeze, np.broadcast_to}
_MOVES |= {np.concatenate, np.stack, np.repeat, np.tile, np.roll, np.flip, np.take_along_axis, np.atleast_1d}
