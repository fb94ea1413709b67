"""Random robots as URDF: links with inertias at any place, and joints that turn or do not.

Inertials are not turned: of them MuJoCo 3.3.7 passes over ``rpy``, against the specification of URDF.
"""

import numpy as np
from scipy.spatial.transform import Rotation

MUJOCO = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'  # else it joins fixed links


def numbers(values):
    return " ".join(f"{float(value):.12g}" for value in values)


def random_urdf(seed):
    """The text of a random robot."""
    rng = np.random.default_rng([20261127, seed])

    def origin(turned=True):
        place, turn = rng.uniform(-0.3, 0.3, 3), rng.uniform(-3, 3, 3)
        rpy = f' rpy="{numbers(turn)}"' if turned else ""
        return f'<origin xyz="{numbers(place)}"{rpy}/>' if rng.random() < 0.8 else ""

    def link(name):
        mass, edges = rng.uniform(0.2, 3), rng.uniform(0.05, 0.5, 3) ** 2
        turned = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        full = turned @ np.diag(mass / 12 * (edges.sum() - edges)) @ turned.T
        entries = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{full[a, b]:.12g}"' for a in range(3) for b in range(a, 3))
        matter = f'{origin(False)}<mass value="{mass:.12g}"/><inertia {entries}/>'
        return f'<link name="{name}"><inertial>{matter}</inertial></link>'

    def joint(child, parent):
        kind, axis = rng.choice(["revolute", "continuous", "fixed"]), rng.normal(size=3)
        low = rng.uniform(-2, 1)
        ends_of = f'lower="{low:.12g}" upper="{low + rng.uniform(0.1, 2):.12g}"' if kind == "revolute" else ""
        limit = f'<limit {ends_of} effort="3" velocity="2"/>'
        own = "" if kind == "fixed" else f'<axis xyz="{numbers(axis / np.linalg.norm(axis))}"/>{limit}'
        ends = f'<parent link="link-{parent}"/><child link="link-{child}"/>'
        return f'<joint name="joint-{child}" type="{kind}">{ends}{origin()}{own}</joint>'

    count = rng.integers(2, 7)
    joints = "".join(joint(child, rng.integers(child)) for child in range(1, count))
    return f'<robot name="random">{MUJOCO}{"".join(map(link, map("link-{}".format, range(count))))}{joints}</robot>'
