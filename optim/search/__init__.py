"""Search methods, one a file, all ask and tell over arrays. Knows neither robots nor physics."""

from collections.abc import Mapping
from inspect import signature
from typing import Any

from optim.search.cma import CMAESWithMargin
from optim.search.cma_gradient import CMAGradient
from optim.search.gradient import GradientAscent
from optim.search.hill_climb import HillClimb
from optim.search.independent import IndependentSearches
from optim.search.method import Method, SearchResult
from optim.search.nes import SeparableNES
from optim.search.population import PopulationSearch
from optim.search.random_search import RandomSearch
from optim.space import Space

__all__ = [
    "METHODS",
    "CMAESWithMargin",
    "CMAGradient",
    "GradientAscent",
    "HillClimb",
    "Method",
    "RandomSearch",
    "SearchResult",
    "SeparableNES",
    "build_method",
    "default_settings",
]

METHODS: dict[str, type[IndependentSearches | PopulationSearch]] = {
    "cma": CMAESWithMargin,
    "cma-gradient": CMAGradient,
    "gradient": GradientAscent,
    "hill-climb": HillClimb,
    "nes": SeparableNES,
    "random": RandomSearch,
}


def build_method(name: str, space: Space, settings: Mapping[str, Any]) -> Method:
    """The method of a name in ``METHODS``, with settings by name such as climbers and seed.

    Raises:
        ValueError: in one line, for an unknown name, or a setting that the method does not take or allow.
    """
    if name not in METHODS:
        raise ValueError(f"method: {name!r} is unknown; choose one of {', '.join(METHODS)}")
    allowed = list(signature(METHODS[name]).parameters)[1:]
    for setting in settings:
        if setting not in allowed:
            raise ValueError(
                f"{setting}: method {name} does not take it; its settings are {', '.join(allowed)}"
            )
    return METHODS[name](space, **settings)


def default_settings(name: str) -> dict[str, Any]:
    """What a method in ``METHODS`` does where nothing else is set, by the names of its settings."""
    parameters = signature(METHODS[name]).parameters.values()
    return {p.name: p.default for p in parameters if p.default is not p.empty and p.default is not None}
