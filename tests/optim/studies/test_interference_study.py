"""The study of interference: runs that resume exactly, tables, pictures and the command."""

import json
import re
import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.figures import save_arrays
from optim.experiments.tables import write_table
from optim.problem import Evaluation
from optim.search import METHODS
from optim.search.hill_climb import HillClimb
from optim.studies.chapter2 import champions, curves, evolution, settings
from optim.studies.chapter2.evolution import Climbers, evolve
from optim.studies.chapter2.figures import draw_curves, draw_traces, read_changes
from optim.studies.chapter2.settings import FITNESS, Interference, Treatment, treatments
from optim.studies.chapter2.study import PICTURES, PICTURES_OF_TWO, rewrite, train
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.runtime import ti

BRIEF = Interference(population=4, steps=60)
CHOSEN = [Treatment("whegged", "min"), Treatment("legged", "sum")]


def same(ours, theirs):
    """Whether two states of climbers have the same bits."""
    return ours.keys() == theirs.keys() and all(np.array_equal(ours[name], theirs[name]) for name in ours)


@pytest.fixture(scope="module")
def whole():
    """Two treatments, two runs, six generations, in one go."""
    return evolve(BRIEF, CHOSEN, 2, 6, threads=1)


@pytest.mark.kernels
def test_climbers_keep_what_is_strictly_better_and_nothing_else(whole):
    for (treatment, _), state in whole.items():
        fitness = {"min": np.min, "sum": np.sum}[treatment.fitness](state["light"], axis=1)
        for climber in range(4):
            mine = state["climber"] == climber
            assert state["born"][mine][0] == 0 and (np.diff(fitness[mine]) > 0).all()
    assert any(len(state["born"]) > 4 for state in whole.values())


@pytest.mark.kernels
def test_the_weights_of_climbers_are_those_whose_distances_are_told(whole):
    state = whole[CHOSEN[0], 1]
    seen = BRIEF.simulate("whegged", state["weights"], threads=1)
    for climber in range(4):
        last = np.flatnonzero(state["climber"] == climber)[-1]
        assert np.array_equal(state["light"][last], seen.light[climber])
        assert np.array_equal(state["distance"][last], seen.distance[climber].astype(np.float32))


@pytest.mark.kernels
def test_runs_depend_on_nothing_beside_them(whole):
    alone = evolve(BRIEF, CHOSEN[:1], 1, 6, threads=2)
    assert same(alone[CHOSEN[0], 0], whole[CHOSEN[0], 0])
    assert not same(whole[CHOSEN[0], 0], whole[CHOSEN[0], 1])


@pytest.mark.kernels
def test_resuming_equals_not_stopping(whole, tmp_path):
    evolve(BRIEF, CHOSEN[:1], 1, 2, tmp_path, threads=1)
    found = evolve(BRIEF, CHOSEN, 2, 6, tmp_path, threads=1)
    assert all(same(found[run], whole[run]) for run in whole)


