"""The numbered environments of a task, as worlds."""

from dataclasses import dataclass

from robots.robot import World


@dataclass(frozen=True)
class Environment(World):
    """One of the numbered environments of a task: where a robot starts, or where the light is.

    Attributes:
        number: counted from 1.
    """

    number: int

    @property
    def name(self) -> str:
        """The number."""
        return str(self.number)

    @property
    def spoken(self) -> str:
        """The environment in words, such as ``environment 1``."""
        return f"environment {self.number}"

    @classmethod
    def parse(cls, text: str, count: int = 4) -> "Environment":
        """The environment of a number up to ``count``.

        Raises:
            ValueError: for anything else.
        """
        if not text.isdecimal() or not 1 <= int(text) <= count:
            raise ValueError(f"environment: {text!r} is not allowed; give a whole number from 1 to {count}")
        return cls(int(text))
