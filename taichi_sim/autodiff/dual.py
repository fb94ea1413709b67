"""Arrays that carry their derivatives with respect to a few parameters: dual numbers, forward mode.

Source: Griewank & Walther, Evaluating Derivatives, 2nd ed., 2008, ch. 3. What is computed with ``Real`` numbers works
on plain arrays and on dual numbers, and the values come out with the same bits.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Union

import numpy as np

from taichi_sim.base.arrays import Bools, Floats

Real = Union[Floats, "Dual"]


@dataclass(frozen=True, eq=False)
class Dual:
    """An array of numbers and its derivatives.

    Attributes:
        value: the numbers, any shape.
        slope: their derivatives with respect to P parameters, the shape of ``value`` and P.
    """

    value: Floats
    slope: Floats

    __array_ufunc__ = None  # array + dual is dual's business

    def __getitem__(self, index: Any) -> "Dual":
        return Dual(self.value[index], self.slope[index])

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.slope)

    def __add__(self, other: float | Real) -> "Dual":
        return _new(self.value + value_of(other), self.slope + slope_of(other))

    def __sub__(self, other: float | Real) -> "Dual":
        return _new(self.value - value_of(other), self.slope - slope_of(other))

    def __rsub__(self, other: float | Real) -> "Dual":
        return _new(value_of(other) - self.value, slope_of(other) - self.slope)

    def __mul__(self, other: float | Real) -> "Dual":
        factor = value_of(other)
        return _new(self.value * factor, self.slope * factor[..., None] + slope_of(other) * self.value[..., None])

    def __truediv__(self, other: float | Real) -> "Dual":
        divisor = value_of(other)
        value = self.value / divisor
        return _new(value, (self.slope - slope_of(other) * value[..., None]) / divisor[..., None])

    def __rtruediv__(self, other: float | Real) -> "Dual":
        value = value_of(other) / self.value
        return _new(value, (slope_of(other) - self.slope * value[..., None]) / self.value[..., None])

    __radd__ = __add__
    __rmul__ = __mul__


def _new(value: Floats, slope: Floats) -> Dual:
    """A dual number of slopes that may still lack the axes of the value."""
    return Dual(value, np.broadcast_to(slope, (*value.shape, slope.shape[-1])))


def value_of(number: float | Real) -> Floats:
    """The numbers without their derivatives."""
    return number.value if isinstance(number, Dual) else np.asarray(number, float)


def slope_of(number: float | Real) -> Floats:
    """The derivatives; zeros that broadcast, shape (1,), for a plain number."""
    return number.slope if isinstance(number, Dual) else np.zeros(1)


def revalued(number: Real, values: Floats) -> Real:
    """Other values, of the same shape, with the derivatives of a number."""
    return Dual(values, number.slope) if isinstance(number, Dual) else values


def variables(values: Floats, first: int, count: int) -> Dual:
    """The parameters ``first``, ``first + 1``, ... of ``count``, in the order of ``values``."""
    slope = np.zeros((values.size, count))
    slope[np.arange(values.size), first + np.arange(values.size)] = 1.0
    return Dual(values, slope.reshape(*values.shape, count))


def where(condition: Bools, chosen: float | Real, other: float | Real) -> Real:
    """``numpy.where`` for values and slopes."""
    value = np.where(condition, value_of(chosen), value_of(other))
    if not isinstance(chosen, Dual) and not isinstance(other, Dual):
        return value
    return _new(value, np.where(condition[..., None], slope_of(chosen), slope_of(other)))


def sine(angle: float | Real) -> Real:
    """Sine of an angle [rad]."""
    return _apply(math.sin, math.cos, angle)


def cosine(angle: float | Real) -> Real:
    """Cosine of an angle [rad]."""
    return _apply(math.cos, lambda x: -math.sin(x), angle)


def _apply(function: Callable[[float], float], derivative: Callable[[float], float], number: float | Real) -> Real:
    """Number by number: NumPy's own functions may differ from those of ``math`` in the last bit."""
    if not isinstance(number, Dual):
        return np.vectorize(function, otypes=[float])(number)
    change = np.vectorize(derivative, otypes=[float])(number.value)
    return Dual(np.vectorize(function, otypes=[float])(number.value), number.slope * change[..., None])
