"""Motions of lattice robots."""

from dataclasses import replace

import numpy as np
import pytest

from robots.lattice_robot import Drive, LatticeRobot, simulate, walker
from robots.lattice_robot.motion import lattice_robot_motion
from taichi_sim.lattice import Material, body_from_array


@pytest.mark.kernels
def test_a_walker_shows_what_its_voxels_do():
    materials = np.full((3, 2, 2), walker.PASSIVE)
    materials[:, 0], materials[1, 1, 1] = walker.ACTIVE, walker.ANTIPHASE
    design = walker.WalkerDesign(materials)
    drive = walker.WalkerActuation(cycles=1, settling=0.05)
    result = walker.simulate(design, actuation=drive, precision="f32", record_every=40, threads=1)
    motion = lattice_robot_motion(result, walker.walker_robot(design, actuation=drive), name="walker")
    assert [node.channel for node in motion.nodes] == [{1: None, 2: 0, 3: 1}[k] for k in design.connected[1]]
    active = [n for n, node in enumerate(motion.nodes) if node.channel == 0]
    told = np.interp(motion.times, motion.channels[0].times, motion.channels[0].values)
    grows = np.corrcoef(motion.scale[:, active].mean(axis=(1, 2)), told)[0, 1]
    assert grows > 0.9
    wrong = walker.WalkerDesign(np.full((2, 2, 2), walker.ACTIVE))
    with pytest.raises(ValueError, match=r"^frames: they have 12 voxels, the robot 8; give its own$"):
        lattice_robot_motion(result, walker.walker_robot(wrong))


@pytest.mark.kernels
@pytest.mark.parametrize("amplitude", [0.0, (400.0, 300.0)])
def test_forces_of_pressure_are_those_of_the_drive(amplitude):
    """Two regions of four under pressure on top: pressure times area, and it swings as the wave does."""
    foam = Material(2e5, 1000.0, static_friction=1.0, kinetic_friction=0.5, name="foam")
    normals = np.zeros((4, 3), int)
    normals[:3, 2] = 1
    body = body_from_array(np.ones((4, 1, 1), int), foam, 0.01, regions=np.arange(4)[:, None, None])
    body = replace(body, pressure_normals=normals)
    drive = Drive("air", (0, 2), "pressure", mean=(1000.0, 600.0), amplitude=amplitude, phase=(0.0, 0.25))
    robot = LatticeRobot(body, (drive,), frequency=2.0, cycles=1, settling=0.05)
    every = robot.cycle.segment  # a frame at each node of the wave
    result = simulate(robot, record_every=every, precision="f64", threads=1)
    states = lattice_robot_motion(result, robot).lattice
    assert states.positions.shape[0] > 32 and np.ndim(states.pressure) == (2 if amplitude else 1)
    air, turns = np.zeros((len(states.positions), 3)), 2 * np.pi * np.arange(len(states.positions)) / 16
    first, second = amplitude or (0.0, 0.0)
    air[:, 0], air[:, 2] = 1000.0 + first * np.sin(turns), 600.0 + second * np.cos(turns)
    for frame in (0, 5, 12, 23):
        _, forces = states.pressure_forces(frame)
        area = states.extents[frame, :3].reshape(3, 3, 2).sum(axis=2)[:, :2].prod(axis=1)
        assert np.linalg.norm(forces, axis=1) == pytest.approx(air[frame] * area, rel=1e-9, abs=1e-9)
        _, again = states.part([frame]).pressure_forces(0)
        assert np.array_equal(again, forces)
