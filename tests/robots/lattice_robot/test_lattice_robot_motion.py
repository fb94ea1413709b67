"""Motions of lattice robots."""

import numpy as np
import pytest

from robots.lattice_robot import walker
from robots.lattice_robot.motion import lattice_robot_motion


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
