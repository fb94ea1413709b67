"""What rigs make of tables of channels: lags, delays and limits of rate act on a cycle that repeats."""

import dataclasses

import numpy as np
import pytest

from robots.hardware import OwnLines, PneumaticRig
from robots.hardware.channel_play import NODES, waves_behind
from robots.hardware.channel_table import PressureScale, Rhythm, Wave, channel_table

FREQUENCY = 0.1  # Hz


def rig_with(name="rig", **settings) -> PneumaticRig:
    fields = {"slew_kpa_per_s": 1e5, "valve_delay_s": 0.0, "resolution_kpa": 0.0, "lag_s": 0.0, **settings}
    plain = PneumaticRig()
    return dataclasses.replace(
        plain, name=name, channels=tuple(dataclasses.replace(each, **fields) for each in plain.channels)
    )


def table(nodes=64, rig=None, frequency=FREQUENCY):
    turns = 2 * np.pi * np.arange(nodes) / nodes
    calibration = PressureScale(0.0, 1.0, 0.0, 20.0)
    waves = [
        Wave("left", 0.5 + 0.4 * np.sin(turns), calibration, {}),
        Wave("right", 0.5 + 0.3 * np.cos(turns), calibration, {}),
    ]
    return channel_table("robot", waves, Rhythm(frequency, 3, 0.5, nodes), rig or rig_with())


def harmonic(values):
    """The first harmonic of a cycle, a complex amplitude, and its mean."""
    found = np.fft.rfft(values) / len(values)
    return 2 * found[1], float(found[0].real)


def test_a_rig_without_delays_and_lag_plays_the_rows():
    left, right = waves_behind(table(nodes=NODES), rig_with())
    played = table(nodes=NODES).played()
    np.testing.assert_allclose(left.values, played[0].values, atol=1e-9)
    np.testing.assert_allclose(right.values, played[1].values, atol=1e-9)


@pytest.mark.parametrize("lag", [0.3, 2.0, 8.0])
def test_a_lag_takes_height_and_phase_from_a_sine(lag):
    """1 / (1 + i w T) of a wave of angular frequency w, however long it takes until cycles repeat."""
    waves = waves_behind(table(), rig_with(lag_s=lag))
    response = 1 / (1 + 2j * np.pi * FREQUENCY * lag)
    for wave, sent in zip(waves, (-0.4j, 0.3), strict=True):
        found, mean = harmonic(wave.values)
        assert found == pytest.approx(sent * response, abs=2e-3) and mean == pytest.approx(0.5, abs=1e-4)


def test_a_delay_shifts_a_wave():
    left, right = waves_behind(table(), rig_with(valve_delay_s=1.25))
    played = [wave.values[:: 64 // NODES] for wave in table().played()]
    np.testing.assert_allclose(left.values, np.roll(played[0], 2), atol=1e-9)
    np.testing.assert_allclose(right.values, np.roll(played[1], 2), atol=1e-9)


@pytest.mark.parametrize("cycles", [1, 2, 5, 30])
@pytest.mark.parametrize("rest", [0.0, 0.05])
def test_delays_of_whole_cycles_change_no_cycle_that_repeats(cycles, rest):
    """Lines rest until a delay has passed, cycle after cycle: that is not yet the cycle that repeats."""
    quick = table(frequency=4.0)
    late = cycles * quick.durations["main"] + rest  # of rounded times of rows
    found, once = (waves_behind(quick, rig_with(valve_delay_s=delay, lag_s=0.02)) for delay in (late, rest))
    for wave, expected in zip(found, once, strict=True):
        assert np.ptp(wave.values) > 0.5
        np.testing.assert_allclose(wave.values, expected.values, atol=1e-5)


def test_a_limit_of_rate_makes_a_triangle_of_a_quick_sine():
    slowest = rig_with(slew_kpa_per_s=1.0)  # kPa/s, 5 in half a cycle, of the 16 that the sine asks for
    left, _ = waves_behind(table(), slowest)
    assert 5.0 - 1.0 / NODES / FREQUENCY < np.ptp(left.values * 20.0) <= 5.0  # peaks may lie between nodes
    changes = np.abs(np.diff(np.append(left.values, left.values[0]) * 20.0)) * NODES * FREQUENCY
    assert changes.max() == pytest.approx(1.0, abs=1e-6) and (changes > 0.99).sum() >= NODES - 2


def test_a_table_of_other_lines_is_refused():
    lines = OwnLines(("left", "right"), off_kpa=(0.0, 0.0), on_kpa=(20.0, 20.0))
    other = PneumaticRig(name="other", channels=rig_with().channels[:2], lines=lines)
    with pytest.raises(ValueError, match=r"^rig: other has 2 lines, the table has 11"):
        waves_behind(table(), other)
