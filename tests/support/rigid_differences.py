"""Exact gradients of rigid robots beside central differences."""

from dataclasses import replace

import numpy as np


def error_of_gradient(engine, part, steps, commands, differences):
    """Least error of the derivatives by commands or a part of the start, relative, at the best of some differences.

    Of where a robot is, how it is turned and its angles after ``steps``, along eight random directions.
    """
    rng = np.random.default_rng(3)
    rest, aim, turn, of_angles = engine.rest(), rng.normal(size=3), rng.normal(size=4), rng.normal(size=2)
    values = {"commands": commands, **{name: getattr(rest, name) for name in ("position", "orientation")}}
    values |= {"angles": rest.angles}

    def arguments(**changed):
        given = {**values, **changed}
        count = max(map(len, given.values()))
        start = replace(rest, **{name: np.resize(x, (count, x.shape[1])) for name, x in given.items() if x.ndim == 2})
        start = replace(start, orientation=start.orientation / np.linalg.norm(start.orientation, axis=1)[:, None])
        return {"commands": given["commands"], "hold": 10, "start": start}

    def cost(changed):
        done = engine.run(steps, **arguments(**{part: changed}))
        assert (done.residual < 1e-9).all()
        return done.position @ aim + done.orientation @ turn + done.angles @ of_angles

    tape = engine.record(steps, **arguments())
    gradient = tape.pull_back(position=aim[None], orientation=turn[None], angles=of_angles[None])
    directions = rng.normal(size=(8, *values[part].shape[1:]))
    if part == "orientation":
        directions[:, 0] = 0.0  # along the sphere of unit quaternions
    slopes = getattr(gradient, part)
    if part == "position":
        slopes = slopes + gradient.places.sum(axis=1)  # bodies that may drift have places of their own
    found = (directions * slopes).reshape(8, -1).sum(1)
    errors = []
    for step in differences:
        shifted = values[part] + step * np.concatenate([directions, -directions])
        high, low = np.split(cost(shifted), 2)
        errors.append(np.linalg.norm(found - (high - low) / (2 * step)) / np.linalg.norm(found))
    return min(errors)
