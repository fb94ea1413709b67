"""Dynamic time warping against all paths written out, a plain double loop, closed forms and another library.

Mostly in f64 on one thread: Taichi starts anew for another setting.
"""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim import signals
from taichi_sim.autodiff.lanes import Real, choose_width

pytestmark = pytest.mark.kernels

warping_distances = partial(signals.warping_distances, threads=1)
SHAPES = ((1, 6), (6, 1), (2, 3), (17, 40), (40, 17), (60, 61))
SIGNAL = st.lists(st.integers(-9, 9).map(float), min_size=1, max_size=9)  # whole numbers: no rounding
SHORT = st.lists(st.integers(-9, 9).map(float), min_size=1, max_size=4)


def random_signals(pairs: int, samples: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng((seed, pairs, samples)).normal(size=(pairs, samples))


def cost(first: list[float], second: list[float]) -> float:
    """Cost of the cheapest path, not yet divided."""
    distance = warping_distances([first], [second])
    return float(distance[0]) * (len(first) + len(second))


def costs_of_paths(first: list[float], second: list[float], i: int = 0, j: int = 0) -> list[float]:
    """What each path from cell (i, j) to the last costs, cell (i, j) not counted."""
    if (i, j) == (len(first) - 1, len(second) - 1):
        return [0.0]
    return [
        weight * abs(first[i + down] - second[j + right]) + rest
        for down, right, weight in ((1, 0, 1), (0, 1, 1), (1, 1, 2))
        if i + down < len(first) and j + right < len(second)
        for rest in costs_of_paths(first, second, i + down, j + right)
    ]


def by_loops(first: np.ndarray, second: np.ndarray) -> float:
    """The distance as the recursion is written, with the whole matrix."""
    n, m = len(first), len(second)
    least = np.full((n + 1, m + 1), np.inf)
    for i in range(n):
        for j in range(m):
            c = abs(first[i] - second[j])
            before = least[i, j + 1] + c, least[i + 1, j] + c, least[i, j] + 2 * c
            least[i + 1, j + 1] = min(before) if i or j else c
    return float(least[n, m] / (n + m))


def test_distances_by_hand():
    assert warping_distances([[5.0]], [[3.0]]) == [1.0]  # the first cell counts once
    assert warping_distances([[0.0, 1.0, 2.0]], [[0.0, 2.0]]) == [0.2]
    assert warping_distances([[0.0, 0.0, 1.0, 1.0]], [[0.0, 1.0, 1.0, 1.0]]) == [0.0]


def test_two_flat_lines_are_apart_by_their_difference():
    for n, m in ((1, 1), (4, 9), (9, 4), (30, 31)):
        found = warping_distances(np.full((1, n), 2.5), np.full((1, m), 1.0))
        assert found == pytest.approx(1.5 * (n + m - 1) / (n + m), rel=1e-14)  # every path weighs the same


@given(SHORT, SHORT)
def test_no_path_is_cheaper_and_one_is_as_cheap(first, second):
    listed = abs(first[0] - second[0]) + min(costs_of_paths(first, second))
    assert cost(first, second) == pytest.approx(listed, rel=1e-15)


@pytest.mark.parametrize(("precision", "accuracy"), [("f64", 1e-14), ("f32", 1e-5)])
def test_distances_are_those_of_the_plain_recursion(precision, accuracy):
    for pairs in (1, 3, 37):
        for n, m in SHAPES:
            first, second = random_signals(pairs, n), random_signals(pairs, m, seed=1)
            reference = [by_loops(a, b) for a, b in zip(first, second, strict=True)]
            found = warping_distances(first, second, precision=precision)
            assert found == pytest.approx(reference, rel=accuracy)


def test_distances_are_those_of_dtw_python():
    import dtw  # greets whoever imports it

    first, second = random_signals(10, 50), random_signals(10, 70, seed=1).cumsum(axis=1)
    theirs = [dtw.dtw(a, b, step_pattern="symmetric2", distance_only=True) for a, b in zip(first, second, strict=True)]
    assert warping_distances(first, second) == pytest.approx([t.normalizedDistance for t in theirs], rel=1e-13)


@given(SIGNAL, SIGNAL)
def test_distances_are_symmetric_and_never_negative(first, second):
    there, back = warping_distances([first], [second]), warping_distances([second], [first])
    assert there == back and there >= 0


@given(SIGNAL, st.lists(st.integers(1, 4), min_size=9, max_size=9))
def test_a_signal_is_nowhere_from_itself_with_samples_repeated(signal, repeats):
    slower = np.repeat(signal, repeats[: len(signal)])
    assert cost(signal, signal) == cost(signal, slower) == cost(slower, signal) == 0


@given(SIGNAL, SIGNAL, st.integers(0, 8))
def test_repeating_a_sample_costs_no_more_than_its_nearest_and_saves_nothing(first, second, which):
    """Before the division by the lengths: the repeated sample is matched once more, with one that it had matched."""
    sample = first[which % len(first)]
    longer = [*first[: which % len(first)], sample, *first[which % len(first) :]]
    dearest = max(abs(sample - other) for other in second)
    before, after = cost(first, second), cost(longer, second)
    assert before - 1e-9 <= after <= before + dearest + 1e-9


@pytest.mark.parametrize("threads", [1, 2])
def test_bits_depend_on_no_batch_width_thread_or_launch(threads, monkeypatch):
    first, second = random_signals(21, 33), random_signals(21, 50, seed=1)
    expected = [by_loops(a, b) for a, b in zip(first, second, strict=True)]
    widths = [choose_width(pairs, "f64", threads, signals.BLOCK_COST) for pairs in (1, 21)]
    assert widths == [1, 8]
    for normalise in (False, True):
        distances = partial(warping_distances, normalise=normalise, threads=threads)
        whole = distances(first, second)
        alone = [distances(a[None], b[None]) for a, b in zip(first, second, strict=True)]
        shuffled = distances(first[::-2], np.asfortranarray(second)[::-2])
        assert np.array_equal(whole, np.concatenate(alone)) and np.array_equal(whole[::-2], shuffled)
        assert normalise or whole == pytest.approx(expected, rel=1e-14)
        with monkeypatch.context() as patch:
            patch.setattr(signals, "SAMPLES_PER_THREAD", 1)  # a block a thread and launch
            assert np.array_equal(whole, distances(first, second))


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_layout_for_gpus_gives_the_same_bits(precision):
    first, second = random_signals(21, 34), random_signals(21, 50, seed=1)
    expected = warping_distances(first, second, precision=precision)
    real = Real(precision, 1)
    on_device = signals._costs(real, False, first.astype(real.numpy), second.astype(real.numpy))
    assert np.array_equal(on_device / 84, expected)


def test_a_sample_that_is_no_number_spoils_its_own_pair_alone():
    first, second = random_signals(21, 12), random_signals(21, 9, seed=1)
    expected = warping_distances(first, second)
    first[2, 0] = first[3, 6] = first[4, 7] = second[5, 4] = first[20, 11] = second[20, 8] = np.nan
    first[9, 5], second[11, 0] = np.inf, -np.inf
    first[12, 3] = second[12, 6] = first[13, 6] = np.inf
    for normalise in (False, True):
        found = warping_distances(first, second, normalise=normalise)
        assert np.flatnonzero(np.isnan(found)).tolist() == [2, 3, 4, 5, 9, 11, 12, 13, 20]
    good = ~np.isnan(found)
    assert np.array_equal(warping_distances(first, second)[good], expected[good])


def test_what_a_precision_cannot_hold_fails():
    assert warping_distances([[1e39]], [[0.0]]) == [5e38]
    assert np.isnan(warping_distances([[1e39]], [[0.0]], precision="f32"))
    assert np.isnan(warping_distances([[1e308, 1e308]], [[-1e308, -1e308]]))  # the sum overflows


def test_normalised_signals_have_lost_offset_and_amplitude():
    first, second = random_signals(10, 40), random_signals(10, 30, seed=1)
    plain = warping_distances(first, second, normalise=True)
    assert warping_distances(first * 7e200, 0.3 * second - 5, normalise=True) == pytest.approx(plain, rel=1e-11)
    z = [(s - s.mean(axis=1, keepdims=True)) / s.std(axis=1, keepdims=True) for s in (first, second)]
    assert plain == pytest.approx(warping_distances(*z), rel=1e-12)
    assert warping_distances(3 * first + 1, first, normalise=True).max() < 1e-14
    assert warping_distances(3 * first + 1, first).min() > 0.1


def test_constant_signals_become_zeros():
    flat = np.full((1, 7), 0.1)  # whose mean is not quite 0.1
    wave = random_signals(1, 11)
    assert warping_distances(flat, -9 * flat, normalise=True) == 0
    z = (wave - wave.mean()) / wave.std()
    assert warping_distances(flat, wave, normalise=True) == pytest.approx(warping_distances(0 * flat, z), rel=1e-14)


def test_no_pairs_have_no_distances():
    assert warping_distances(np.empty((0, 5)), np.empty((0, 6))).shape == (0,)


@pytest.mark.parametrize(
    ("first", "second", "settings", "message"),
    [
        ([1.0, 2.0], [[1.0, 2.0]], {}, r"first: shape \(2,\) is not allowed; give signals of one length"),
        ([[1.0]], [[]], {}, r"second: shape \(1, 0\) is not allowed; .* at least one sample"),
        ([[1.0, 2.0], [1.0]], [[1.0]], {}, "first: these signals are not allowed; give signals of one length"),
        ([["high"]], [[1.0]], {}, "first: these signals are not allowed"),
        ([[1.0]], [[1.0], [2.0]], {}, r"second: shape \(2, 1\) is not allowed beside first of shape \(1, 1\)"),
        ([[1.0]], [[1.0]], {"precision": "f16"}, "precision: 'f16' is unknown; choose one of f32, f64"),
        ([[1.0]], [[1.0]], {"device": "gpu"}, "device: 'gpu' is unknown"),
        ([[1.0]], [[1.0]], {"threads": 0}, "threads: 0 is not allowed"),
    ],
)
def test_bad_input_is_refused_in_one_line(first, second, settings, message):
    with pytest.raises(ValueError, match=message) as refused:
        warping_distances(first, second, **settings)
    assert "\n" not in str(refused.value)
