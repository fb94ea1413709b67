"""Every block of Python on the pages of docs/ runs, and so do the commands of the first ten minutes."""

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SHELL = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGES = sorted(page.stem for page in DOCS.glob("*.md") if BLOCK.search(page.read_text()))
# What readers of a page have before its code: a robot, files, a run. ``extending`` has a test of its own.
BEFORE = {
    "own-robots": f"""
from pathlib import Path
inchworm = Path({str(ROOT / "examples/inchworm.py")!r}).read_text()
exec(inchworm)
body, weights = robot.body, np.zeros(131)
drives = 'drives = (Drive("legs", (0, 1, 2), amplitude=0.1, phase=(0.1, 0.4, 0.8)),)'
legs = drives + '; robot = LatticeRobot(robot.body, drives, frequency=0.2)'
Path("legs.py").write_text(inchworm + legs)
from optim.cli import main
assert main("export legs.py --csv gait.csv".split()) == 0
""",
    "report": """
from optim.cli import main
assert main("codesign --robot vehicle --generations 3 --quiet --out runs/a".split()) == 0
""",
    "gym": """
import shutil
import gymnasium
shutil.copy(gymnasium.__path__[0] + "/envs/mujoco/assets/ant.xml", "ant.xml")
""",
    "robot-files": """
import shutil
import gymnasium
shutil.copy(gymnasium.__path__[0] + "/envs/mujoco/assets/ant.xml", "ant.xml")
from optim.cli import main
assert main("export ant.xml --duration 2 --body-sizes aux_*=1.3 --model legs.xml --commands legs.csv".split()) == 0
""",
    "exploring": """
from pathlib import Path
import morpholab as ml
crawler = ml.robot("freeform", shape="6,4,2")
crawler.save(crawler.start, Path("walker.json"))
""",
}
pytestmark = [pytest.mark.kernels, pytest.mark.slow, pytest.mark.filterwarnings("ignore:model. ignored")]


@pytest.mark.parametrize("page", [page for page in PAGES if page != "extending"])
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    exec(compile(BEFORE.get(page, ""), "before", "exec"), names)
    for number, block in enumerate(BLOCK.findall((DOCS / f"{page}.md").read_text()), start=1):
        exec(compile(block, f"{page}.md, block {number}", "exec"), names)


def test_the_first_ten_minutes(tmp_path, morpholab):
    page = (DOCS / "ten-minutes.md").read_text()
    (program,) = BLOCK.findall(page)
    (tmp_path / "walker.py").write_text(program)
    lines = [line for block in SHELL.findall(page) for line in block.splitlines() if line.startswith("morpholab ")]
    assert len(lines) > 7
    for line in lines:
        code, _, error = morpholab(shlex.join(shlex.split(line, comments=True)[1:]))
        assert code == 0, f"{line}: {error}"
    assert {"gaits.html", "best.html", "report.html", "gait.csv"} <= {path.name for path in tmp_path.iterdir()}
