"""Read numbers and directions from the attributes of XML elements."""

from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.base.arrays import Floats


def named(element: Element) -> str:
    """Name of an element for messages."""
    name = element.get("name")
    return f"{element.tag} {name}" if name else element.tag


def numbers(element: Element, attribute: str, default: str | None = None, count: int | None = None) -> Floats:
    """Read the numbers in an attribute.

    Raises:
        ValueError: if it is missing, or does not hold ``count`` finite numbers.
    """
    text = element.get(attribute, default)
    if text is None:
        raise ValueError(f"{named(element)}: {attribute} is missing; give it")
    try:
        found = np.array(text.split(), float)
    except ValueError:
        found = np.array([np.nan])
    if not np.isfinite(found).all() or (count is not None and len(found) != count):
        wanted = "finite numbers" if count is None else f"{count} finite number{'s' * (count > 1)}"
        raise ValueError(f"{named(element)}: {attribute} {text!r} is not allowed; give {wanted}")
    return found


def number(element: Element, attribute: str, default: str | None = None) -> float:
    """Read an attribute with a single number, with the errors of :func:`numbers`."""
    return float(numbers(element, attribute, default, 1)[0])


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
