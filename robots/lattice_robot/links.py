"""The law of the links between voxels, as an option of robots and in reports; ``LatticeBody`` says what laws do."""

from robots.outcome import Facts
from robots.robot import Option

USUAL = "alike"  # as in ``taichi_sim.lattice.body``, which is slow to import
LAWS = (USUAL, "balanced", "published")
LINKS_OPTION = Option(
    "links",
    "law of the links of voxels: damped alike at both ends; balanced, too, so that bodies do not turn themselves on "
    "dry ground; or as published (default: alike)",
    choices=LAWS,
)


def facts_of_links(law: str) -> Facts:
    """The row of a report that names the law; none for the usual one."""
    return [] if law == USUAL else [("Links", law)]
