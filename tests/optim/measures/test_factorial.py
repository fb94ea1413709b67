"""Analysis of variance of two factors against sums by hand, and against SciPy where one of them has one level."""

import numpy as np
import pytest

from optim.measures.factorial import two_way

rng = np.random.default_rng(3)


def test_sums_of_squares_by_hand():
    """Means of rows 3 and 7, of columns 4 and 6, of cells 2, 4, 6, 8: no interaction; repetitions one either way."""
    values = np.array([[[1, 3], [3, 5]], [[5, 7], [7, 9]]], float)
    found = two_way(values)
    assert (found.rows.squares, found.columns.squares, found.interaction.squares) == (32.0, 8.0, 0.0)
    assert found.total == 48.0 and (found.rows.freedom, found.rows.against) == (1, 4)
    assert (found.rows.f, found.columns.f, found.interaction.f) == (16.0, 4.0, 0.0)  # mean square of the error: 2
    assert found.rows.p == pytest.approx(0.016130, abs=1e-6)  # of F(1, 4), which is t(4) squared
    assert found.rows.eta == pytest.approx(32 / 48) and found.rows.omega == pytest.approx((32 - 2) / (48 + 2))
    assert found.interaction.omega == pytest.approx(-2 / 50)
    assert found.advantage[0] == pytest.approx((32 - 8) / 50)


def test_an_interaction_alone():
    """Cells 1 and -1 on the diagonals: factors explain nothing, both together nearly all."""
    values = np.array([[1.0, -1.0], [-1.0, 1.0]])[:, :, None] + 0.01 * rng.normal(size=(2, 2, 10))
    found = two_way(values)
    assert found.interaction.omega > 0.99 and found.interaction.omega_low > 0.9
    assert max(found.rows.omega, found.columns.omega) < 0.01 and found.interaction.p < 1e-9


@pytest.mark.parametrize("axis", [0, 1])
def test_with_one_level_of_a_factor_it_is_one_way(axis):
    """As by ``scipy.stats.f_oneway``."""
    from scipy.stats import f_oneway

    values = rng.normal(size=(4, 7)) + np.arange(4)[:, None]
    found = two_way(np.expand_dims(values, 1 - axis))
    one, other = (found.rows, found.columns) if axis == 0 else (found.columns, found.rows)
    known = f_oneway(*values)
    assert one.f == pytest.approx(known.statistic) and one.p == pytest.approx(known.pvalue)
    assert other.f is None and other.eta == 0.0


def test_individuals_in_all_columns():
    """Rows are as means of individuals one-way, two columns as a paired t-test of the rows' individuals."""
    from scipy.stats import f_oneway, ttest_rel

    values = rng.normal(size=(3, 4, 6)) + rng.normal(size=(3, 1, 6)) * 3
    known = f_oneway(*values.mean(axis=1))
    found = two_way(values, blocks=True)
    assert found.rows.f == pytest.approx(known.statistic) and found.rows.p == pytest.approx(known.pvalue)
    assert (found.rows.against, found.columns.against) == (15, 45)
    paired = ttest_rel(values[0, 0], values[0, 1])
    assert two_way(values[:1, :2], blocks=True).columns.p == pytest.approx(paired.pvalue)
    parts = (found.rows, found.columns, found.interaction)
    assert sum(part.eta for part in parts) < 1 and all(part.eta_low <= part.eta_high for part in parts)


def test_intervals_hold_what_is_there():
    """In 40 experiments whose rows explain half of the variance and columns nothing, intervals of both hold it."""
    rows = columns = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=(2, 3, 10))
        found = two_way(noise + np.array([-1.0, 1.0])[:, None, None], seed=seed)
        rows += found.rows.omega_low <= 0.5 <= found.rows.omega_high
        columns += found.columns.omega_low <= 0.0 <= found.columns.omega_high
    assert rows >= 34 and columns >= 36


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((2, 3)), r"values: shape \(2, 3\) is not allowed"),
        (np.zeros((2, 3, 1)), "at least 2 repetitions"),
        (np.zeros((2, 3, 4)), "finite and not all the same"),
        (np.full((2, 3, 4), np.nan), "finite and not all the same"),
    ],
)
def test_values_that_are_not_allowed_are_one_line(values, message):
    with pytest.raises(ValueError, match=message):
        two_way(values)
