"""Simulation of articulated rigid bodies on level or uneven ground, in batches."""

from taichi_sim.rigid.engine import RigidEngine
from taichi_sim.rigid.model.settings import Network, Physics
from taichi_sim.rigid.model.shapes import Box, Capsule, Sphere
from taichi_sim.rigid.model.tree import Body, Hinge, Motor, Passive, Servo, Tree, Weld
from taichi_sim.rigid.pose import poses
from taichi_sim.rigid.session import RigidSession
from taichi_sim.rigid.state import Frames, RigidResult, State
from taichi_sim.rigid.tables import Senses

World = Physics  # its former name

__all__ = [
    "Body",
    "Box",
    "Capsule",
    "Frames",
    "Hinge",
    "Motor",
    "Network",
    "Passive",
    "Physics",
    "RigidEngine",
    "RigidResult",
    "RigidSession",
    "Senses",
    "Servo",
    "Sphere",
    "State",
    "Tree",
    "Weld",
    "World",
    "poses",
]
