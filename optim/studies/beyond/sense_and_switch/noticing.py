"""How soon machines notice that the ground has changed, and how often they switch without need."""

from collections.abc import Sequence

import numpy as np

from optim.experiments.tables import Record
from robots.course import KINDS, Course
from taichi_sim.base.arrays import Floats, Ints

Noticed = Record  # a change of ground: from, to, and after how many looks the right gait played; None for never
LAST = 64  # looks before the end, after which a change of ground does not count


def noticed(
    course: Course, answers: Sequence[int], gaits: Ints, places: Floats
) -> tuple[list[Noticed], dict[str, int], float]:
    """What a machine made of the changes of ground on its way.

    A change counts if it wants another gait, and is not among the last ``LAST`` looks. It is noticed when the gait for
    the new ground first plays while the machine's middle is there. A switch is false if the gait is not that for
    the ground below the middle.

    Args:
        course: where.
        answers: the gait for each kind of ground.
        gaits: that were played, shape (L,).
        places: of the machine's middle [m], shape (L,).

    Returns:
        Each change, the numbers of switches and of false ones, and the share of looks with the right gait.
    """
    kinds, stretches, answer = course.kind(places), course.stretch(places), np.array(answers)
    right = gaits == answer[kinds]
    changes = list[Noticed]()
    for stretch in range(1, int(stretches.max()) + 1):
        entered = int(np.argmax(stretches >= stretch))
        before, now = course.kinds[stretch - 1], course.kinds[stretch]
        if answer[before] == answer[now] or entered >= len(places) - LAST:
            continue
        left = np.flatnonzero(stretches[entered:] > stretch)
        until = entered + int(left[0]) if len(left) else len(places)
        found = np.flatnonzero((gaits[entered:until] == answer[now]) & (stretches[entered:until] == stretch))
        changes.append({"from": KINDS[before], "to": KINDS[now], "looks": int(found[0]) if len(found) else None})
    switched = np.append(False, gaits[1:] != gaits[:-1])
    return changes, {"switches": int(switched.sum()), "false": int((switched & ~right).sum())}, float(right.mean())
