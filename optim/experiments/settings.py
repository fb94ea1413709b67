"""Settings of studies: dataclasses whose fields say what is allowed, and on which all results depend."""

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Any

from taichi_sim.base import checks

# Types of fields: whole numbers of at least 0, 1 and 2.
Whole = Annotated[int, partial(checks.integer, low=0)]
Count = Annotated[int, partial(checks.integer, low=1)]
Several = Annotated[int, partial(checks.integer, low=2)]
WHERE = ("device", "threads")  # fields that change no result


@dataclass(frozen=True)
class Settings:
    """Settings of a study, checked by the types of their fields (see ``checks.check_fields``)."""

    def __post_init__(self) -> None:
        checks.check_fields(self)

    def describe(self) -> dict[str, Any]:
        """Describe all that results depend on, for JSON."""
        return {name: value for name, value in asdict(self).items() if name not in WHERE}
