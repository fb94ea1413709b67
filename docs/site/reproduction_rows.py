"""A row of the tables of docs/reproduction.md, and how the committed data is read for it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optim.experiments.data import Data

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "reproduction.md"


@dataclass(frozen=True)
class Row:
    """A result beside the published one, and the run that it comes from."""

    what: str
    published: str
    here: str
    n: str
    share: str  # of the published budget
    command: str
    seeds: str
    differs: str  # what differs from the published, and why


def data(*place: str) -> Data:
    """A folder of the committed data."""
    return Data(DOCS.joinpath("data", *place))


def summary(study: str) -> Any:
    """What the summary of a study holds."""
    return data(study).from_summary(lambda record: record)


def band(found: Any, digits: int, value: str = "mean") -> str:
    """A value of a record and its interval."""
    return f"{found[value]:.{digits}f} [{found['low']:.{digits}f}, {found['high']:.{digits}f}]"


def percent(share: float) -> str:
    """A share in per cent, to two digits, of which 100 has no exponent."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def reproduced(study: str, budget: str = "full") -> str:
    """The command that runs a study."""
    return f"morpholab reproduce {study} --budget {budget}"
