"""A page that follows runs while they go on: a server on this machine, for this machine alone.

The page asks for what the runs' folders say, every two seconds. On request it shows a design in motion. Nothing
is written, and no search is disturbed.
"""

import contextlib
import json
import threading
from collections.abc import Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from optim.problems import kept_point
from optim.report.front import places
from optim.report.one_run import OneRun
from optim.runs.history import History, read_history, read_result, runs_below
from optim.runs.run_status import read_status_and_history
from robots.view.player import MOST_MOTIONS
from robots.view.player import page as player_page
from taichi_sim.base.options import converted, whole

HERE = "127.0.0.1"
MOST_DOTS = 1000  # of a curve
FRAMES = 300  # of the best design's motion
# The page and its parts, with their types; scripts and styles come from this server alone.
FILES = {
    "/": ("live.html", "text/html"),
    "/live.js": ("live.js", "text/javascript"),
    "/page.css": ("page.css", "text/css"),
    "/live.css": ("live.css", "text/css"),
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; frame-src 'self'; img-src data:; "
    "frame-ancestors 'none'"
)
PLAYER_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "frame-ancestors 'self'"
)


class LiveRuns:
    """What the runs of some folders say at the moment.

    Args:
        paths: folders of runs, or of folders of them; new ones below are found when they come.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._simulating = threading.Lock()

    def state(self) -> list[dict[str, Any]]:
        """How far each run is, and the curve of its score; for one that cannot be read, why.

        Raises:
            ValueError: if there is no run.
        """
        found = [read_status_and_history(folder) for folder in runs_below(self._paths)]
        return [document if run is None else {**document, "curve": _curve(run)} for document, run in found]

    def kept(self, folder: str) -> dict[str, Any]:
        """The front or the map of elites that a run keeps, as ``front.places`` tells it.

        Raises:
            ValueError: if it is no run among these.
        """
        run = self._run(folder)
        result = read_result(run.history, run.subject.problem)
        return {} if result is None else {"generation": run.last.generation, **places(result, run.subject)}

    def player(self, folder: str, member: str = "", generation: str = "") -> str:
        """A page that plays a design of a run, simulated now: the best one, or that member of a front or a map.

        Members are numbered anew in every generation, so that of a member must be told.

        Raises:
            ValueError: if it is no run among these, or has no such design.
        """
        run = self._run(folder)
        number = converted("member", whole(1), member) if member else None
        if number is not None and generation != str(run.last.generation):
            raise ValueError(f"member: {folder} has gone on to generation {run.last.generation}; choose again")
        point = kept_point(run.history, run.subject.problem, number)
        if refused := run.subject.unplayable(run.history):
            raise ValueError(refused)
        with self._simulating:
            replays = run.subject.replays(point, FRAMES, lambda *_: None)
        if not replays:
            raise ValueError(f"run: designs of {folder} cannot be shown")
        which = "best design" if number is None else f"member {number}"
        title = f"{run.title}, {which} after generation {run.last.generation}"
        return player_page([replay.motion for replay in replays[:MOST_MOTIONS]], title)

    def _run(self, folder: str) -> OneRun:
        """The run of a folder among these."""
        if folder not in {str(path) for path in runs_below(self._paths)}:
            raise ValueError(f"run: {folder} is none of these")
        return OneRun.of(read_history(Path(folder)))


def _curve(history: History) -> list[tuple[int, float | None, float | None]]:
    """Evaluations, best and mean score by generations: at most ``MOST_DOTS``, the last among them."""
    every = -(-len(history.generations) // MOST_DOTS)
    kept = history.generations[::-1][::every][::-1] if every else ()
    return [(generation.evaluations, generation.best, generation.mean) for generation in kept]


Answer = tuple[str, str, str]  # text, type, what it may load


class LiveServer(ThreadingHTTPServer):
    """Serves the page of some runs to browsers on this machine; ``server_port`` tells the port.

    Args:
        runs: what the page follows.
        port: 0 is one that is free.

    Raises:
        ValueError: if the port is taken.
    """

    daemon_threads = True

    def __init__(self, runs: LiveRuns, port: int = 0) -> None:
        self.runs = runs
        try:
            super().__init__((HERE, port), _Answers)
        except OSError as error:
            raise ValueError(f"port: {port} is not allowed ({error.strerror}); choose another one") from None

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HERE}:{self.server_port}/"


class _Answers(BaseHTTPRequestHandler):
    """Answers to a browser on this machine that asks this server by its own name."""

    server: LiveServer

    def do_GET(self) -> None:
        """Send the page, a part of it, what runs say, or a player."""
        if not self._asked_by_itself():
            self._send(HTTPStatus.FORBIDDEN, "only this page may ask", "text/plain", POLICY)
            return
        path, _, asked = self.path.partition("?")
        try:
            answer = self._answer(path, dict(parse_qsl(asked)))
        except ValueError as error:
            self._send(HTTPStatus.CONFLICT, str(error), "text/plain", POLICY)
        except Exception as error:  # a folder that has just been deleted, a simulator without memory: the page goes on
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, f"{type(error).__name__}: {error}", "text/plain", POLICY)
        else:
            if answer is None:
                self._send(HTTPStatus.NOT_FOUND, "there is no such page", "text/plain", POLICY)
            else:
                self._send(HTTPStatus.OK, *answer)

    def _asked_by_itself(self) -> bool:
        """Whether the page asks, or a person who typed its address: no page elsewhere, and no name pointed here."""
        known = {f"{name}:{self.server.server_port}" for name in (HERE, "localhost")}
        site = self.headers.get("Sec-Fetch-Site", "none")
        return self.headers.get("Host") in known and site in ("none", "same-origin")

    def _answer(self, path: str, query: dict[str, str]) -> Answer | None:
        runs, run = self.server.runs, query.get("run", "")
        if path == "/player":
            page = runs.player(run, query.get("member", ""), query.get("generation", ""))
            return page, "text/html", PLAYER_POLICY
        if path in ("/state.json", "/kept.json"):
            told = runs.state() if path == "/state.json" else runs.kept(run)
            return json.dumps(told, allow_nan=False), "application/json", POLICY
        if path not in FILES:
            return None
        name, kind = FILES[path]
        return resources.files(__package__).joinpath(name).read_text("utf-8"), kind, POLICY

    def _send(self, status: HTTPStatus, text: str, kind: str, policy: str) -> None:
        content = text.encode()
        with contextlib.suppress(ConnectionError):  # the browser has left
            self.send_response(status)
            for name, value in (
                ("Content-Type", f"{kind}; charset=utf-8"),
                ("Content-Length", str(len(content))),
                ("Content-Security-Policy", policy),
                ("Cache-Control", "no-store"),
                ("X-Content-Type-Options", "nosniff"),
            ):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(content)

    def log_message(self, format: str, *arguments: object) -> None:
        """Say nothing of each request."""
