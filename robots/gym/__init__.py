"""Robots as Gymnasium environments, for any reinforcement-learning library; importing this registers them.

``gymnasium.make("morpholab/Vehicle-v0")`` makes one; ``ENVIRONMENTS`` names all. Needs the extra ``gym``.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from robots.tasks import builtin_tasks
from taichi_sim.base.checks import install_extra

try:
    import gymnasium
except ModuleNotFoundError:
    raise ModuleNotFoundError(f"gymnasium is missing; {install_extra('gym')}") from None

# Identifier: (place of the class, steps of the published experiment, arguments).
ENVIRONMENTS: Mapping[str, tuple[str, int, Mapping[str, Any]]] = MappingProxyType(
    {
        "morpholab/Pancake-v0": ("robots.gym.pancake:PancakeEnvironment", 16, {}),
        "morpholab/Vehicle-v0": ("robots.gym.vehicle:VehicleEnvironment", 10_000, {}),
        "morpholab/LeggedQuadruped-v0": ("robots.gym.quadruped:QuadrupedEnvironment", 999, {"kind": "legged"}),
        "morpholab/WheeledQuadruped-v0": ("robots.gym.quadruped:QuadrupedEnvironment", 999, {"kind": "wheeled"}),
        "morpholab/WheggedQuadruped-v0": ("robots.gym.quadruped:QuadrupedEnvironment", 999, {"kind": "whegged"}),
    }
)

_LATTICE = "robots.gym.lattice_robot"
if "morpholab/LatticeRobot-v0" not in gymnasium.registry:
    gymnasium.register(
        "morpholab/LatticeRobot-v0",
        entry_point=f"{_LATTICE}:LatticeRobotEnvironment",
        vector_entry_point=f"{_LATTICE}:LatticeRobotVector",
    )
for _task in builtin_tasks():
    if (_name := f"morpholab/{_task.capitalize()}-v0") not in gymnasium.registry:
        gymnasium.register(
            _name,
            entry_point=f"{_LATTICE}:task_environment",
            vector_entry_point=f"{_LATTICE}:task_vector",
            kwargs={"task": _task},
        )
for _name, (_place, _steps, _arguments) in ENVIRONMENTS.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, entry_point=_place, max_episode_steps=_steps, kwargs=dict(_arguments))
