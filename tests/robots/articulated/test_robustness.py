"""How far the speed of rigid robots can be trusted: what differs a little, friction, and shorter time steps."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from articulated_files import CRAWLER

from robots.articulated import ArticulatedRobot, simulate
from robots.articulated.robustness import DESIGNS, FINEST, trust_in
from robots.trust import FINER, FRICTIONS
from robots.world import Terrain
from taichi_sim.base.compute import Compute

pytestmark = [pytest.mark.kernels, pytest.mark.filterwarnings("ignore:model. ignored")]
HERE = {"precision": "f64", "threads": 1}


def test_each_change_is_what_it_says():
    robot = ArticulatedRobot(CRAWLER, duration=0.3)
    found = trust_in(robot, robot.start, robot.worlds[0], compute=Compute(**HERE))
    less = ArticulatedRobot(CRAWLER, duration=0.3, friction=0.75 * robot.physics.friction)
    assert found.changed["0.75 of the friction"] == simulate(less, [robot.start], **HERE).distance[0] / 0.3
    finer = ArticulatedRobot(CRAWLER, duration=0.3, time_step=0.005, command_rate=50.0)
    assert finer.hold == 2 * robot.hold
    assert found.changed[FINER] == simulate(finer, [robot.start], **HERE).distance[0] / 0.3
    assert list(found.changed) == [*(f"{part:g} of the friction" for part in FRICTIONS), FINER, FINEST]
    assert len(found.speeds) == DESIGNS and np.ptp(found.speeds) > 0
    again = trust_in(robot, robot.start, robot.worlds[0], compute=Compute(**HERE))
    other = trust_in(robot, robot.start, robot.worlds[0], seed=1, compute=Compute(**HERE))
    assert np.array_equal(again.speeds, found.speeds) and not np.array_equal(other.speeds, found.speeds)
    assert " m/s, " in found.judgement.text.splitlines()[0]


def test_friction_counts_only_where_there_is_some_and_steps_where_a_rhythm_plays():
    compute = Compute(**HERE)
    endless = ArticulatedRobot(CRAWLER, duration=0.2, friction=math.inf)
    found = trust_in(endless, endless.start, endless.worlds[0], compute=compute)
    assert list(found.changed) == [*(f"friction={part:g}" for part in (*FRICTIONS, 1.0)), FINER, FINEST]  # of its file
    own = ArticulatedRobot(CRAWLER, duration=0.2, friction=1.0)
    assert found.changed["friction=1"] == simulate(own, [own.start], **HERE).distance[0] / 0.2
    afloat = ArticulatedRobot(CRAWLER, duration=0.2)
    assert list(trust_in(afloat, afloat.start, Terrain.parse("water"), compute=compute).changed) == [FINER, FINEST]
    network = ArticulatedRobot(CRAWLER, duration=0.2, controller="network")
    assert len(trust_in(network, network.start, network.worlds[0], compute=compute).changed) == len(FRICTIONS)
    network = ArticulatedRobot(CRAWLER, duration=0.2, controller="network", friction=0.0)
    assert not network.design(network.start).can_be_judged and endless.design(endless.start).can_be_judged
    with pytest.raises(ValueError, match=r"^judge: a network without friction .* nothing to change; give --friction$"):
        trust_in(network, network.start, network.worlds[0], compute=compute)
    with pytest.raises(ValueError, match=r"^judge: a network without friction .* to change; leave --judge out$"):
        trust_in(network, network.start, Terrain.parse("water"), compute=compute)
    smooth = ArticulatedRobot(CRAWLER, duration=0.2, friction=0.0)
    assert list(trust_in(smooth, smooth.start, smooth.worlds[0], compute=compute).changed) == [FINER, FINEST]


def test_a_design_is_judged_by_the_command_that_its_search_names(morpholab, tmp_path):
    Path("crawler.xml").write_text(CRAWLER)
    search = "codesign --robot crawler.xml --duration 0.3 --threads 1 --method hill-climb --climbers 2 --generations 1"
    code, out, _ = morpholab(f"{search} --out run")
    assert code == 0 and "how far to trust it: morpholab simulate --robot run --judge" in out
    code, out, error = morpholab("simulate --robot run --judge --threads 1 --json")
    told = json.loads(out)
    assert len(told["speeds"]) == DESIGNS and set(told) > {"changed", "kept", "broken_by", "unsettled_by"}, error
    assert code in (0, 1)
