"""Every reader takes or refuses its kept corpus and random damage of it; ``make fuzz`` looks for more."""

import fuzz_targets as targets
import numpy as np
import pytest

BITS = [
    b"-",
    b"9e9",
    b"null",
    b"[",
    b"{}",
    b'"',
    b"0",
    b",",
    b"1e999",
    b"\xff",
    b"<",
    b".",
    b"true",
    b"nan",
    b"\n",
    b"",
]
DAMAGES = 12  # of each seed


@pytest.mark.parametrize("name", targets.TARGETS)
def test_a_reader_takes_its_corpus_or_says_why_not(name, tmp_path):
    rng = np.random.default_rng(0)
    seeds = targets.seeds(name)
    assert any([targets.attack(name, seed, tmp_path) for seed in seeds])  # else nothing but its refusals is tried
    for seed in seeds[:4]:
        for _ in range(DAMAGES):
            text = bytearray(seed[: targets.LARGEST])
            place = int(rng.integers(len(text) + 1))
            text[place : place + int(rng.integers(6))] = BITS[rng.integers(len(BITS))]
            targets.attack(name, bytes(text), tmp_path)
