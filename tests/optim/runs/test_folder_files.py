"""What goes through a folder of workers: claims that one alone gets, and data to the bit."""

import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from worker_checks import same

from optim.problem import Evaluation, Request
from optim.runs.workers import folder_files
from optim.runs.workers.folder_files import CLAIMED, OPEN, Gone, Offer, Unread
from optim.runs.workers.service import Raised


@settings(max_examples=20)
@given(st.integers(1, 12), st.integers(2, 8))
def test_of_many_that_want_a_part_exactly_one_gets_it(tmp_path_factory, parts, rivals):
    folder = tmp_path_factory.mktemp("claims")
    folder_files.make_folders(folder)
    names = {f"part{number}" for number in range(parts)}
    for name in names:
        folder_files.part_path(folder, OPEN, name).touch()
    start = threading.Barrier(rivals)

    def take_all(rival):
        start.wait()
        taken = []
        while claimed := folder_files.claim_any(folder, f"rival{rival}"):
            taken.append(claimed[0])
        return taken

    with ThreadPoolExecutor(rivals) as pool:
        taken = [part for found in pool.map(take_all, range(rivals)) for part in found]
    assert sorted(taken) == sorted(names)
    claims = {folder_files.part_of_claim(claim)[0] for claim in folder_files.parts_in(folder, CLAIMED)}
    assert claims == names and folder_files.parts_in(folder, OPEN) == []


NUMBERS = arrays.array_shapes(min_dims=1, max_dims=2, min_side=3, max_side=3)
KINDS = st.sampled_from(["f8", "f4", "i8", "u1", "?", "U5"])


@settings(max_examples=12)
@given(arrays.arrays(KINDS, NUMBERS), arrays.arrays("f8", (3, 2)), st.text(max_size=9))
def test_evaluations_travel_to_the_bit(values, objectives, name):
    told = Evaluation(objectives, details={"file": values, name: values})
    worker, found = folder_files.unpacked_answer(folder_files.packed_answer("part", "me", told), "part", 3)
    assert worker == "me" and same(found, told) and list(found.details) == list(told.details)


@settings(max_examples=12)
@given(arrays.arrays("f8", (2, 3)), st.floats(0, np.inf), st.sampled_from(["points", "relaxed", "gradients"]))
def test_requests_travel_to_the_bit_and_are_named_by_content(points, sharpness, wants):
    request = Request(points, wants, sharpness)
    name, content = folder_files.packed_request(request, "search")
    search, found = folder_files.unpacked_request(content)
    assert (search, found.wants, found.sharpness) == ("search", wants, sharpness)
    assert found.points.tobytes() == points.tobytes()
    assert folder_files.packed_request(request, "search") == (name, content)
    assert folder_files.packed_request(request, "another")[0] != name


def test_objects_do_not_travel():
    with pytest.raises(
        ValueError, match=r"^details: thing is of type object, which is not allowed; give numbers or text"
    ):
        Evaluation(np.ones(1), details={"thing": np.array([{}], object)})
    for each in (Gone("died"), Unread("bad")):
        assert folder_files.unpacked_answer(folder_files.packed_answer("part", "me", each), "part", 1)[1] == each


@pytest.mark.parametrize("error", [ValueError("x: bad"), RuntimeError("Panic: fell"), KeyboardInterrupt()])
def test_what_users_code_raises_travels(error):
    told = Raised.by_users_code(error)
    _, found = folder_files.unpacked_answer(folder_files.packed_answer("part", "me", told), "part", 1)
    assert type(found.error) is type(error) and str(found.error) == str(error)


def test_an_offer_that_was_changed_is_refused(tmp_path):
    Offer.here({"kind": "file"}, 1.0).write(tmp_path)
    assert Offer.read(tmp_path).problem == {"kind": "file"}
    path = tmp_path / folder_files.SEARCH
    path.write_text(json.dumps({**json.loads(path.read_text()), "silence": 2.0}))
    with pytest.raises(ValueError, match=r"search\.json: the checksum does not match"):
        Offer.read(tmp_path)
