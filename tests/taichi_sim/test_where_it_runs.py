"""The command's options about where points are evaluated."""

import pytest

SMALL = "codesign --terrain flat --geometry small --columns 1 --repeats 1 --climbers 2 --generations 0 --out a"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--ray 127.0.0.1:1", "ray: no cluster answers at 127.0.0.1:1"),
        ("--ray moon", "ray: 'moon' is not an address; give HOST:PORT, ray://HOST:PORT, auto, or local for one here"),
        ("--workers 0", "argument --workers: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_a_place_that_is_not_there_is_one_line(morpholab, options, message):
    code, _, error = morpholab(f"{SMALL} {options}")
    assert code == 2 and message in error and error.count("\n") == 1


def test_more_workers_than_cores_are_noted(morpholab, monkeypatch, tmp_path):
    (tmp_path / "hill.py").write_text(
        "bounds = {'x': (0, 1)}\n\n\ndef evaluate(points):\n    return [-((x - 0.3) ** 2) for (x,) in points]\n"
    )
    line = "codesign --problem hill.py --climbers 4 --generations 2 --quiet"
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0})
    code, _, error = morpholab(f"{line} --workers 2 --out a")
    told = "morpholab codesign: note: 2 workers need 2 threads, of 1 cores; fewer would be as fast\n"
    assert (code, error) == (0, told)
    assert morpholab(f"{line} --out b")[0] == 0
    assert (tmp_path / "a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
