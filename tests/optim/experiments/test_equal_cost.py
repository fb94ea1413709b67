"""What runs at equal cost keep beside them of their cost, and what is said of it if it is damaged."""

import re

import pytest

from optim.experiments.equal_cost import CLOCK, Contest

WHOLE = '{"cpu": 0.5, "best": null, "mean": null, "evaluations": 3}'


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("garbage", "Expecting value"),
        ("[]", "[] is not allowed"),
        ("{}", "cpu"),
        (WHOLE.replace("0.5", '"a"'), "cpu: 'a' is not allowed"),
        (WHOLE.replace("0.5", "1e999"), "cpu: inf is not allowed"),
        (WHOLE.replace("3", "-3"), "evaluations: -3 is not allowed"),
    ],
)
def test_a_damaged_line_of_costs_is_told_with_its_file(tmp_path, line, told):
    contest = Contest({}, "cpu", 1.0, tmp_path)
    path = contest.folder("one search", 0) / CLOCK
    assert contest.curve("one search", 0) == []
    path.parent.mkdir()
    path.write_text(f"{WHOLE}\n")
    assert contest.curve("one search", 0) == [{"cpu": 0.5, "best": None, "mean": None, "evaluations": 3}]
    path.write_text(f"{WHOLE}\n{line}\n")
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: cannot be read \\(.*{re.escape(told)}"):
        contest.curve("one search", 0)
