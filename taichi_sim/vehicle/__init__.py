"""Simulation of Braitenberg vehicles: light sensors that drive two motors through a linear controller."""

from taichi_sim.vehicle.gradient import Slopes, VehicleGradient, differentiate
from taichi_sim.vehicle.rollout import Rollouts, rollout
from taichi_sim.vehicle.task import VehicleBatch, VehicleTask
from taichi_sim.vehicle.trace import Traces, trace

__all__ = [
    "Rollouts",
    "Slopes",
    "Traces",
    "VehicleBatch",
    "VehicleGradient",
    "VehicleTask",
    "differentiate",
    "rollout",
    "trace",
]
