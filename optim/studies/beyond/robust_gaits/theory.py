"""What statics allows on several floors, beside what searches find: a table of the steepest slopes of inching."""

from collections.abc import Mapping
from typing import Any

from optim.experiments.tables import markdown, page
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.robustness import HARD_FRICTION
from robots.inflatable.statics import steepest_inching
from robots.world import FLOORS

SHARES = (0.5, 0.25)  # of the load, on the foot that slides
SPREAD = 0.2  # of wood's friction, by which draws differ


def inching_text(settings: Mapping[str, Any]) -> str:
    """The page of the steepest slopes: of named floors, of the ends of draws, as published, and of the study's own."""
    published = ACTUATION.low_friction, ACTUATION.high_friction
    wood = FLOORS["wood"]
    pairs = {
        **FLOORS,
        f"wood, {100 * SPREAD:g} % less": tuple((1 - SPREAD) * each for each in wood),
        f"wood, {100 * SPREAD:g} % more": tuple((1 + SPREAD) * each for each in wood),
        "as published": published,
        "published grip, sliding feet that rub": (HARD_FRICTION, published[1]),
    }
    if "friction" in settings:
        pairs["of this study"] = tuple(settings["friction"])
    rows = [
        (name, f"{low:g}", f"{high:g}", *(f"{steepest_inching(low, high, share):.1f}" for share in SHARES))
        for name, (low, high) in pairs.items()
    ]
    header = ("floor", "sliding", "gripping", *(f"at {100 * share:g} % [°]" for share in SHARES))
    return page(
        "The steepest slope up which two feet inch, by statics: atan(gripping * (1 - share) - sliding * share), with "
        "shares of the load on the foot that slides. Feet that always carry the same: 50 %.",
        markdown(header, "lrrrr", rows),
    )
