"""Weights of controllers are real numbers, from a file or from a caller; what NumPy would make one of is refused."""

import re

import numpy as np
import pytest

from robots.control.neural import check_weights, load_weights

pytestmark = pytest.mark.filterwarnings("error")  # NumPy only warns of imaginary parts that it drops

NO_NUMBERS = [np.ones((2, 2), complex), np.ones((2, 2), bool), [[1, True], [0, 0.5]], [["1", "2"], ["3", "4"]]]


@pytest.mark.parametrize("weights", [*NO_NUMBERS, [[1, 2], [3]], {}], ids=str)
def test_weights_of_a_caller_are_numbers(weights):
    with pytest.raises(ValueError, match=r"^weights: .* is not allowed; give numbers of shape \(N, 2, 2\)$"):
        check_weights(weights, 2, 2)


def test_weights_of_one_controller_or_several_are_taken():
    for weights in ([[1, 2], [3, 4]], np.array([[1, 2], [3, 4]], np.int8), np.array([[[1, 2], [3, 4]]], np.float32)):
        assert np.array_equal(check_weights(weights, 2, 2), [[[1, 2], [3, 4]]])


@pytest.mark.parametrize("text", ["[[1, true], [0, 0.5]]", "[[true, true], [true, true]]", "{}", "[[1, 2], [3]]"])
def test_weights_of_a_file_are_numbers(tmp_path, text):
    (tmp_path / "weights.json").write_text(text)
    with pytest.raises(ValueError, match=r"^controller: .*weights.json holds no table of numbers; give \(2, 2\)$"):
        load_weights(tmp_path / "weights.json", 2, 2)


@pytest.mark.parametrize("kind", [complex, bool, "U3"])
def test_weights_of_an_array_in_a_file_are_numbers(tmp_path, kind):
    path = tmp_path / "weights.npy"
    np.save(path, np.ones((2, 2), kind))
    with pytest.raises(ValueError, match=f"^controller: {re.escape(str(path))} holds no table of numbers"):
        load_weights(path, 2, 2)
    np.save(path, np.ones((2, 2), np.float32))
    assert np.array_equal(load_weights(path, 2, 2), np.ones((2, 2)))
