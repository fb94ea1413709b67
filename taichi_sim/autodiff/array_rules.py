"""Derivatives of NumPy's elementary functions and of matrix products, for arrays that are traced."""

from collections.abc import Callable
from typing import Any

import numpy as np


def _of_left(g: Any, out: Any, x: Any, y: Any) -> Any:
    """Cotangent of the left factor of a matrix product; vectors are one row, and one column."""
    if np.ndim(y) == 1:
        return g[..., None] * y
    return np.matmul(g, np.swapaxes(y, -1, -2)) if np.ndim(x) > 1 else np.matmul(y, g[..., None])[..., 0]


def _of_right(g: Any, out: Any, x: Any, y: Any) -> Any:
    """Cotangent of the right factor."""
    if np.ndim(y) == 1:
        return g[..., None] * x
    return np.matmul(np.swapaxes(x, -1, -2), g) if np.ndim(x) > 1 else x[:, None] * g[..., None, :]


def _positive(length: Any) -> Any:
    """A length by which to divide; where it is 0 there is no derivative, and 0 is told."""
    return np.where(length > 0, length, np.inf)


# Cotangents of the operands from that of the result g, the result, and the operands.
RULES: dict[Any, tuple[Callable[..., Any], ...]] = {
    np.add: (lambda g, out, x, y: g, lambda g, out, x, y: g),
    np.subtract: (lambda g, out, x, y: g, lambda g, out, x, y: -g),
    np.multiply: (lambda g, out, x, y: g * y, lambda g, out, x, y: g * x),
    np.divide: (lambda g, out, x, y: g / y, lambda g, out, x, y: -g * out / y),
    np.power: (
        lambda g, out, x, y: g * y * np.power(x, y - 1),
        lambda g, out, x, y: g * out * np.log(np.where(x > 0, x, 1.0)),
    ),
    np.maximum: (lambda g, out, x, y: np.where(x >= y, g, 0.0), lambda g, out, x, y: np.where(x >= y, 0.0, g)),
    np.minimum: (lambda g, out, x, y: np.where(x <= y, g, 0.0), lambda g, out, x, y: np.where(x <= y, 0.0, g)),
    np.negative: (lambda g, out, x: -g,),
    np.absolute: (lambda g, out, x: g * np.sign(x),),
    np.square: (lambda g, out, x: 2.0 * g * x,),
    np.sqrt: (lambda g, out, x: 0.5 * g / out,),
    np.exp: (lambda g, out, x: g * out,),
    np.log: (lambda g, out, x: g / x,),
    np.sin: (lambda g, out, x: g * np.cos(x),),
    np.cos: (lambda g, out, x: -g * np.sin(x),),
    np.tan: (lambda g, out, x: g * (1.0 + out * out),),
    np.arcsin: (lambda g, out, x: g / np.sqrt(1.0 - x * x),),
    np.arccos: (lambda g, out, x: -g / np.sqrt(1.0 - x * x),),
    np.arctan: (lambda g, out, x: g / (1.0 + x * x),),
    np.sinh: (lambda g, out, x: g * np.cosh(x),),
    np.cosh: (lambda g, out, x: g * np.sinh(x),),
    np.tanh: (lambda g, out, x: g * (1.0 - out * out),),
    np.expm1: (lambda g, out, x: g * (out + 1.0),),
    np.log1p: (lambda g, out, x: g / (1.0 + x),),
    np.logaddexp: (lambda g, out, x, y: g * np.exp(x - out), lambda g, out, x, y: g * np.exp(y - out)),
    np.hypot: (lambda g, out, x, y: g * x / _positive(out), lambda g, out, x, y: g * y / _positive(out)),
    **dict.fromkeys((np.deg2rad, np.radians), (lambda g, out, x: g * (np.pi / 180.0),)),
    **dict.fromkeys((np.rad2deg, np.degrees), (lambda g, out, x: g * (180.0 / np.pi),)),
    np.arctan2: (lambda g, out, y, x: g * x / (x * x + y * y), lambda g, out, y, x: -g * y / (x * x + y * y)),
    np.matmul: (_of_left, _of_right),
}
CONSTANTS = {np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal, np.isfinite, np.isnan}
CONSTANTS |= {np.floor, np.ceil, np.rint, np.sign}
