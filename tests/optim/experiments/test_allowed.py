"""What arrays of parts may hold, and parts that hold anything else."""

import numpy as np
import pytest

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import computed_arrays
from taichi_sim.base.results_folder import ResultsFolder

SHARES = Allowed((2,), 0.0, 1.0)


@pytest.mark.parametrize(
    ("allowed", "found", "why"),
    [
        (SHARES, np.array([0, 1]), "a: type int64 is not allowed; give numbers"),
        (SHARES, np.array([True, False]), "a: type bool is not allowed; give numbers"),
        (SHARES, np.array([0.5]), "a: shape (1,) is not allowed; give (2,)"),
        (SHARES, np.array([0.5, np.nan]), "a: nan is not allowed; give finite numbers"),
        (SHARES, np.array([0.5, 1.5]), "a: 1.5 is not allowed; give 0 to 1"),
        (Allowed((2,)), np.array([np.inf, 1.0]), "a: inf is not allowed; give finite numbers"),
        (Allowed((2,), failed=np.nan), np.array([np.nan, -np.inf]), "a: -inf is not allowed; give finite numbers"),
        (Allowed((2,), failed=-np.inf), np.array([np.nan, -np.inf]), "a: nan is not allowed; give finite numbers"),
        (Allowed((2,), kind="b"), np.array([0.0, 1.0]), "a: type float64 is not allowed; give truth values"),
    ],
)
def test_what_an_array_cannot_be_is_told(allowed, found, why):
    with pytest.raises(ValueError) as error:
        check_arrays({"a": allowed}, {"a": found})
    assert str(error.value) == why


def test_what_arrays_may_be_is_taken():
    check_arrays({"a": SHARES}, {"a": np.array([0.0, 1.0]), "more": np.array("any")})
    check_arrays({"a": Allowed((2,), failed=np.nan)}, {"a": np.array([np.nan, 1e9])})
    check_arrays({"a": Allowed((), 0.0), "b": Allowed((1,), kind="b")}, {"a": np.array(3.5), "b": np.array([True])})
    both = {"a": Allowed(("N",), kind="i"), "b": Allowed(("N", 2))}
    check_arrays(both, {"a": np.arange(3), "b": np.ones((3, 2))})
    with pytest.raises(ValueError, match=r"^b: shape \(4, 2\) is not allowed; give \(3, 2\)$"):
        check_arrays(both, {"a": np.arange(3), "b": np.ones((4, 2))})
    with pytest.raises(ValueError, match=r"^a: shape \(3,\) is not allowed; give \('N', 2\)$"):
        check_arrays({"a": Allowed(("N", 2))}, {"a": np.ones(3)})
    with pytest.raises(ValueError, match=r"^a: type float64 is not allowed; give whole numbers$"):
        check_arrays({"a": Allowed(("N",), kind="i")}, {"a": np.ones(3)})
    with pytest.raises(ValueError, match=r"^a is missing$"):
        check_arrays({"a": SHARES}, {})


def test_a_part_that_cannot_be_is_computed_again(tmp_path):
    """Each by what is allowed of it alone."""
    folder, done = ResultsFolder(tmp_path / "a", "kind", {}), []
    parts = {name: lambda _, n=n: done.append(n) or np.full(n, 0.5) for n, name in enumerate(("one", "two"), 1)}
    allowed = {"one": Allowed((1,), 0.0, 1.0), "two": SHARES}
    assert [each.tolist() for each in computed_arrays(folder, "shares", parts, None, allowed)] == [[0.5], [0.5, 0.5]]
    (file,) = (tmp_path / "a").glob("two-*.npz")
    np.savez(file, shares=np.array([0.5, 7.0]))
    with pytest.warns(UserWarning, match=r"two-.*: is damaged, and as good as missing \(shares: 7.0 is not allowed"):
        found = computed_arrays(folder, "shares", parts, None, allowed)
    assert found[1].tolist() == [0.5, 0.5] and done == [1, 2, 2]
