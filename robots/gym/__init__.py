"""Robots as Gymnasium environments, for any reinforcement-learning library; importing this registers them.

``gymnasium.make("morpholab/Vehicle-v0")`` makes one; ``ENVIRONMENTS`` names all. Needs the extra ``gym``.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from robots.tasks import Task, builtin_tasks, is_bound
from taichi_sim.base.foreign import install_extra

try:
    import gymnasium
except ModuleNotFoundError:
    raise ModuleNotFoundError(f"gymnasium is missing; {install_extra('gym')}") from None

# Identifier: (classes for one robot and for many, steps of the published experiment, arguments).
ENVIRONMENTS: Mapping[str, tuple[str, int, Mapping[str, Any]]] = MappingProxyType(
    {
        "morpholab/Pancake-v0": ("inflatable:Pancake", 16, {}),
        "morpholab/Vehicle-v0": ("vehicle:Vehicle", 10_000, {}),
        "morpholab/LeggedQuadruped-v0": ("quadruped:Quadruped", 999, {"kind": "legged"}),
        "morpholab/WheeledQuadruped-v0": ("quadruped:Quadruped", 999, {"kind": "wheeled"}),
        "morpholab/WheggedQuadruped-v0": ("quadruped:Quadruped", 999, {"kind": "whegged"}),
    }
)

# What rewards count in the environment of a task, by the measure of its objective.
GAINS = MappingProxyType(
    {
        "speed": "progress",
        "distance": "progress",
        "remaining": "light",
        "prop_distance": "prop",
        "turning": "turn",
        "jump": "rise",
    }
)


def task_settings(task: Task) -> dict[str, Any]:
    """Return the arguments of a task's environment: its robot, its first world, and the gain that rewards count."""
    words = ("mean", "worst", "each")
    (goal,) = (text for text in task.options["objective"] if text not in words and not is_bound(text))
    world = task.options["terrain"][0]
    return {"robot": task.source, "world": world, "gain": GAINS[goal.removeprefix("minimise:")]}


_made: dict[str, tuple[str, int | None, Mapping[str, Any]]] = {
    **ENVIRONMENTS,
    "morpholab/LatticeRobot-v0": ("lattice_robot:LatticeRobot", None, {}),
    "morpholab/ArticulatedRobot-v0": ("articulated:Articulated", None, {}),
    **{
        f"morpholab/{name.capitalize()}-v0": ("lattice_robot:LatticeRobot", None, task_settings(task))
        for name, task in builtin_tasks().items()
    },
}
for _name, (_classes, _steps, _given) in _made.items():
    if _name not in gymnasium.registry:
        gymnasium.register(
            _name,
            entry_point=f"robots.gym.{_classes}Environment",
            vector_entry_point=f"robots.gym.{_classes}Vector",
            max_episode_steps=_steps,
            kwargs=dict(_given),
        )
