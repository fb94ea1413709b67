"""Read numbers, directions and keywords from the attributes of XML elements."""

import re
from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, shown

_OF_NUMBERS = re.compile(r"[0-9.eE+\-\s]*", re.ASCII)  # what remains of Python's syntax is that of C and XML
_INTEGER = re.compile(r"[+-]?[0-9]{1,10}", re.ASCII)


def named(element: Element) -> str:
    """Name of an element for messages."""
    name = element.get("name")
    return f"{element.tag} {name}" if name else element.tag


def numbers(element: Element, attribute: str, default: str | None = None, count: int | None = None) -> Floats:
    """Read the numbers in an attribute.

    Raises:
        ValueError: if it is missing, or does not hold ``count`` finite numbers, or any.
    """
    text = element.get(attribute, default)
    if text is None:
        raise ValueError(f"{named(element)}: {attribute} is missing; give it")
    try:
        found = np.array(text.split() if _OF_NUMBERS.fullmatch(text) else [np.nan], float)
    except ValueError:
        found = np.array([np.nan])
    if not len(found) or not np.isfinite(found).all() or (count is not None and len(found) != count):
        wanted = "finite numbers" if count is None else f"{count} finite number{'s' * (count > 1)}"
        raise ValueError(f"{named(element)}: {attribute} {shown(text)} is not allowed; give {wanted}")
    return found


def with_numbers(values: Iterable[float]) -> str:
    """Write numbers as the text of an attribute, from which the same numbers are read."""
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)


def number(element: Element, attribute: str, default: str | None = None) -> float:
    """Read an attribute with a single number, with the errors of :func:`numbers`."""
    return float(numbers(element, attribute, default, 1)[0])


def integer(element: Element, attribute: str, default: str) -> int:
    """Read an attribute with a whole number of 32 bits.

    Raises:
        ValueError: if it holds anything else.
    """
    text = element.get(attribute, default).strip()
    if not _INTEGER.fullmatch(text) or not -(2**31) <= int(text) < 2**31:
        raise ValueError(f"{named(element)}: {attribute} {shown(text)} is not allowed; give a whole number")
    return int(text)


def limits(element: Element, attribute: str, limited: str, automatic: bool) -> tuple[float, float] | None:
    """Read two limits that hold only if the element says so, or may be told from their being given.

    Args:
        element: that has them.
        attribute: of the limits; ``0 0`` counts as none.
        limited: attribute that says whether they hold: ``true``, ``false`` or, by default, ``auto``.
        automatic: whether ``auto`` is allowed of limits that are given; they hold then.

    Returns:
        The lower and the upper limit, or None without.

    Raises:
        ValueError: for limits that are missing, or not in order, or if it is not told whether they hold.
    """
    rule = keyword(element, limited, "auto", "true", "false")
    low, high = numbers(element, attribute, None if rule == "true" else "0 0", 2)
    if rule == "auto" and (low or high) and not automatic:
        raise ValueError(
            f"{named(element)}: {attribute} without {limited} is not allowed with autolimits false; give it"
        )
    if rule == "false" or (rule == "auto" and not (low or high)):
        return None
    if not low < high:
        raise ValueError(
            f"{named(element)}: {attribute} {element.get(attribute)!r} is not allowed; give two limits, the lower first"
        )
    return float(low), float(high)


def not_negative(owner: Element, attribute: str, value: float) -> float:
    """Return a value that was read for an element.

    Raises:
        ValueError: if it is below 0.
    """
    if value < 0:
        raise ValueError(f"{named(owner)}: {attribute} {value:g} is not allowed; give at least 0")
    return value


def keyword(element: Element, attribute: str, default: str, *others: str) -> str:
    """Read an attribute that is one of a few words; ``default`` if it is missing.

    Raises:
        ValueError: for another word.
    """
    return choice(f"{attribute} of {named(element)}", element.get(attribute, default), (default, *others))


def direction(element: Element, attribute: str, default: str) -> Floats:
    """Read an attribute with three numbers as a unit vector; the errors are those of :func:`numbers` and ``unit``."""
    found = numbers(element, attribute, default, 3)
    length = np.linalg.norm(found)
    if length < 1e-12:
        raise ValueError(f"{named(element)}: {attribute} {element.get(attribute)!r} is not allowed; give a direction")
    return found / length


def single(element: Element, tag: str) -> Element | None:
    """Return the only child with a tag, or None if there is none.

    Raises:
        ValueError: if there are several.
    """
    found = element.findall(tag)
    if len(found) > 1:
        raise ValueError(f"{named(element)}: {len(found)} elements {tag} are not allowed; give one")
    return found[0] if found else None


def with_names(elements: Iterable[Element], kind: str) -> Iterator[str]:
    """Yield the names that elements have, of which no two may be the same.

    Raises:
        ValueError: if two have the same name.
    """
    found = set()
    for element in elements:
        name = element.get("name")
        if name in found:
            raise ValueError(f"{kind} {name}: the name is given twice; give each {kind} a name of its own")
        if name:
            found.add(name)
            yield name