@pytest.mark.kernels
def test_a_run_whose_file_is_cut_or_that_was_interrupted_goes_on_with_the_same_bits(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(evolution, "SECONDS_BETWEEN_FILES", -1.0)  # after every generation
    calls, evaluate = [], evolution._evaluate

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 5:
            raise KeyboardInterrupt
        return evaluate(*arguments)

    monkeypatch.setattr(evolution, "_evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        evolve(BRIEF, CHOSEN, 2, 6, tmp_path, threads=1)
    files = sorted(tmp_path.glob("*.npz"))
    assert len(files) == 4
    files[-1].write_bytes(files[-1].read_bytes()[:-40])
    calls[:] = [None] * 5
    with pytest.warns(UserWarning, match=f"{files[-1].name}: is damaged, and as good as missing"):
        found = evolve(BRIEF, CHOSEN, 2, 6, tmp_path, threads=1)
    assert all(same(found[run], whole[run]) for run in whole)
    monkeypatch.setattr(evolution, "_evaluate", None)  # nothing is left to do
    assert all(same(state, whole[run]) for run, state in evolve(BRIEF, CHOSEN, 2, 6, tmp_path).items())


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("field", "value", "why"),
    [
        ("climber", 2, "climber: 2 is not allowed; give whole numbers from 0 to 1"),
        ("born", 99, "born: 99 is not allowed; give whole numbers from 0 to 1"),
        ("weights", np.nan, "weights: nan is not allowed"),
        ("distance", -1.0, "distance: -1.0 is not allowed"),
        ("light", np.inf, "light: inf is not allowed"),
    ],
)
def test_climbers_that_no_run_leaves_are_as_good_as_missing(tmp_path, monkeypatch, field, value, why):
    settings, kept = replace(BRIEF, population=2), Climbers(replace(BRIEF, population=2), CHOSEN[0], 0, 1)
    told(kept, kept.ask(), [[0.1, 0.1], [np.nan, np.nan]], [[9.0, 9.0], [np.nan, np.nan]])  # a failure is possible
    folder, name = ResultsFolder(tmp_path, "interference", asdict(settings)), CHOSEN[0].file(0)
    folder.add(name, name.encode(), **kept.state())
    monkeypatch.setattr(evolution, "_evaluate", None)  # nothing is left to do
    (found,) = evolve(settings, CHOSEN[:1], 1, 0, tmp_path).values()
    assert found["climber"].tolist() == [0, 1]
    state = kept.state()
    state[field].flat[0] = value
    folder.add(name, name.encode(), **state)
    warned = pytest.warns(UserWarning, match=rf"{name}-.*: is damaged, and as good as missing \({why}")
    with warned, pytest.raises(TypeError, match="not callable"):  # it is judged again
        evolve(settings, CHOSEN[:1], 1, 0, tmp_path)


def told(climbers, request, light, distance):
    """Tell climbers readings and distances, shape (P, E)."""
    light, distance = np.array(light, float), np.array(distance, float)
    fitness = FITNESS[climbers.treatment.fitness](light, axis=1)
    climbers.tell(request, Evaluation(fitness, details={"light": light, "distance": distance}))


def test_failures_never_win():
    climbers = Climbers(replace(BRIEF, population=2), CHOSEN[0], 0, 3)
    first = climbers.ask()
    told(climbers, first, [[np.nan, np.nan], [0.1, 0.1]], [[np.nan, np.nan], [9.0, 9.0]])
    child = climbers.ask()
    told(climbers, child, [[0.01, 0.01], [np.nan, np.nan]], [[9.0, 9.0], [np.nan, np.nan]])
    state = climbers.state()
    assert state["climber"].tolist() == [0, 1, 0]
    assert np.array_equal(state["weights"].reshape(2, -1), [child.points[0], first.points[1]])


def test_children_are_parents_and_normal_deviates_which_the_text_bounds():
    free, bounded = (replace(BRIEF, population=200, variant=v).method("hill-climb", 3) for v in ("as-run", "text"))
    for climbers in (free, bounded):
        climbers.tell(climbers.ask(), Evaluation(np.ones(200)))
    assert np.array_equal(free.points, bounded.points) and np.abs(free.points).max() <= 1
    steps = free.ask() - free.points
    assert steps.mean() == pytest.approx(0, abs=0.002) and steps.std() == pytest.approx(0.05, rel=0.02)
    assert np.abs(free.ask()).max() > 1
    assert np.array_equal(bounded.ask(), np.clip(free.ask(), -1, 1))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: treatments(["legged", "winged"]), "robots: 'winged' is unknown; choose some of legged, wheeled"),
        (lambda: treatments(["legged", "legged"]), "robots: 'legged' is given twice"),
        (lambda: treatments(fitness=[]), "fitness: none given; give some of sum, product, min"),
        (lambda: Interference(population=0), "population: 0 is not allowed"),
        (lambda: Interference(variant="as run"), "variant: 'as run' is unknown; choose one of as-run, text"),
        (lambda: Interference(precision="f16"), "precision: 'f16' is unknown"),
        (lambda: evolve(BRIEF, CHOSEN, 0, 1), "runs: 0 is not allowed"),
        (lambda: evolve(BRIEF, CHOSEN, 1, -1), "generations: -1 is not allowed"),
    ],
)
def test_bad_input_is_one_line(call, message):
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        call()
    assert "\n" not in str(error.value)


