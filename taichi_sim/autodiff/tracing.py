"""Laws, and reverse mode through them.

A law is a function over reals without loops or memory. The one source serves three uses: inside a kernel it compiles
like a ``ti.func``; on NumPy arrays it is plain Python; and on :class:`Traced` values, while a kernel is being compiled,
it writes down its operations, from which :func:`pull_back` emits the reverse pass into the same kernel. So gradients
run where the laws run, in native vectors or scalars, and a new law needs no derivative written by hand.

(Taichi's own reverse mode works on scalars only, needs every state kept apart, and is the check of this one.)
"""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import numpy as np

from taichi_sim.runtime import callable_in_kernels, emit, inside_kernel, ti

Contributions = list[tuple["Traced", Any]]


class Traced:
    """A real whose origin is remembered: an expression of the kernel being compiled, or a plain number.

    Attributes:
        value: the expression.
        pull: turns the cotangent of this real into those of its operands; None where no derivative is wanted.
    """

    def __init__(self, tape: list["Traced"], value: Any, pull: Callable[[Any], Contributions] | None = None) -> None:
        """Note a real; ``pull`` of a constant is None."""
        self.tape, self.value, self.pull = tape, emit(value), pull
        self.cotangent: Any = None
        if pull is not None:
            tape.append(self)

    @property
    def active(self) -> bool:
        """Whether derivatives flow through this real."""
        return self.pull is not None

    def derived(self, value: Any, pull: Callable[[Any], Contributions], *operands: Any) -> "Traced":
        """The result of an operation; constant if all its operands are."""
        active = any(isinstance(x, Traced) and x.active for x in (self, *operands))
        return type(self)(self.tape, value, pull if active else None)

    def __add__(self, other: Any) -> "Traced":
        return self.derived(self.value + plain(other), lambda g: [(self, g), (other, g)], other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Traced":
        return self.derived(self.value - plain(other), lambda g: [(self, g), (other, 0.0 - g)], other)

    def __rsub__(self, other: Any) -> "Traced":
        return self.derived(plain(other) - self.value, lambda g: [(self, 0.0 - g)])

    def __mul__(self, other: Any) -> "Traced":
        if isinstance(other, float) and other == 0.0:
            return Traced(self.tape, 0.0 * self.value)  # the laws' way to make a zero of the right kind
        return self.derived(
            self.value * plain(other), lambda g: [(self, g * plain(other)), (other, g * self.value)], other
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Traced":
        result: Traced

        def pull(g: Any) -> Contributions:
            share = emit(g / plain(other))
            return [(self, share), (other, 0.0 - share * result.value)]

        result = self.derived(self.value / plain(other), pull, other)
        return result

    def __rtruediv__(self, other: Any) -> "Traced":
        result: Traced
        result = self.derived(plain(other) / self.value, lambda g: [(self, 0.0 - g * result.value / self.value)])
        return result

    def __lt__(self, other: Any) -> "Condition":
        return Condition(self.value < plain(other))

    def __le__(self, other: Any) -> "Condition":
        return Condition(self.value <= plain(other))

    def __gt__(self, other: Any) -> "Condition":
        return Condition(self.value > plain(other))

    def __ge__(self, other: Any) -> "Condition":
        return Condition(self.value >= plain(other))

    def __eq__(self, other: object) -> "Condition":  # type: ignore[override]
        return Condition(self.value == plain(other))

    __hash__ = None  # type: ignore[assignment]


class Condition:
    """A comparison of traced reals. Which side each lane takes is decided when the kernel runs."""

    def __init__(self, value: Any) -> None:
        """Hold the expression of a mask."""
        self.value = emit(value)

    def __and__(self, other: Any) -> "Condition":
        return Condition(self.value & plain(other))

    __rand__ = __and__

    def __or__(self, other: Any) -> "Condition":
        return Condition(self.value | plain(other))

    __ror__ = __or__


def plain(x: Any) -> Any:
    """The expression or number itself."""
    return x.value if isinstance(x, Traced | Condition) else x


def pull_back(
    function: Callable[..., Any], inputs: Sequence[Any], constants: Sequence[Any], seeds: Sequence[Any]
) -> tuple[Any, ...]:
    """Emit the reverse pass of a law into the kernel being compiled; call it inside ``ti.static``.

    Args:
        function: the law; called as ``function(*inputs, *constants)``.
        inputs: reals to differentiate by.
        constants: what follows them; Python values select a branch at compile time, conditions and reals stay.
        seeds: cotangents of the law's results, in their order; None for a result that nothing depends on.

    Returns:
        Cotangents of the inputs.
    """
    tape: list[Traced] = []
    leaves = [Traced(tape, x, lambda g: []) for x in inputs]
    fixed = [x if isinstance(x, bool | int | float | Condition) else Traced(tape, x) for x in constants]
    results = function(*leaves, *fixed)
    found = run_back(tape, leaves, results if isinstance(results, tuple) else (results,), seeds)
    return tuple(emit(0.0 * x.value if g is None else g) for x, g in zip(leaves, found, strict=True))


def run_back(
    tape: Sequence[Traced], leaves: Sequence[Traced], results: Sequence[Any], seeds: Sequence[Any]
) -> tuple[Any, ...]:
    """Take the cotangents of results back along a tape that begins with the leaves; None for a leaf without one."""
    for real in tape:
        real.cotangent = None
    for result, seed in zip(results, seeds, strict=True):
        if seed is not None and isinstance(result, Traced):
            _accumulate(result, seed)
    for real in reversed(tape[len(leaves) :]):
        if real.cotangent is not None and real.pull is not None:
            for operand, share in real.pull(emit(real.cotangent)):
                _accumulate(operand, share)
    return tuple(leaf.cotangent for leaf in leaves)


def _accumulate(real: Any, share: Any) -> None:
    if isinstance(real, Traced) and real.active:
        real.cotangent = share if real.cotangent is None else real.cotangent + share


def primitive(function: Callable[..., Any]) -> Any:
    """A plain Python function that laws and kernels may call: it handles every kind of real itself."""
    return callable_in_kernels(function)


def law(function: Callable[..., Any]) -> Any:
    """Declare a function over reals a law."""
    compiled = ti.func(function)

    @primitive
    @wraps(function)
    def call(*arguments: Any) -> Any:
        if any(isinstance(a, Traced | Condition) for a in arguments) or not inside_kernel():
            return function(*arguments)
        return compiled(*arguments)

    return call


def law_with_derivative(derivative: Callable[[Any, Any], Any]) -> Callable[[Callable[[Any], Any]], Any]:
    """Declare a function of one real a law whose derivative, a law of (argument, result), is known."""

    def decorate(function: Callable[[Any], Any]) -> Any:
        compiled = ti.func(function)

        @primitive
        @wraps(function)
        def call(x: Any) -> Any:
            if isinstance(x, Traced):
                value = emit(compiled(x.value))
                return x.derived(value, lambda g: [(x, g * derivative(x.value, value))])
            return compiled(x) if inside_kernel() else function(x)

        return call

    return decorate


@primitive
def select(condition: Any, x: Any, y: Any) -> Any:
    """x where the condition holds, else y."""
    if isinstance(condition, np.ndarray | np.bool_ | bool):
        return np.where(condition, x, y)
    mask = plain(condition)
    traced = [v for v in (x, y) if isinstance(v, Traced)]
    if not traced:
        return ti.select(mask, x, y)

    def pull(g: Any) -> Contributions:
        return [(x, ti.select(mask, g, 0.0)), (y, ti.select(mask, 0.0, g))]

    return traced[0].derived(ti.select(mask, plain(x), plain(y)), pull, *traced)


@primitive
def sqrt(x: Any) -> Any:
    """Square root."""
    if isinstance(x, Traced):
        result: Traced = x.derived(sqrt(x.value), lambda g: [(x, 0.5 * g / result.value)])
        return result
    return ti.sqrt(x) if inside_kernel() else np.sqrt(x)
