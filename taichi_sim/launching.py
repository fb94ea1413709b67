"""Launches of a kernel again and again, at a fraction of Taichi's price of a call.

Taichi checks and hands over every argument anew in Python, which for the lattice's kernels takes longer than ten steps
of a robot. On a CPU the argument block of the last call is kept: in the next one only numbers, and arrays that are
others, are set. On a GPU, whose launches use the block up, it is filled anew, without the checks. This reaches into
Taichi's internals; where these are others, every call is an ordinary one. So it is on a GPU if a kernel is given an
array of NumPy, which has to be copied there and back.
"""

import weakref
from collections.abc import Callable, Sequence
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
        last: the number, or the array, weakly: an engine's memory goes when the engine does.
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


def _nothing() -> None:
    """What there is before the first call."""


class Handed:
    """The arguments of a launch, kept so that unchanged ones are not looked at again."""

    def __init__(self, bundles: tuple[Any, ...]) -> None:
        """Hold the bundles, so that no other can have their identity."""
        self.bundles = bundles


class Relauncher:
    """Calls one kernel; remembers the argument block of the last call."""

    def __init__(
        self,
        ti: Any,
        kernel: Any,
        places: Sequence[tuple[int, int | None]] | None = None,
        go_on: Callable[[], object] = _nothing,
    ) -> None:
        """For a kernel of a compiler, ``ti``, that returns nothing.

        ``places`` tell where each argument is among what a call is given: in which bundle, and where in that, or None
        for one that is no bundle; without them there are no bundles. ``go_on`` is called before ordinary calls, as
        other code may have restarted the compiler.
        """
        self._ti, self._kernel, self._bundles, self._go_on = ti, kernel, places, go_on
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
        self._groups: list[list[tuple[_Place, int | None]]] = []  # places in each bundle
        self._handed: Callable[[], Handed | None] = _nothing  # weakly what the last call was given

    def __call__(self, *bundles: Any) -> Handed:
        """Launch the kernel. While what is returned is kept, bundles that are the same again are not looked at."""
        handed, self._handed = self._handed(), _nothing
        if handed is not None:
            new = [a is not b for a, b in zip(bundles, handed.bundles, strict=True)]
        else:
            new = [True] * len(bundles)
        if handed is None or True in new:
            handed = Handed(bundles)
        if self._block is not None and self._set(bundles, new):
            self._program.launch_kernel(self._compiled, self._block)
            self._handed = weakref.ref(handed)
        else:
            self._call(bundles)  # whose block is still empty
        return handed

    def _call(self, bundles: tuple[Any, ...]) -> None:
        """Launch the kernel as Taichi does."""
        self._go_on()
        places = self._bundles or [(number, None) for number in range(len(bundles))]
        arguments = tuple(bundles[i] if j is None else bundles[i][j] for i, j in places)
        self._kernel(*arguments)
        self._remember(arguments)
        if self._block is not None:
            pairs = list(zip(self._places, places, strict=True))
            self._groups = [[(place, j) for place, (i, j) in pairs if i == n] for n in range(len(bundles))]

    def _set(self, bundles: tuple[Any, ...], new: list[bool]) -> bool:
        """Set what differs from the last call; False if Taichi has begun anew, or an array is of another type."""
        if self._ti.lang.impl.get_runtime().prog is not self._program:
            return False
        if self._new_block is not None:
            self._block, new = self._new_block(), [True] * len(bundles)
        for bundle, places, other in zip(bundles, self._groups, new, strict=True):
            if other and not self._set_bundle(bundle, places):
                return False
        return True

    def _set_bundle(self, bundle: Any, places: list[tuple[_Place, int | None]]) -> bool:
        for place, j in places:
            given = bundle if j is None else bundle[j]
            if place.real is None:
                if place.inner is None:
                    if not self._set_array_of_device(place, given):
                        return False
                elif place.last() is not given and not self._set_array(place, given):
                    return False
            elif self._new_block is not None or place.last is not given:
                if place.real:
                    self._block.set_arg_float((place.number,), float(given))
                else:
                    self._block.set_arg_int((place.number,), int(given))
                place.last = given
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