@pytest.mark.kernels
def test_folders_of_other_settings_or_that_went_further_are_refused(tmp_path):
    evolve(BRIEF, CHOSEN[:1], 1, 2, tmp_path, threads=1)
    with pytest.raises(ValueError, match=r"holds an interference of other settings .*; name another folder"):
        evolve(replace(BRIEF, population=5), CHOSEN[:1], 1, 2, tmp_path)
    with pytest.raises(ValueError, match=r"generations: 1 is not allowed; .* holds 2"):
        evolve(BRIEF, CHOSEN[:1], 1, 1, tmp_path)


def test_results_of_something_else_are_not_written_over(tmp_path):
    (tmp_path / "runs.csv").write_text("a table of another study")
    (tmp_path / "training.json").write_text("{}")
    with pytest.raises(ValueError, match=r"^out: .* holds something else; name a new folder$"):
        train(BRIEF, CHOSEN[:1], 1, 0, tmp_path, threads=1)
    assert (tmp_path / "runs.csv").read_text() == "a table of another study"


@pytest.mark.kernels
def test_a_device_that_is_not_there_leaves_no_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(ti.lang.misc, "is_arch_supported", lambda architecture: False)
    with pytest.raises(ValueError, match=r"^device: 'vulkan' is not available on this machine"):
        evolve(replace(BRIEF, device="vulkan"), CHOSEN[:1], 1, 0, tmp_path / "study", threads=1)
    assert not (tmp_path / "study").exists()


class Idle(HillClimb):
    """A trainer that never changes anything."""

    def ask(self):
        return self.points if self.generation else super().ask()


@pytest.mark.kernels
def test_other_trainers_take_part_as_a_row_of_their_own(whole, tmp_path, monkeypatch):
    monkeypatch.setitem(METHODS._loaded, "random", Idle)
    monkeypatch.setitem(settings.TRAINERS, "idle-hands", "random")
    chosen = [*CHOSEN, Treatment("whegged", "min", "idle-hands")]
    train(BRIEF, chosen, 2, 6, tmp_path, figures=True, threads=1)
    found = evolve(BRIEF, chosen, 2, 6, tmp_path / "runs")
    assert all(same(found[run], whole[run]) for run in whole)
    assert found[chosen[2], 1]["born"].tolist() == [0] * 4
    assert (tmp_path / "tables.md").read_text().count("| min, idle-hands | – | – |") == 6
    likeness = json.loads((tmp_path / "summary.json").read_text())["likeness"]
    assert [row["fitness"] for row in likeness["warping"]["means"]] == ["min", "sum", "min, idle-hands"] + [
        "random"
    ] * 2


def told_again(folder, data):
    """The numbers of an experiment in two environments, without its runs, make the same tables and pictures."""
    numbers = ("runs.csv", "likeness.csv", "curves.csv", "traces.csv.gz", "changes.npz", "changes-of-champions.npz")
    (data / "two").mkdir(parents=True)
    for name in numbers:
        shutil.copy(folder / name, data / "two")
    shutil.copy(folder / "alone.csv", data)
    rewrite(Data(data), data / "told")
    for name in ("tables.md", "likeness.md", *PICTURES, *PICTURES_OF_TWO, *numbers[1:]):
        assert (data / "told/two" / name).read_bytes() == (folder / name).read_bytes(), name


SMALL = "--population 3 --steps 40 --generations 2 --runs 2 --threads 1 --quiet"


