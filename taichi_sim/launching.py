"""Launches of a kernel again and again, at a fraction of Taichi's price of a call.

Taichi checks and hands over every argument anew in Python, which for the lattice's kernels takes longer than ten steps
of a robot. On a CPU the argument block of the last call is kept: in the next one only numbers, and arrays that are
others, are set. On a GPU, whose launches use the block up, it is filled anew, without the checks. This reaches into
Taichi's internals; where these are others, every call is an ordinary one. So it is on a GPU if a kernel is given an
array of NumPy, which has to be copied there and back.
"""

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass
class _Place:
    """An argument of the last call.

    Attributes:
        number: of the argument.
        real: whether it is a real number; None of arrays.
        inner: dimensions of an array's elements, which its shape does not count; None of arrays on a GPU.
        like: type and dimensions of an array, for which the kernel was compiled.
        last: the array, weakly: an engine's memory goes when the engine does.
    """

    number: int
    real: bool | None
    inner: int | None = 0
    like: tuple[Any, int] = (None, 0)
    last: Any = None


_ALL: "weakref.WeakSet[Relauncher]" = weakref.WeakSet()  # of the runtime, which tells them when it begins anew


def forget_all() -> None:
    """Let the next call of every kernel be an ordinary one: before the runtime that they know ends."""
    for each in _ALL:
        each.forget()


class Relauncher:
    """Calls one kernel; remembers the argument block of the last call."""

    def __init__(self, ti: Any, kernel: Any) -> None:
        """For a kernel of a compiler, ``ti``, that returns nothing."""
        self._ti, self._kernel = ti, kernel
        self._primal: Any = getattr(kernel, "_primal", None)
        self.forget()
        _ALL.add(self)

    def forget(self) -> None:
        """Let the next call be an ordinary one."""
        self._places: list[_Place] = []
        self._block: Any = None
        self._new_block: Any = None
        self._program: Any = None
        self._compiled: Any = None

    def __call__(self, *arguments: Any) -> None:
        """Launch the kernel."""
        if self._block is not None and self._set(arguments):
            self._program.launch_kernel(self._compiled, self._block)
            return
        self._kernel(*arguments)
        self._remember(arguments)

    def _set(self, arguments: tuple[Any, ...]) -> bool:
        """Set what differs from the last call; False if Taichi has begun anew, or an array is of another type."""
        if self._ti.lang.impl.get_runtime().prog is not self._program:
            return False
        if self._new_block is not None:
            self._block = self._new_block()
        for place, given in zip(self._places, arguments, strict=True):
            if place.real is None:
                if place.inner is None:
                    if not self._set_array_of_device(place, given):
                        return False
                elif place.last() is not given and not self._set_array(place, given):
                    return False
            elif place.real:
                self._block.set_arg_float((place.number,), float(given))
            else:
                self._block.set_arg_int((place.number,), int(given))
        return True

    def _set_array(self, place: _Place, given: Any) -> bool:
        if not isinstance(given, np.ndarray) or (given.dtype, given.ndim) != place.like or not given.flags.c_contiguous:
            self._block = None
            return False
        shape = given.shape[: given.ndim - (place.inner or 0)]
        self._block.set_arg_external_array_with_shape((place.number,), given.ctypes.data, given.nbytes, shape, 0)
        place.last = weakref.ref(given)
        return True

    def _set_array_of_device(self, place: _Place, given: Any) -> bool:
        if not isinstance(given, self._ti.ScalarNdarray) or (given.dtype, len(given.shape)) != place.like:
            self._block = None
            return False
        self._block.set_arg_ndarray((place.number,), given.arr)
        return True

    def _remember(self, arguments: tuple[Any, ...]) -> None:
        """Make an argument block like that of an ordinary call, if all arguments are plain arrays and numbers."""
        self.forget()
        try:
            ti, program = self._ti, self._ti.lang.impl.get_runtime().prog
            on_cpu = program.config().arch in (ti.x64, ti.arm64)
            if not on_cpu and any(isinstance(given, np.ndarray) for given in arguments):
                return
            compiled_kernel = self._primal.compiled_kernels[self._primal.ensure_compiled(*arguments)]
            compiled = program.compile_kernel(program.config(), program.get_device_caps(), compiled_kernel)
            block, places = compiled_kernel.make_launch_context(), list[_Place]()
            for number, (given, argument) in enumerate(zip(arguments, self._primal.arguments, strict=True)):
                kind = argument.annotation
                if isinstance(given, np.ndarray):
                    inner = getattr(kind.dtype, "ndim", 0)
                    places.append(_Place(number, None, inner, (given.dtype, given.ndim), lambda: None))
                elif isinstance(given, ti.ScalarNdarray) and given.grad is None:
                    places.append(_Place(number, None, None, (given.dtype, len(given.shape))))
                elif id(kind) in ti.types.primitive_types.real_type_ids:
                    places.append(_Place(number, True))
                elif kind in (ti.i32, ti.i64):
                    places.append(_Place(number, False))
                else:
                    return
        except (AttributeError, TypeError, KeyError):  # another Taichi
            return
        self._places, self._block, self._program, self._compiled = places, block, program, compiled
        self._new_block = None if on_cpu else compiled_kernel.make_launch_context
