"""Rows of what bodies do to learning beyond two wheels, which chapters 4 and 6 ask for, in docs/reproduction.md."""

import numpy as np
from reproduction_rows import Row, band, reproduced, summary

from optim.measures.statistics import difference_of_means

NOTHING = "asked, no value"
SEEDS = "not published"


def learning() -> list[Row]:
    """Studies of soft bodies that learn, forget, evolve, share a controller, and notice the ground."""
    return [*_foretold(), *_forgetting(), _evolved(), _universal(), _noticed()]


def _foretold() -> list[Row]:
    """Whether M_L foretells the evaluations that learning needs."""
    rows = []
    differs = {
        "body-and-learning": "fewer in bodies of higher M_L, as in vehicles",
        "pouches-and-learning": "as in vehicles for evolution and gradients; runs differ more than bodies",
    }
    for study, bodies in {"body-and-learning": "soft walkers", "pouches-and-learning": "inflatable bodies"}.items():
        found = summary(study)
        kinds = {"evolution": "evolution", "nes": "evolution strategies", "gradient": "gradients"}
        told = [f"{title} {band(found['correlations'][f'M_L {name}'], 2, 'r')}" for name, title in kinds.items()]
        rows.append(
            Row(
                f"M_L with the evaluations that learning needs, {bodies}, Spearman's r",
                NOTHING,
                ", ".join(told),
                f"{found['bodies']} bodies",
                SEEDS,
                reproduced(study, "medium"),
                "of each body",
                f"{differs[study]}; [more](body-and-learning.md)",
            )
        )
    return rows


def _forgetting() -> list[Row]:
    """How much of what is left of two tasks bodies and methods explain."""
    found, rows = summary("forgetting"), []
    differs = {
        "vehicle": "bodies explain more, as asked; they differ in M_L, too",
        "quadruped": "neither is shown to explain any",
        "walker": "neither is shown to explain any; five bodies of each level are few",
    }
    for robot, title in {"vehicle": "vehicles", "quadruped": "quadrupeds", "walker": "soft walkers"}.items():
        parts = found["analyses"][f"{robot} worse"]
        told = [
            f"{name} {parts[part]['omega']:.2f} [{parts[part]['omega_low']:.2f}, {parts[part]['omega_high']:.2f}]"
            for part, name in (("rows", "body"), ("columns", "method"))
        ]
        rows.append(
            Row(
                f"worse of two tasks learned in turn, explained by M_CI of the body and by the method, {title}",
                "a good body avoids forgetting",
                ", ".join(told),
                f"{2 * found['settings'][robot]['bodies']} bodies",
                SEEDS,
                reproduced("forgetting", "medium"),
                "of each body",
                f"{differs[robot]}; [more](forgetting.md)",
            )
        )
    return rows


def _evolved() -> Row:
    """What asking for M_CI gives evolved vehicles."""
    bodies = summary("evolving-vehicles")["bodies"]
    told = []
    for name, title, form in (("M_CI", "M_CI", "+.2f"), ("evolution", "evaluations of evolution", "+.1f")):
        one = difference_of_means(np.array(bodies["performance"][name]), np.array(bodies["resistance"][name]), True)
        told.append(f"{title} {one.difference:{form}} [{one.low:{form}}, {one.high:{form}}]")
    return Row(
        "vehicles evolved for performance and M_CI, less those for performance",
        NOTHING,
        ", ".join(told),
        f"{len(bodies['performance']['M_CI'])} seeds",
        SEEDS,
        reproduced("evolving-vehicles", "medium"),
        f"0 to {len(bodies['performance']['M_CI']) - 1}",
        "better learners, a millimetre worse; [more](evolving-bodies.md)",
    )


def _universal() -> Row:
    """One controller for many bodies beside training in each."""
    found = summary("universal-control")
    arms, settings = found["arms"], found["settings"]
    one = difference_of_means(np.array(arms["each"]["speeds"]), np.array(arms["universal"]["speeds"]), paired=True)
    return Row(
        "one controller for all bodies, less training in each, at equal cost [BL/s]",
        NOTHING,
        f"{one.difference:+.2f} [{one.low:+.2f}, {one.high:+.2f}]",
        f"{settings['seeds']} seeds, {settings['tested']} unseen bodies",
        SEEDS,
        reproduced("universal-control", "medium"),
        f"0 to {settings['seeds'] - 1}",
        f"trained on {settings['trained']} bodies; [more](universal-control.md)",
    )


def _noticed() -> Row:
    """How far a machine goes that feels the ground, beside one that is told it."""
    found = summary("sense-and-switch")
    one = found["machines"]["sensing"]
    return Row(
        "a machine that feels that the ground changed, share of the way of one that is told",
        NOTHING,
        band(one, 2, "share"),
        f"{found['settings']['seeds']} repertoires of gaits, {found['settings']['held_out']} courses",
        SEEDS,
        reproduced("sense-and-switch", "medium"),
        f"0 to {found['settings']['seeds'] - 1}",
        "nothing is lost by sensing; [more](sense-and-switch.md)",
    )