@pytest.mark.kernels
def test_the_command_writes_tables_and_pictures_and_goes_on(morpholab, tmp_path, monkeypatch):
    code, out, error = morpholab(f"interference --out a {SMALL} --figures --alone --json")
    assert (code, error) == (0, "")
    document = json.loads(out)
    assert all((tmp_path / "a" / name).exists() for name in document["files"])
    assert {"tables.md", "changes.png", "curves.png", "traces.png", "alone.csv"} <= set(document["files"])
    cells = document["definitions"]["defined"]["cells"]
    assert len(cells) == 36 and cells[0]["published"] == 8.181 and cells[0]["published_deviation"] == 1.55
    assert len(document["definitions"]["defined"]["tests"]["M1"]) == 18
    assert [(row["robot"], row["light"][0]) for row in document["alone"]] == [
        (robot, x) for x in (9, -9) for robot in ("legged", "wheeled", "whegged")
    ]
    likeness = json.loads((tmp_path / "a/summary.json").read_text())["likeness"]
    assert len(likeness["warping"]["means"]) == 12 and len(likeness["asymmetry"]["tests"]["min"]) == 3
    seen = "view whegged --controller a/champions/whegged_min.json --frames 3 --threads 1 --quiet --out page.html"
    assert len(list((tmp_path / "a/champions").iterdir())) == 9 and morpholab(seen)[0] == 0
    told_again(tmp_path / "a", tmp_path / "data")
    monkeypatch.setattr(evolution, "_evaluate", None)  # nothing is left to do
    code, out, error = morpholab(f"interference --out a {SMALL} --robots whegged --fitness min")
    assert (code, error) == (0, "") and "M1: whegged min" in out and "2 runs of 2 generations, 3 climbers each\n" in out


CURVE = [("min", "legged", quantity, born, 1.0, 0.5, 1.5) for quantity in curves.QUANTITIES for born in (0, 1)]
PATH = [("min", "legged", 0, n, time, 2.0, float("nan"), 0.1) for n in (0, 1) for time in (0.0, 0.1)]


def changed(rows, row, column, value):
    """Rows with another value in a cell."""
    return [(*one[:column], value, *one[column + 1 :]) if n == row else one for n, one in enumerate(rows)]


def test_curves_and_paths_are_read(tmp_path):
    write_table(tmp_path / "curves.csv", tuple(curves.COLUMNS), CURVE)
    write_table(tmp_path / "traces.csv.gz", tuple(champions.TRACES), PATH)
    found = curves.read_curves(Data(tmp_path))
    assert found["min", "legged"].tolist() == [[[1.0, 1.0], [0.5, 0.5], [1.5, 1.5]]] * 2
    assert len(champions.read_traces(Data(tmp_path), 2)) == 4


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (CURVE[:3], "min legged has 1 rows of fitness; give one for each generation from 0 on"),
        ([*CURVE, CURVE[0]], "min legged has 3 rows of worst_distance; give one for each generation from 0 on"),
        (changed(CURVE, 0, 0, "max"), "row 2 has 'max' as fitness; allowed are sum, product, min, sum, gradient"),
        (changed(CURVE, 1, 4, "1" + "0" * 400), "row 3 has 1000"),
    ],
)
def test_what_is_no_curve_is_told(tmp_path, rows, message):
    write_table(tmp_path / "curves.csv", tuple(curves.COLUMNS), rows)
    with pytest.raises(ValueError, match=rf"curves.csv: {re.escape(message)}"):
        curves.read_curves(Data(tmp_path))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (PATH[:2], "min legged has environments [0] of runs [0]; give all 2 environments from 0 on of one run"),
        (changed(PATH, 3, 2, 1), "min legged has environments [0, 1] of runs [0, 1]; give all 2 environments"),
        (PATH[::-1], "min legged goes back in time in environment 1; sort its rows"),
        (changed(PATH, 2, 5, 1e4), "row 4 has 10000 as x; it must be from -1000 to 1000 m"),
        (changed(PATH, 2, 6, float("inf")), "row 4 has inf as y; it must be from -1000 to 1000 m"),
    ],
)
def test_what_is_no_path_is_told(tmp_path, rows, message):
    write_table(tmp_path / "traces.csv.gz", tuple(champions.TRACES), rows)
    with pytest.raises(ValueError, match=rf"traces.csv.gz: {re.escape(message)}"):
        champions.read_traces(Data(tmp_path), 2)


