"""Every field of a material goes where it belongs: into the tables, the channels, the gradient, and a robot's rest."""

from dataclasses import fields

import numpy as np
import pytest

from robots.lattice_robot.drive import Drive
from robots.lattice_robot.robot import LatticeRobot
from taichi_sim.lattice import LatticeBody, Material, Quantity
from taichi_sim.lattice.material_gradient import material_gradients
from taichi_sim.lattice.materials import BEAM_FIELDS, CHANNEL_FIELDS, VOXEL_FIELDS, channel_values
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import memory
from taichi_sim.lattice.stages.tables import build_tables

TISSUES = (
    Material(3e5, 1e3, 0.1, 0.9, 0.7, 0.8, 0.02, 0.6, (1.1, 0.9, 1.2), 1e-3, 4.0, "one"),
    Material(2e5, 2e3, 0.2, 0.5, 0.4, 0.3, 0.01, 0.7, (0.8, 1.3, 1.0), 2e-3, 5.0, "two"),
)
BODY = LatticeBody(np.array([[0, 0, 0], [1, 0, 0]]), TISSUES, [0, 1], 0.01, regions=[0, 1])
DAMPING_AS_PRESSURE = "internal_damping", Quantity.PRESSURE  # a further field that a channel holds


def test_every_field_is_accounted_for():
    """One that is in none of the lists would do nothing, and its derivatives would be zero without an error."""
    assert {*VOXEL_FIELDS, *BEAM_FIELDS, *CHANNEL_FIELDS} == {f.name for f in fields(Material)} - {"name"}


def test_what_channels_hold():
    held = channel_values(TISSUES[0])
    told = {0: 1.1, 1: 0.9, 2: 1.2, 3: 4.0, 4: 0.9, 5: 0.7, 6: 0.02}
    assert held.tolist() == [told.get(quantity, 0.0) for quantity in range(QUANTITY_COUNT)]


@pytest.mark.parametrize("further", [False, True])
def test_tables_robots_and_gradients_go_by_one_map(further, monkeypatch):
    if further:
        monkeypatch.setitem(CHANNEL_FIELDS, *DAMPING_AS_PRESSURE)
    tables = build_tables([BODY], 1e-5)
    channels = tables.channel.reshape(1, 2, QUANTITY_COUNT, memory.CHANNEL_WIDTH)
    robot = LatticeRobot(BODY, (Drive("all", (0, 1), "scale"),))
    for region, material in enumerate(TISSUES):
        held = channel_values(material)
        assert held[Quantity.PRESSURE] == (material.internal_damping if further else 0.0)
        for place in (memory.BASE, memory.VALUE):
            assert np.array_equal(channels[0, region, :, place], held)
        assert [robot.rest(region, quantity) for quantity in range(QUANTITY_COUNT)] == held.tolist()
    bases = 1.0 + np.arange(2.0 * QUANTITY_COUNT).reshape(1, 2, QUANTITY_COUNT)
    none = np.zeros_like(tables.constant), np.zeros_like(tables.beam)
    found = material_gradients([BODY], tables, 1e-5, *none, bases)
    by_channel = {name: found.pop(name) for name in CHANNEL_FIELDS}
    for name, quantity in CHANNEL_FIELDS.items():
        width = np.size(getattr(TISSUES[0], name))
        assert np.array_equal(by_channel[name].reshape(2, width), bases[0, :, quantity : quantity + width]), name
    assert set(found) == {*VOXEL_FIELDS, *BEAM_FIELDS} - set(CHANNEL_FIELDS)
    assert not any(derivatives.any() for derivatives in found.values())
