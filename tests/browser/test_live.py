"""The page that follows runs, in a browser: a run goes on, and the page with it."""

import json
import shutil
import threading

import pytest
from run_products import searched

from optim.problems.braitenberg import VehicleProblem
from optim.report.live import LiveRuns, LiveServer
from optim.runs import open_run, run_search
from optim.search import build_method

pytestmark = [pytest.mark.kernels, pytest.mark.browser]


@pytest.fixture
def server(tmp_path):
    """Serves a folder in which run ``b`` is of four generations, and ``a`` of twelve."""
    searched(VehicleProblem(), tmp_path / "b", generations=4)
    with LiveServer(LiveRuns([tmp_path])) as made:
        made.folder = tmp_path
        thread = threading.Thread(target=made.serve_forever)
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def test_runs_come_go_on_and_are_seen(server, tab):
    tab.own = server.url
    tab.goto(server.url)
    tab.wait_for_selector("section.run")
    first = json.loads((server.folder / "b" / "log.jsonl").read_text().splitlines()[-1])["best"]
    assert f"{float(f'{first:.4g}'):g} m" in tab.inner_text(".tiles")
    assert len(tab.query_selector_all("section.run")) == 1 and tab.query_selector("path.best")
    searched(VehicleProblem(), server.folder / "a", generations=12)
    tab.wait_for_function("() => document.querySelectorAll('section.run').length === 2")
    tab.click("text=show the best design in motion >> nth=0")
    tab.wait_for_function("() => document.querySelector('iframe').contentWindow.player?.playing")
    assert tab.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    tab.wait_for_timeout(2000)
    tab.shot("motion")
    tab.click("text=close")
    shutil.rmtree(server.folder / "a")
    tab.wait_for_function("() => document.querySelectorAll('section.run').length === 1")


def test_a_press_on_a_cell_of_a_map_shows_its_robot(server, tab):
    problem = VehicleProblem()
    settings = {"population": 24, "seed": 0, "descriptors": ["l1x", "l1y"], "bins": 6}
    config = {"problem": problem.describe(), "method": {"name": "map-elites", **settings}, "generations": 6}
    with open_run(server.folder / "a", config) as run:
        run_search(problem, build_method("map-elites", problem.space, settings), run, 6)
    tab.own = server.url
    tab.goto(server.url)
    tab.wait_for_selector("rect.member")
    cells = tab.query_selector_all("rect.member")
    assert len(cells) > 4
    tab.shot("map")
    number = cells[2].get_attribute("aria-label").split(":")[0]
    cells[2].click()
    tab.wait_for_function("() => document.querySelector('iframe').contentWindow.player?.playing")
    assert tab.inner_text("#waits").endswith(number)
    frame = tab.query_selector("iframe").content_frame()
    assert f"{number} after generation 6" in frame.inner_text("h1")


def test_hostile_names_are_texts(server, tab):
    name = "<img src=x onerror=alert(1)>&quot;'\"; </script><b>"
    shutil.copytree(server.folder / "b", server.folder / name.replace("/", "|"))
    tab.own = server.url
    tab.goto(server.url)
    tab.wait_for_function("() => document.querySelectorAll('section.run').length === 2")
    assert any("<img src=x onerror=alert(1)>" in head.inner_text() for head in tab.query_selector_all("h2"))
    assert not tab.query_selector("img") and not tab.query_selector("b")


def test_the_end_of_the_server_is_told(server, tab):
    tab.own = server.url
    tab.goto(server.url)
    tab.wait_for_selector("section.run")
    tab.route("**/state.json", lambda route: route.abort())
    tab.wait_for_selector("text=morpholab report --watch has ended.")
    tab.expected = ("Failed to load resource",)