@pytest.mark.parametrize(
    ("name", "changes", "generations", "message"),
    [
        ("legged_min", [[1.0, 2.0, 3.0]], [1], "legged_min_change has shape (1, 3) of float64; give two numbers up to"),
        ("legged_min", [[1.0, np.nan]], [1], "legged_min_change has shape (1, 2) of float64; give two numbers up to"),
        ("legged_min", [[1.0, 1e300]], [1], "legged_min_change has shape (1, 2) of float64; give two numbers up to"),
        ("legged_min", [[1.0, 2.0]], [1, 2], "legged_min_generation has shape (2,) of int64; give a generation from 0"),
        ("legged_min", [[1.0, 2.0]], [-1], "legged_min_generation has shape (1,) of int64; give a generation from 0"),
        ("legged_min", [[1.0, 2.0]], [2**31], "legged_min_generation has shape (1,) of int64; give a generation from"),
        ("winged_min", [[1.0, 2.0]], [1], "winged_min_change is of no treatment; give robot_row of legged, wheeled,"),
        ("legged_max", [[1.0, 2.0]], [1], "legged_max_change is of no treatment; give robot_row of legged, wheeled,"),
        (None, [], [], "has no mutations"),
    ],
)
def test_mutations_that_are_none_are_told(tmp_path, name, changes, generations, message):
    arrays = {f"{name}_change": np.array(changes), f"{name}_generation": np.array(generations)} if name else {}
    save_arrays(tmp_path / "changes.npz", arrays)
    with pytest.raises(ValueError, match=f"changes.npz: {re.escape(message)}"):
        read_changes(Data(tmp_path), "changes.npz")


@pytest.mark.filterwarnings("error")
def test_a_grid_that_lacks_treatments_has_every_line_in_its_legend_and_numbers_at_its_edge(tmp_path):
    whole, bands = tmp_path / "whole.svg", np.ones((2, 3, 5))
    draw_curves({("sum", "legged"): bands, ("product", "legged"): bands, ("sum", "whegged"): bands}, whole)
    texts = re.findall("<!-- (.*) -->", whole.read_text())
    assert [text for text in texts if text in ("sum", "product")] == ["sum", "product"]
    assert texts.count("4.0") == texts.count("generation") == 2, "a column that ends above the last row has no numbers"
    assert texts.count("best fitness, sum") == texts.count("best fitness, product") == 1


@pytest.mark.filterwarnings("error")
def test_pictures_of_failures_are_drawn(tmp_path):
    """Of runs in which nothing succeeds, and of paths that lead far away."""
    draw_curves({("min", "legged"): np.full((2, 3, 4), np.nan)}, tmp_path / "curves.png")
    far = [dict(zip(champions.TRACES, row, strict=True)) for row in changed(PATH, 1, 6, 1000.0)]
    draw_traces(far, ((9.0, 0.0), (-9.0, 0.0)), tmp_path / "traces.png")
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("curves.png", "traces.png"))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--out a --robots legged,winged", "robots: 'winged' is unknown"),
        ("--out a --fitness max", "fitness: 'max' is unknown"),
        ("--out a --environments 3", "--environments: invalid choice: 3"),
        ("--out a --runs 0", "--runs: 0 is not allowed"),
        ("--out a --population x", "--population: 'x' is not allowed"),
        ("", "--out"),
    ],
)
def test_mistakes_are_one_line(morpholab, line, message):
    code, out, error = morpholab(f"interference {line}")
    assert code == 2 and message in error and error.count("\n") == 1 and not out
