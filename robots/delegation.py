"""Forwards what a class does not define to another object, so that no new member is forgotten."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, TypeVar

Class = TypeVar("Class", bound=type)


def public_members(cls: type) -> dict[str, Any]:
    """Public methods and attributes of a class and its bases, by name; None for those that are only declared."""
    found: dict[str, Any] = {}
    for base in reversed(cls.__mro__[:-1]):
        declared = {name: None for name in inspect.get_annotations(base) if name not in found}
        found |= declared | dict(vars(base))
    return {name: member for name, member in found.items() if not name.startswith("_")}


def first_argument(member: Any) -> str:
    """Name of the first argument of a method after ``self``; empty for other members."""
    names = list(inspect.signature(member).parameters)[1:2] if inspect.isfunction(member) else []
    return names[0] if names else ""


def delegating(to: str, completed: Mapping[str, str]) -> Callable[[Class], Class]:
    """Let a class ask another object for all public members of its bases that it does not define itself.

    Args:
        to: the attribute that holds the object.
        completed: methods that make the first argument that the object needs of the one that is given, by its name.
    """

    def decorate(cls: Class) -> Class:
        for name, member in public_members(cls).items():
            if name not in vars(cls):
                setattr(cls, name, _asking(to, name, member, completed))
        return cls

    return decorate


def _asking(to: str, name: str, member: Any, completed: Mapping[str, str]) -> Any:
    """A member that asks the object."""
    if not inspect.isfunction(member):
        return property(lambda self: getattr(getattr(self, to), name), doc=inspect.getdoc(member))
    argument = first_argument(member)
    complete = completed.get(argument, "")

    @wraps(member)
    def ask(self: Any, *given: Any, **settings: Any) -> Any:
        if complete and argument in settings:
            settings[argument] = getattr(self, complete)(settings[argument])
        elif complete and given:
            given = (getattr(self, complete)(given[0]), *given[1:])
        return getattr(getattr(self, to), name)(*given, **settings)

    return ask
