"""The page that follows runs: what it is told, whom it answers, and how it ends."""

import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import pytest
from run_products import searched
from worker_checks import heed_interrupts

from optim.problems.braitenberg import VehicleProblem
from optim.report.live import LiveRuns, LiveServer

pytestmark = pytest.mark.kernels
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder with a run of vehicles, one without a whole generation, and one with a damaged log."""
    folder = tmp_path_factory.mktemp("runs")
    searched(VehicleProblem(), folder / "good", generations=3)
    shutil.copytree(folder / "good", folder / "hurt")
    log = folder / "hurt" / "log.jsonl"
    log.write_text(log.read_text().replace("evaluations", "elations", 1))
    return folder


@contextmanager
def serving(*paths):
    with LiveServer(LiveRuns(paths)) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def answer(server, path, host=None, method="GET", **headers):
    asked = http.client.HTTPConnection("127.0.0.1", server.server_port)
    asked.request(method, path, headers={"Host": host or f"127.0.0.1:{server.server_port}", **headers})
    found = asked.getresponse()
    told = found.status, found.read().decode(), dict(found.getheaders())
    asked.close()
    return told


def test_the_state_is_that_of_the_folders_now(runs, tmp_path):
    shutil.copytree(runs / "good", tmp_path / "a")
    with serving(tmp_path) as server:
        (a,) = json.loads(answer(server, "/state.json")[1])
        shutil.copytree(runs / "hurt", tmp_path / "b")
        a_again, b = json.loads(answer(server, "/state.json")[1])
        shutil.rmtree(tmp_path / "a")
        shutil.rmtree(tmp_path / "b")
        status, why, _ = answer(server, "/state.json")
    lines = [json.loads(line) for line in (runs / "good" / "log.jsonl").read_text().splitlines()]
    assert a == a_again and a["state"] == "finished" and a["generation"] == 3 and a["score"]["unit"] == "m"
    assert a["curve"] == [[line["evaluations"], line["best"], line["mean"]] for line in lines]
    assert b["state"] == "damaged" and "log.jsonl" in b["reason"]
    assert status == 409 and why.startswith("run: ")


def test_long_runs_have_a_short_curve_with_their_end(runs, monkeypatch):
    monkeypatch.setattr("optim.report.live.MOST_DOTS", 2)
    (state,) = LiveRuns([runs / "good"]).state()
    assert [evaluations for evaluations, *_ in state["curve"]] == [4, 8]


def test_the_best_design_is_shown_in_motion(runs):
    with serving(runs / "good") as server:
        status, page, headers = answer(server, f"/player?run={quote(str(runs / 'good'))}")
        assert status == 200 and "window.player" in page and "best design after generation 3" in page
        assert "connect-src" not in headers["Content-Security-Policy"]  # its scripts may ask for nothing
        for other in ("", str(runs / "hurt"), "/etc", str(runs / "good" / ".." / "good")):
            status, why, _ = answer(server, f"/player?run={quote(other)}")
            assert (status, why) == (409, f"run: {other} is none of these")


@pytest.mark.usefixtures("simulator")
def test_members_of_a_map_and_of_a_front_have_places_and_motions(tmp_path, morpholab):
    def kept(folder):
        return json.loads(answer(server, "/kept.json?run=" + quote(str(tmp_path / folder)))[1])

    sensors = """--set 'descriptors=["l1x", "l1y"]' --set bins=4 --population 12"""
    for line in (
        f"--robot vehicle --method map-elites {sensors} --out a",
        "--geometry small --terrain flat --terrain hill:15 --method borg --population 12 --out b",
        "--robot vehicle --climbers 2 --out c",
    ):
        assert morpholab(f"codesign --generations 3 --quiet {line}")[0] == 0
    with serving(tmp_path) as server:
        found = kept("a")
        assert found["kind"] == "elites" and [axis["name"] for axis in found["axes"]] == ["l1x", "l1y"]
        cells = [tuple(member[:2]) for member in found["members"]]
        assert len(set(cells)) == len(cells) > 1 and {place for cell in cells for place in cell} <= set(range(4))
        assert (
            max(score for *_, score, _ in found["members"]) == json.loads(answer(server, "/state.json")[1])[0]["best"]
        )
        front = json.loads((tmp_path / "b/front.json").read_text())["designs"]
        assert [tuple(member[:2]) for member in kept("b")["members"]] == [tuple(d["objectives"]) for d in front]
        assert kept("c") == {"generation": 3}
        assert found["generation"] == 3
        run = f"/player?run={quote(str(tmp_path / 'a'))}&generation=3&member="
        status, page, _ = answer(server, run + "2")
        assert status == 200 and "member 2 after generation 3" in page
        for wrong, told in {"0": "0", "9999": "9999", "-1": "-1", "two": "'two'", "1e3": "1000"}.items():
            status, why, _ = answer(server, run + wrong)
            assert status == 409 and why.startswith(f"member: {told} is not allowed; ")
        status, why, _ = answer(
            server, run.replace("generation=3", "generation=2") + "2"
        )  # which was numbered otherwise
        assert status == 409 and why.endswith("has gone on to generation 3; choose again")


def test_only_this_machine_by_its_own_name_is_answered(runs):
    with serving(runs / "good") as server:
        assert server.server_address[0] == "127.0.0.1"
        assert answer(server, "/", host=f"localhost:{server.server_port}")[0] == 200
        for host in ("evil.example", f"evil.example:{server.server_port}", "127.0.0.1", "127.0.0.1:1"):
            assert answer(server, "/state.json", host=host)[0] == 403
        for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200), ("none", 200)):
            assert answer(server, "/state.json", **{"Sec-Fetch-Site": site})[0] == status
        for path in ("/live.py", "/../live.py", "/%2e%2e/live.py", "//etc/passwd", "/state"):
            assert answer(server, path)[0] == 404
        assert answer(server, "/state.json", method="POST")[0] == 501


def test_the_command_serves_until_it_is_interrupted(runs):
    command = [sys.executable, "-m", "optim.cli", "report", str(runs / "good"), "--watch"]
    heard = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=heard, preexec_fn=heed_interrupts) as process:
        line = process.stderr.readline()
        address = r"http://127\.0\.0\.1:(\d+)/ \(on this machine alone; Ctrl-C ends it\)"
        told = re.fullmatch(rf"morpholab report: note: 1 run: {address}\n", line)
        asked = http.client.HTTPConnection("127.0.0.1", int(told[1]))
        asked.request("GET", "/")
        assert "<title>Runs</title>" in asked.getresponse().read().decode()
        asked.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0 and process.stderr.read() == ""


def test_what_nobody_foresaw_is_told_and_the_page_goes_on(runs, monkeypatch, capfd):
    with serving(runs / "good") as server:
        monkeypatch.setattr(server.runs, "state", lambda: 1 / 0)
        assert answer(server, "/state.json")[:2] == (500, "ZeroDivisionError: division by zero")
        monkeypatch.undo()
        assert answer(server, "/state.json")[0] == 200
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "out: name the page to write, such as --out report.html, or watch runs by --watch"),
        ("--watch --out a.html", "watch: it does not go with --out; leave one out"),
        ("--watch --no-player", "watch: it does not go with --no-player; leave one out"),
        ("--watch --by seconds", "watch: it does not go with --by; leave one out"),
        ("--out a.html --port 3", "port: nothing is served without --watch; leave it out"),
    ],
)
def test_what_does_not_go_together_is_named(morpholab, runs, options, message):
    code, out, err = morpholab(f"report {runs / 'good'} {options}")
    assert (code, out, err) == (2, "", f"morpholab report: error: {message}\n")


def test_a_port_that_is_taken_is_named(morpholab, runs):
    with serving(runs / "good") as server:
        code, _, err = morpholab(f"report {runs / 'good'} --watch --port {server.server_port}")
    assert code == 2 and err.startswith(f"morpholab report: error: port: {server.server_port} is not allowed (")
