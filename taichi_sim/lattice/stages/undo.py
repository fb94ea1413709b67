"""What the reverses of all stages have in common."""

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

from taichi_sim.autodiff.lanes import accumulate_all, load_all, store
from taichi_sim.autodiff.tracing import primitive, pull_back
from taichi_sim.runtime import emit

Parts = TypeVar("Parts", bound=tuple[Any, ...])


@primitive
def in_parts(widths: Parts, flat: Sequence[Any]) -> Parts:
    """A sequence cut into parts by name: a named tuple like the one that says how wide each part is."""
    ends = list(accumulate(widths))
    if ends[-1] != len(flat):
        raise ValueError(f"{type(widths).__name__}: {len(flat)} numbers do not fit parts of {ends[-1]}")
    return type(widths)(*(tuple(flat[end - width : end]) for width, end in zip(widths, ends, strict=True)))


def _widths(parts: Any) -> Any:
    return type(parts)(*[len(part) for part in parts])


@primitive
def pull_back_parts(function: Any, inputs: Parts, constants: tuple[Any, ...], seeds: Sequence[Any]) -> Parts:
    """:func:`pull_back` of a function of two named tuples of tuples, the second constant: cotangents of the first."""
    widths, fixed = _widths(inputs), _widths(constants)
    flat, rest = (tuple(x for part in each for x in part) for each in (inputs, constants))

    def parted(*given: Any) -> Any:
        return function(in_parts(widths, given[: len(flat)]), in_parts(fixed, given[len(flat) :]))

    return in_parts(widths, pull_back(parted, flat, rest, seeds))


class Undo(NamedTuple):
    """The memories that the reverse of a step works on.

    Attributes:
        m, k: parameters of the step (channels and what follows from them), and the robot's or block's key to them.
        record, r: recorded states, and the key to them.
        a: cotangents, laid out as a robot's memory: of the state, and sums over time of those of the constants; key k.
        old, new: what shifts a slot of the state to the record before the step, and to that after it.
    """

    m: Any
    k: Any
    record: Any
    r: Any
    a: Any
    old: Any
    new: Any


@primitive
def before(u: Undo, slots: Sequence[Any]) -> tuple[Any, ...]:
    """The state before the step."""
    return load_all(u.record, u.r, [u.old + slot for slot in slots])


@primitive
def after(u: Undo, slots: Sequence[Any]) -> tuple[Any, ...]:
    """The state after the step."""
    return load_all(u.record, u.r, [u.new + slot for slot in slots])


@primitive
def parameters_of(u: Undo, slots: Sequence[Any]) -> tuple[Any, ...]:
    """Parameters of the step."""
    return load_all(u.m, u.k, slots)


@primitive
def cotangents_of(u: Undo, slots: Sequence[Any]) -> tuple[Any, ...]:
    """Cotangents as far as they are known."""
    return load_all(u.a, u.k, slots)


@primitive
def give(u: Undo, slots: Sequence[Any], cotangents: Sequence[Any]) -> None:
    """Add to cotangents."""
    accumulate_all(u.a, u.k, slots, cotangents)


@primitive
def take_all(u: Undo, slots: Sequence[Any]) -> tuple[Any, ...]:
    """Cotangents of slots that a step computes anew, and that nothing else depends on: they are zero afterwards."""
    given = tuple(emit(cotangent) for cotangent in load_all(u.a, u.k, slots))
    for slot, cotangent in zip(slots, given, strict=True):
        store(u.a, u.k, slot, 0.0 * cotangent)
    return given


@primitive
def reverse(
    u: Undo, law: Any, state: Sequence[Any], parameters: Sequence[Any], constants: Sequence[Any], seeds: Any
) -> None:
    """Add to the cotangents of what a law depends on.

    Args:
        u: memories of the step.
        law: of the state, the parameters and the constants.
        state: its slots; values are those before the step.
        parameters: their slots.
        constants: what has no derivatives here.
        seeds: cotangents of the law's results.
    """
    inputs = before(u, state) + parameters_of(u, parameters)
    give(u, [*state, *parameters], pull_back(law, inputs, constants, seeds))
