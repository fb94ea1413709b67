"""Search methods, which propose points (``ask``) and learn from their objectives (``tell``), for any problem.

Importing this package imports no method: each is imported when it is first used.
"""

from collections.abc import Mapping, Sequence
from inspect import signature
from typing import Any

from optim.search.method import Method, SearchResult
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.checks import nearest
from taichi_sim.base.lazy import exported
from taichi_sim.base.registry import Registry

METHODS: Registry[type[Method]] = Registry(
    "morpholab.methods",
    "method",
    {
        "borg": "optim.search.borg:Borg",
        "cma": "optim.search.cma:CMAESWithMargin",
        "cma-mae": "optim.search.covariance_map:AnnealedMapElites",
        "cma-me": "optim.search.covariance_map:CovarianceMapElites",
        "cma-gradient": "optim.search.cma_gradient:CMAGradient",
        "de": "optim.search.differential_evolution:DifferentialEvolution",
        "generating-set": "optim.search.generating_set:GeneratingSetSearch",
        "genetic": "optim.search.genetic:GeneticSearch",
        "gradient": "optim.search.gradient:GradientAscent",
        "gradient-hill-climb": "optim.search.gradient_hill_climb:GradientHillClimb",
        "hill-climb": "optim.search.hill_climb:HillClimb",
        "lamarckian": "optim.search.lamarckian:LamarckianSearch",
        "map-elites": "optim.search.map_elites:MapElites",
        "memetic": "optim.search.memetic:MemeticSearch",
        "nes": "optim.search.nes:SeparableNES",
        "nsga2": "optim.search.nsga2:NSGA2",
        "race": "optim.search.race:GradientRace",
        "stochastic": "optim.search.stochastic:StochasticAscent",
        "random": "optim.search.random_search:RandomSearch",
    },
)
"""The search methods by name, those of installed packages among them."""
METHOD = "hill-climb"  # where none is named
MethodName = str | type[Method]  # a name in ``METHODS``, or a class of one's own that derives from ``Method``
_CLASSES = {place.partition(":")[2]: place.partition(":")[0] for place in METHODS.builtin.values()}

__all__ = [
    "METHOD",
    "METHODS",
    "Method",
    "SearchResult",
    "build_method",
    "check_objectives",
    "check_settings",
    "default_settings",
    "has_independent_climbers",
    "takes_several",
]


__getattr__, __dir__ = exported(__name__, _CLASSES)  # the classes of the built-in methods, such as HillClimb


def build_method(name: MethodName, space: Space, settings: Mapping[str, Any]) -> Method:
    """Build a search method for a space, from its name or class, with settings such as ``climbers`` and ``seed``.

    Raises:
        ValueError: if the name is unknown, a class is no method, or the method does not take or allow a setting.
    """
    check_settings(name, settings)
    build: Any = _class_of(name)
    method: Method = build(space, **settings)
    return method


def check_settings(name: MethodName, settings: Mapping[str, Any]) -> None:
    """Check that a method takes the given settings, without building it; values are checked when it is built.

    Raises:
        ValueError: if the method is unknown or does not take a setting, a value is None, or ``start`` is no table.
    """
    allowed = list(_parameters(name))[1:]
    for setting, value in settings.items():
        if setting not in allowed:
            known = f"its settings are {', '.join(allowed)}{nearest(setting, allowed)}"
            raise ValueError(f"{setting}: method {_name_of(name)} does not take it; {known}")
        if value is None:
            raise ValueError(f"{setting}: nothing is not allowed; give a value, or leave it out")
        if setting == "start":
            checks.table(setting, value)


def default_settings(name: MethodName) -> dict[str, Any]:
    """Return a method's default settings by name, without those whose default is None or missing."""
    parameters = _parameters(name).values()
    return {p.name: p.default for p in parameters if p.default is not p.empty and p.default is not None}


def check_objectives(name: MethodName, objectives: Sequence[str]) -> None:
    """Raise a one-line ValueError if a problem has several objectives, of these names, and a method takes one."""
    if len(objectives) > 1 and not takes_several(name):
        others = ", ".join(known for known in METHODS.builtin if takes_several(known))
        given = ", ".join(objectives)
        raise ValueError(
            f"method: {_name_of(name)} takes one objective, not {given}; choose one of {others}, or "
            "one objective, such as the sum of goals (summed=True of a problem)"
        )


def takes_several(name: MethodName) -> bool:
    """Whether a method takes several objectives and searches for their front; other methods take a single one."""
    return bool(getattr(_class_of(name), "several_objectives", False))


def has_independent_climbers(name: MethodName) -> bool:
    """Whether what a method keeps are the best points of climbers that have nothing of each other, so are samples."""
    return bool(getattr(_class_of(name), "independent_climbers", False))


def _parameters(name: MethodName) -> Mapping[str, Any]:
    return signature(_class_of(name)).parameters


def _class_of(name: MethodName) -> type[Method]:
    """The class of a method, which may be given itself."""
    if not isinstance(name, type):
        return METHODS.find(name)
    if Method not in name.__mro__:
        raise ValueError(f"method: {name.__name__} is no search method; derive it from optim.search.method.Method")
    return name


def _name_of(name: MethodName) -> str:
    return name.__name__ if isinstance(name, type) else name
