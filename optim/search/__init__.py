"""Search methods, one a file, all ask and tell over arrays. Knows neither robots nor physics."""

from collections.abc import Mapping
from inspect import signature
from typing import Any

from optim.hints import nearest
from optim.search.borg import Borg
from optim.search.cma import CMAESWithMargin
from optim.search.cma_gradient import CMAGradient
from optim.search.differential_evolution import DifferentialEvolution
from optim.search.generating_set import GeneratingSetSearch
from optim.search.genetic import GeneticSearch
from optim.search.gradient import GradientAscent
from optim.search.hill_climb import HillClimb
from optim.search.independent import IndependentSearches
from optim.search.map_elites import MapElites
from optim.search.memetic import MemeticSearch
from optim.search.method import Method, SearchResult, check_table
from optim.search.nes import SeparableNES
from optim.search.nsga2 import NSGA2
from optim.search.population import PopulationSearch
from optim.search.random_search import RandomSearch
from optim.space import Space

__all__ = [
    "METHODS",
    "NSGA2",
    "Borg",
    "CMAESWithMargin",
    "CMAGradient",
    "DifferentialEvolution",
    "GeneratingSetSearch",
    "GeneticSearch",
    "GradientAscent",
    "HillClimb",
    "MapElites",
    "MemeticSearch",
    "Method",
    "RandomSearch",
    "SearchResult",
    "SeparableNES",
    "build_method",
    "check_settings",
    "default_settings",
]

METHODS: dict[str, type[IndependentSearches | PopulationSearch]] = {
    "borg": Borg,
    "cma": CMAESWithMargin,
    "cma-gradient": CMAGradient,
    "de": DifferentialEvolution,
    "generating-set": GeneratingSetSearch,
    "genetic": GeneticSearch,
    "gradient": GradientAscent,
    "hill-climb": HillClimb,
    "map-elites": MapElites,
    "memetic": MemeticSearch,
    "nes": SeparableNES,
    "nsga2": NSGA2,
    "random": RandomSearch,
}


def build_method(name: str, space: Space, settings: Mapping[str, Any]) -> Method:
    """The method of a name in ``METHODS``, with settings by name such as climbers and seed.

    Raises:
        ValueError: in one line, for an unknown name, or a setting that the method does not take or allow.
    """
    check_settings(name, settings)
    return METHODS[name](space, **settings)


def check_settings(name: str, settings: Mapping[str, Any]) -> None:
    """Raise a one-line ValueError for an unknown method, or a setting that it does not take."""
    if name not in METHODS:
        raise ValueError(f"method: {name!r} is unknown; choose one of {', '.join(METHODS)}")
    allowed = list(signature(METHODS[name]).parameters)[1:]
    for setting, value in settings.items():
        if setting not in allowed:
            settings_of = f"its settings are {', '.join(allowed)}"
            raise ValueError(f"{setting}: method {name} does not take it; {settings_of}{nearest(setting, allowed)}")
        if value is None:
            raise ValueError(f"{setting}: nothing is not allowed; give a value, or leave it out")
        if setting == "start":
            check_table(setting, value)


def default_settings(name: str) -> dict[str, Any]:
    """What a method in ``METHODS`` does where nothing else is set, by the names of its settings."""
    parameters = signature(METHODS[name]).parameters.values()
    return {p.name: p.default for p in parameters if p.default is not p.empty and p.default is not None}
