"""The benchmark runs and its figures are numbers; how large they are is for people to judge."""

import time
from argparse import Namespace

import pytest

from robots.bench import braitenberg as vehicle_bench
from robots.bench import devices
from robots.bench import lattice as bench
from robots.bench import quadruped as rigid_bench
from taichi_sim.lattice.drivers.roofline import measure_peak

pytestmark = pytest.mark.kernels


def test_the_peak_of_a_core_is_plausible():
    """Between a tenth of and ten times what today's cores do."""
    assert 1e9 < measure_peak("f32", seconds=0.05) < 1e12


@pytest.mark.slow
def test_all_figures(tmp_path, capsys):
    """With a prototype that claims a million robot-steps per second."""
    prototype = tmp_path / "prototype.py"
    prototype.write_text("print('f32: 1000000 robot-steps per CPU second')")
    args = Namespace(robot="inflatable", precision="f32", quick=True, prototype=prototype, json=False, against=None)
    figures = bench.main(args)["f32"]
    assert figures["ratio_to_prototype"] == figures["single_robot_steps_per_second"]["median"] / 1e6
    assert 0 < figures["part_of_peak"] < 1
    assert figures["kilobytes_per_robot"] < 850
    assert "robot-steps/s" in capsys.readouterr().out


def test_a_network_is_measured_over_many_readings(monkeypatch):
    """Also in a quick run: what a run with decisions costs once is little then."""
    pieces = []
    monkeypatch.setattr(bench, "beside", lambda other, steps: pieces.append((other.batch, steps)) or {})
    assert list(bench.networks("f64", 500)) == ["network", "network_of_several"]
    assert pieces == [(1, 2000), (bench.SEVERAL, 500)]


def test_rates_are_compared_with_those_of_version_1():
    mine = {"single_robot_steps_per_second": {"median": 30.0, "best": 40.0}, "gradient": {"steps_per_second": 8.0}}
    gradient = {"one_robot": {"in_its_own_forward_runs": 5.0}}
    other = {"single_robot_steps_per_second": {"median": 10.0, "best": 10.0}, "gradient": gradient}
    assert [line.split()[3:5] for line in bench.against_lines(mine, other, "f32")] == [
        ["3.00", "times"],
        ["robot", "4.00"],
    ]


@pytest.mark.slow
def test_figures_of_the_vehicle(tmp_path, capsys):
    """With a prototype that claims ten thousand rollouts per second."""
    prototype = tmp_path / "prototype.py"
    prototype.write_text("print('F f64: 10000 traj/s; done')")
    args = Namespace(robot="vehicle", quick=True, vehicle_prototype=prototype, json=False)
    figures = bench.main(args)["vehicle"]
    assert figures["ratio_to_prototype"] == figures["rollouts_per_core_second"]["f64"]["median"] / 1e4
    assert figures["gradients_per_core_second"] > 0 and figures["warping_distances_per_core_second"] > 0
    assert "rollouts/s" in capsys.readouterr().out


@pytest.mark.slow
def test_figures_of_rigid_robots(tmp_path, capsys):
    """With a prototype that claims a hundred thousand steps per second."""
    prototype = tmp_path / "prototype.py"
    prototype.write_text("print('wall 1 s: 100000 per core-second; bad 0')")
    args = Namespace(robot="rigid", quick=True, rigid_prototype=prototype, json=False)
    figures = bench.main(args)["rigid"]
    assert figures["ratio_to_prototype"] == figures["steps_per_core_second"]["f32"]["whegged"]["median"] / 1e5
    assert all(rate["best"] > 0 for of in figures["steps_per_core_second"].values() for rate in of.values())
    assert "whegged" in capsys.readouterr().out


@pytest.mark.slow
def test_rates_of_the_lattice_are_measured(monkeypatch):
    """Compiles the kernels of four kinds of robots."""
    monkeypatch.setattr(bench, "WARM_UP", 60)
    single = bench.Batch(1, "f32", 1)
    figures = {
        "single_robot_steps_per_second": bench.rates(time.process_time, single, 20, pieces=2),
        "gradient": bench.gradient_cost("f32", 20),
        **{name: bench.beside(bench.Batch(1, "f32", 1, ground), 20) for name, ground in bench.GROUNDS.items()},
        "network": bench.beside(bench.Batch(1, "f32", 1, network=bench.Network()), 120),
        "network_of_several": {"in_plain_steps": 1.1},
        "both": {"gradient_in_forward_runs": bench.gradient_cost("f32", 120, bench.UNEVEN, True)["in_forward_runs"]},
        "own_body": bench.own_bodies("f32"),
        "generation": bench.generation("f32", 1e-4),
        "million_voxel_steps_per_core_second": 1.0,
        "part_of_peak": 0.5,
        "first_step_s": single.first_step,
        "kilobytes_per_robot": single.engine.bytes_per_robot / 1e3,
        "ratio_to_prototype": 2.0,
        "two_threads": 1.9,
    }
    assert figures["uneven"]["in_plain_steps"] > 0.5 and figures["network"]["in_plain_steps"] > 0.5
    assert figures["both"]["gradient_in_forward_runs"] > 1 and figures["own_body"]["in_1000_steps"] > 0
    assert figures["gradient"]["in_forward_runs"] > 1 and figures["generation"]["core_hours"] > 0
    assert len(bench.lines(figures, "f32")) == 15


