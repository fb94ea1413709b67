"""Rest sizes of voxels at the recorded steps of a program, and what they owe to its events."""

import numpy as np

from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeBody, LatticeProgram, Quantity


def rest_sizes(body: LatticeBody, program: LatticeProgram) -> Floats:
    """Rest size of every voxel at every snapshot [m], shape (B, S, V, 3).

    By what ``program.values_after`` says of its region's scale, or else, and before its first event, by its material.
    """
    events, elapsed = _last_events(program, body.region_count)
    sizes = np.array([m.scale for m in body.materials])[body.material_index]
    if len(program.events):
        told = program.events["value"][events] + program.events["rate"][events] * elapsed
        sizes = np.where((events >= 0)[:, :, body.regions], told[:, :, body.regions], sizes)
    shape = (*program.snapshots.shape, body.voxel_count, 3)
    return np.broadcast_to(sizes, shape) * body.voxel_size


def thermal_growth(body: LatticeBody, program: LatticeProgram) -> Floats:
    """1 + alpha T of every voxel at every snapshot, by which it grows beyond those sizes, shape (B, S, V, 1)."""
    events, elapsed = _last_events(program, body.region_count, Quantity.TEMPERATURE, 1)
    found = np.array([m.temperature for m in body.materials])[body.material_index][:, None]
    if len(program.events):
        told = program.events["value"][events] + program.events["rate"][events] * elapsed
        found = np.where((events >= 0)[:, :, body.regions], told[:, :, body.regions], found)
    alpha = np.array([m.thermal_expansion for m in body.materials])[body.material_index][:, None]
    return np.broadcast_to(1 + alpha * found, (*program.snapshots.shape, body.voxel_count, 1))


def pull_back_rest_sizes(body: LatticeBody, program: LatticeProgram, cotangents: Floats) -> tuple[Floats, Floats]:
    """Derivatives of a cost by the values and by the rates of all events, shape (E,) each, by way of the rest sizes.

    Args:
        body: of the robots.
        program: that they follow.
        cotangents: derivative of the cost by the rest sizes [1/m], shape (B, S, V, 3).
    """
    events, elapsed = _last_events(program, body.region_count)
    weights = np.zeros(events.shape)
    for region in range(body.region_count):
        weights[:, :, region] = cotangents[:, :, body.regions == region].sum(axis=2) * body.voxel_size
    given = events >= 0
    events, weights, elapsed = events[given], weights[given], elapsed[given]
    values, rates = np.zeros((2, len(program.events)))
    np.add.at(values, events, weights)
    np.add.at(rates, events, weights * elapsed)
    return values, rates


def _last_events(
    program: LatticeProgram, regions: int, quantity: int = Quantity.SCALE, width: int = 3
) -> tuple[Ints, Ints]:
    """Number of the event that channels follow at every snapshot, and the steps since, shape (B, S, R, width) each.

    The number is -1 where there is none yet.
    """
    robots = program.robot_count
    given = program.events["quantity"]
    numbers = np.flatnonzero((given >= quantity) & (given < quantity + width))
    events = program.events[numbers]
    channel = (events["robot"].astype(np.int64) * regions + events["region"]) * width + (events["quantity"] - quantity)
    order = np.lexsort((events["step"], channel))
    numbers, channel, step = numbers[order], channel[order], events["step"][order].astype(np.int64)
    asked = np.arange(robots * regions * width).reshape(robots, 1, regions, width)
    last = np.maximum(program.snapshots - 1, 0)[:, :, None, None]
    first, end = np.searchsorted(channel, asked), np.searchsorted(channel, asked, side="right")
    span = np.int64(2**31)  # more than any step
    place = np.searchsorted(channel * span + step, asked * span + last, side="right") - 1
    found = (first < end) & (place >= first)  # before its first event a channel is what the material says
    place = np.where(found, place, 0)
    if not len(numbers):
        return np.full(place.shape, -1), np.zeros(place.shape, np.int64)
    return np.where(found, numbers[place], -1), np.where(found, last - step[place], 0)
