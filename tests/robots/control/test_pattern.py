import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.control.pattern import ACTIVATIONS, WEIGHT_LIMIT, PatternWiring

WIRING = PatternWiring(inputs=("x", "y"), outputs=("a", "b", "c"), hidden=4)
GENES = list(ACTIVATIONS)


def random_network(seed, wiring=WIRING):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(-WEIGHT_LIMIT, WEIGHT_LIMIT, len(wiring.weight_names))
    return wiring.network([*weights, *rng.integers(0, len(GENES), wiring.hidden)])


def single(activation, weight=1.0, bias=0.0):
    """One hidden node that one output repeats."""
    wiring = PatternWiring(inputs=("x",), outputs=("a",), hidden=1)
    network = wiring.network([weight, bias, 1.0, 0.0, GENES.index(activation)])
    return lambda x: network(np.reshape(x, (-1, 1))).ravel()


def test_a_network_is_sums_of_functions_of_sums():
    network = random_network(0)
    place = np.array([0.3, -0.8])
    heard = [row[:2] @ place + row[2] for row in network.hidden]
    said = [ACTIVATIONS[name](u) for name, u in zip(network.activations, heard, strict=True)]
    expected = [row[:4] @ np.array(said) + row[4] for row in network.output]
    assert network(place[None])[0] == pytest.approx(expected, rel=1e-12)


def test_functions_make_symmetry_repetition_and_edges():
    x = np.linspace(-1, 1, 41)
    for even in ("absolute", "gaussian"):
        assert np.array_equal(single(even)(x), single(even)(-x)) and np.ptp(single(even)(x)) > 0.9
    for odd in ("linear", "tanh", "sine"):
        assert single(odd)(x) == pytest.approx(-single(odd)(-x)) and np.ptp(single(odd)(x)) > 1
    assert single("sine", 2.0)(x + 1.0) == pytest.approx(single("sine", 2.0)(x), abs=1e-9)
    assert set(single("step", 1.0, -0.5)(x)) == {-1.0, 1.0}
    assert single("step", 1.0, -0.5)([0.4, 0.6]).tolist() == [-1.0, 1.0]


def test_a_place_does_not_know_the_others():
    network, places = random_network(1), np.random.default_rng(2).uniform(-1, 1, (50, 2))
    together = network(places)
    assert together.shape == (50, 3)
    assert np.array_equal(together, np.concatenate([network(place[None]) for place in places]))
    assert network(np.zeros((0, 2))).shape == (0, 3)


def test_the_wiring_names_every_gene_in_the_order_of_the_vector():
    assert len(WIRING.weight_names) == 4 * 3 + 3 * 5 == len(set(WIRING.weight_names))
    assert WIRING.activation_names == tuple(f"activation_hidden{k}" for k in (1, 2, 3, 4))
    places = np.random.default_rng(3).uniform(-1, 1, (5, 2))
    for name, moves in (("weight_a_hidden2", [True, False, False]), ("weight_c_bias", [False, False, True])):
        weights = np.full(len(WIRING.weight_names), 0.5)
        before = WIRING.network([*weights, 1, 1, 1, 1])(places)
        weights[WIRING.weight_names.index(name)] = 1.0
        after = WIRING.network([*weights, 1, 1, 1, 1])(places)
        assert (before != after).all(axis=0).tolist() == moves


@given(st.integers(0, 10**6))
def test_whatever_the_genome_outputs_are_finite(seed):
    assert np.isfinite(random_network(seed)([[-1.0, 1.0], [0.0, 0.0], [1.0, -1.0]])).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PatternWiring((), ("a",)), r"inputs: \(\) is not allowed; give at least one name"),
        (lambda: PatternWiring(("x",), ("a", "a")), "outputs: .* is not allowed; .* none twice"),
        (lambda: PatternWiring(("x",), ("a",), hidden=0), "hidden: 0 is not allowed; give a whole number, at least 1"),
        (lambda: WIRING.network(np.zeros(30)), r"genes: shape \(30,\) is not allowed; give \(31,\)"),
        (
            lambda: WIRING.network([3.5, *np.zeros(30)]),
            "weight_hidden1_x: 3.5 is not allowed; give a number from -3 to 3",
        ),
        (
            lambda: WIRING.network([*np.zeros(26), np.nan, *np.zeros(4)]),
            "weight_c_bias: nan is not allowed",
        ),
        (
            lambda: WIRING.network([*np.zeros(27), 0, 0.5, 0, 0]),
            "activation_hidden2: 0.5 is not allowed; give a whole number from 0 to 5",
        ),
        (
            lambda: random_network(0)([[1.0]]),
            r"coordinates: shape \(1, 1\); give finite numbers of shape \(places, 2\)",
        ),
        (lambda: random_network(0)([[1.0, np.inf]]), "coordinates: .* give finite numbers"),
    ],
)
def test_what_makes_no_network_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)