def test_batches_are_compared_in_the_same_parts_of_the_gait(monkeypatch):
    """Contact differs along it, and so does what a step costs."""
    monkeypatch.setattr(bench, "WARM_UP", 3)
    advanced = []
    whole = bench.Batch.advance
    monkeypatch.setattr(
        bench.Batch, "advance", lambda self, steps: advanced.append((id(self), self._done, steps)) or whole(self, steps)
    )
    found = bench.beside(bench.Batch(1, "f32", 1), 4)
    assert found["in_plain_steps"] > 0
    batches = list(dict.fromkeys(one for one, _, _ in advanced))
    other, plain = ([parts for each, *parts in advanced if each == one] for one in batches)
    assert len(batches) == 2 and plain == other and plain[-1] == [3 + 4 * (bench.PIECES - 1), 4]


def test_rates_of_the_lattice_are_told(monkeypatch):
    """Of one robot they are measured, the rest is invented."""
    monkeypatch.setattr(bench, "WARM_UP", 60)
    single = bench.Batch(1, "f32", 1)
    figures = {
        "single_robot_steps_per_second": bench.rates(time.process_time, single, 20, pieces=2),
        "gradient": {"in_forward_runs": 5.0, "megabytes": 1.0, "steps_per_second": 8.0, "steps": 20},
        "uneven": bench.beside(bench.Batch(1, "f32", 1), 20),
        "sand": {"in_plain_steps": 1.3},
        "shore": {"in_plain_steps": 1.7},
        "network": {"in_plain_steps": 1.3},
        "network_of_several": {"in_plain_steps": 1.1},
        "both": {"gradient_in_forward_runs": 6.0},
        "own_body": {"seconds": 0.02, "in_1000_steps": 1.0},
        "generation": {"core_hours": 1.0, "robot_steps_per_core_second": 9.0},
        "million_voxel_steps_per_core_second": 1.0,
        "part_of_peak": 0.5,
        "first_step_s": single.first_step,
        "kilobytes_per_robot": single.engine.bytes_per_robot / 1e3,
        "ratio_to_prototype": 2.0,
        "two_threads": 1.9,
    }
    assert figures["uneven"]["in_plain_steps"] > 0.5
    lines = bench.lines(figures, "f32")
    assert len(lines) == 15 and all(line.startswith("f32  ") for line in lines)
    assert lines[1].endswith("2.00") and lines[-1].endswith("1.90 times one")


def test_rates_of_vehicles_and_rigid_robots_are_measured_and_told(monkeypatch):
    monkeypatch.setattr(rigid_bench, "CONTROLLERS", 2)
    assert rigid_bench._rate(rigid_bench.LEGGED, "f32", 4) > 0
    assert vehicle_bench._gradient_rate(8) > 0 and vehicle_bench._warping_rate(51) > 0
    rate = {"median": 10.0, "best": 20.0}
    told = vehicle_bench.lines(
        {
            "rollouts_per_core_second": {"f64": rate, "prototype": rate},
            "gradients_per_core_second": 5.0,
            "warping_distances_per_core_second": 2.0,
            "ratio_to_prototype": 3.0,
        }
    )
    assert len(told) == 4 and "3.00" in told[1]
    figures = {"f32": {kind: rate for kind in ("legged", "wheeled", "whegged")}}
    told = rigid_bench.lines({"steps_per_core_second": figures, "first_call_s": 1.0, "ratio_to_prototype": 3.0})
    assert len(told) == 5 and "3.00" in told[3]


def test_a_device_is_compared_with_the_cpu(monkeypatch, capsys):
    """With the CPU in place of the device."""
    small = {
        "SETTLING": 20,
        "SHORTEST": 1e-6,
        "PIECE": 10,
        "GRADIENTS": {"quick": (1, 2)},
        "GRADIENT_STEPS": 10,
        "ROUNDS": 1,
    }
    small |= {"BATCHES": {"quick": (1, 2)}, "CONTROLLERS": 2, "VEHICLE_STEPS": 10, "QUADRUPED_STEPS": 3}
    for name, value in small.items():
        monkeypatch.setattr(devices, name, value)
    figures = devices.main(Namespace(robot="all", precision="f32", quick=True, json=False, device="cpu"))["f32"]
    batches = figures["inflatable"]["batches"]
    assert list(batches) == [1, 2] and all(found["robot_steps_per_second"] > 0 for found in batches.values())
    gradients = figures["inflatable"]["gradients"]
    rates = [
        *({"cpu": gradients["cpu"], "device": gradients["device"][n]} for n in (1, 2)),
        figures["vehicle"][16],
        figures["rigid"][64],
    ]
    assert all(rate["device"] > 0 and rate["cpu"] > 0 for rate in rates)
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 8 and "1.00 of the cpu" in told[1] and "robot-steps" in told[-1]
