"""Figures of chapters 3 and 4 as they were published: what is kept of them, and what their drawers draw."""

from contextlib import contextmanager
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from optim.experiments.data import Data
from optim.experiments.tables import read_records
from optim.studies.chapter3 import examples, rover_sweep, trajectories
from optim.studies.chapter3.examples import Example, read_examples, save_examples, save_landscape, save_sketches
from optim.studies.chapter3.sweep_study import STUDY
from optim.studies.chapter3.sweep_table import SweepTable, read_sweep_table
from optim.studies.chapter3.trajectories import packed, read_trajectories, save_trajectories, thinned
from optim.studies.chapter4 import co_optimisation, training
from robots.braitenberg import BASELINE, Sweep, VehicleBody
from robots.view.vehicle_charts import CHAPTER_3_COLOURS, CHAPTER_4_COLOURS

DATA = Path(__file__).parents[3] / "docs/data"
FILE = "examples.npz"
SOLVED = np.array([[4, 0, 0], [1, 4, 0], [0, 3, 2]], np.uint8)
WHOLE = {
    "overlap_6553": SOLVED,
    "weights_6553": np.array([-1.0, -1.0]),
    "paths_6553": np.arange(16, dtype=np.float32).reshape(4, 2, 2),
    "persistent_6553": np.array(1),
}
TABLE = SweepTable(np.array([6553]), np.array([2]), np.array([5]), Sweep(weights=3))


@pytest.fixture
def drawn(monkeypatch):
    """Panels of figures by the names of their files, with all that was drawn."""
    found = {}

    def recording(module):
        whole = module.figure

        @contextmanager
        def figure(path, *given, **more):
            with whole(path, *given, **more) as (one, panels):
                yield one, panels
            found[path.name] = panels

        monkeypatch.setattr(module, "figure", figure)

    for module in (examples, trajectories, rover_sweep, co_optimisation, training):
        recording(module)
    return found


def letters(panels):
    return "".join(axes.get_title("left") for axes in panels.flat)


def told(axes):
    return [text.get_text() for text in axes.texts]


def test_a_thinned_path_stays_within_the_tolerance_of_the_whole_one(monkeypatch):
    time = np.linspace(0, 6, 4001)
    path = np.stack([time * np.cos(5 * time), time * np.sin(5 * time)], axis=1)
    thin = thinned(path, 0.01)
    assert 50 < len(thin) < 500 and np.array_equal(thin[[0, -1]], path[[0, -1]])
    starts, along = thin[:-1], np.diff(thin, axis=0)
    share = np.clip(((path[:, None] - starts) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    assert np.linalg.norm(path[:, None] - starts - share[..., None] * along, axis=-1).min(axis=1).max() <= 0.01
    path[2000:] = np.nan
    assert thinned(path).max() < 3.1 and len(thinned(np.zeros((9, 2)))) == 2
    monkeypatch.setattr(trajectories, "MOST_POINTS", 40)
    assert len(thinned(path)) <= 40


def test_packed_paths_have_the_length_of_the_longest(monkeypatch):
    straight = np.stack([np.linspace(0, 1, 9)] * 2, axis=1)
    bent = np.where(np.arange(9)[:, None] < 5, straight, straight[::-1])
    found = packed(np.stack([straight, bent])[None])
    assert found.shape == (1, 2, 3, 2) and found.dtype == np.float32
    assert np.isnan(found[0, 0, 2:]).all() and np.isfinite(found[0, 1]).all()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("overlap_6553", SOLVED + np.uint8(1), "overlap_6553: give 3 x 3 bytes up to 4"),
        ("overlap_6553", SOLVED[:2], "overlap_6553: give 3 x 3 bytes up to 4"),
        ("overlap_6553", SOLVED.astype(float), "overlap_6553: give 3 x 3 bytes up to 4"),
        ("overlap_6553", SOLVED // 2, "overlap_6553: 0 controllers solve all, 4 any; the table has 2 and 5"),
        ("weights_6553", np.full(2, np.nan), "weights_6553: nan is not allowed; give finite numbers"),
        ("weights_6553", np.array([2.0, 0.0]), "weights_6553: 2.0 is not allowed; give -1 to 1"),
        ("paths_6553", np.zeros((3, 2, 2)), "paths_6553: shape (3, 2, 2) is not allowed; give (4, 2, 2)"),
        ("paths_6553", np.zeros((4, 2001, 2)), "paths_6553: 2001 points of a path are not allowed; give at most 2000"),
        ("paths_6553", np.zeros((4, 0, 2)), "paths_6553: paths without a first point are not allowed"),
        ("paths_6553", np.full((4, 2, 2), np.inf), "paths_6553: inf is not allowed; give finite numbers"),
        ("paths_6553", np.array(1.0), "paths_6553: shape () is not allowed; give (4, 0, 2)"),
        ("persistent_6553", np.array(3), "persistent_6553: 3 is not allowed; give a whole number, at most 2"),
        ("persistent_6553", np.zeros(2, int), "persistent_6553: shape (2,) is not allowed; give one number"),
    ],
)
def test_examples_that_cannot_be_are_one_line(tmp_path, name, value, message):
    np.savez_compressed(tmp_path / FILE, **WHOLE)
    assert list(read_examples(Data(tmp_path), FILE, TABLE)) == [6553]
    np.savez_compressed(tmp_path / FILE, **{**WHOLE, name: value})
    with pytest.raises(ValueError) as caught:
        read_examples(Data(tmp_path), FILE, TABLE)
    assert str(caught.value) == f"{tmp_path / FILE}: {message}"


def test_examples_that_are_missing_or_damaged_are_one_line(tmp_path):
    for name in WHOLE:
        np.savez_compressed(tmp_path / FILE, **{key: value for key, value in WHOLE.items() if key != name})
        with pytest.raises(ValueError, match=rf"examples.npz: it has no array '{name}'$"):
            read_examples(Data(tmp_path), FILE, TABLE)
    (tmp_path / FILE).write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"examples.npz: cannot be read \(File is not a zip file\)$"):
        read_examples(Data(tmp_path), FILE, TABLE)


def test_a_body_without_success_has_neither_weights_nor_paths(tmp_path, drawn):
    table = SweepTable(np.array([6553]), np.array([0]), np.array([0]), Sweep(weights=3))
    nothing = Example(6553, np.zeros((3, 3), np.uint8), np.full(2, np.nan), np.zeros((4, 0, 2), np.float32), 0)
    np.savez_compressed(tmp_path / FILE, **nothing.arrays())
    found = read_examples(Data(tmp_path), FILE, table)
    save_examples({"baseline": found[6553]}, np.zeros((1, 2)), tmp_path / "a.png")
    assert told(drawn["a.png"][0, 1]) == ["no controller solves all"]
    np.savez_compressed(tmp_path / FILE, **{**nothing.arrays(), "paths_6553": WHOLE["paths_6553"]})
    with pytest.raises(ValueError, match=r"paths_6553: shape \(4, 2, 2\) is not allowed; give \(4, 0, 2\)"):
        read_examples(Data(tmp_path), FILE, table)
    for weights in (np.zeros(2), np.array([np.nan, 0.5]), np.full(3, np.nan)):
        np.savez_compressed(tmp_path / FILE, **{**nothing.arrays(), "weights_6553": weights})
        with pytest.raises(ValueError, match="weights_6553: give two NaN, as no controller solves all"):
            read_examples(Data(tmp_path), FILE, table)


def test_a_folder_with_examples_of_before_is_told_without_them(tmp_path):
    """Theirs lack how many controllers stay at the light; the figures of the table are drawn all the same."""
    with np.load(DATA / "vehicle-examples.npz") as file:
        before = {name: value for name, value in file.items() if not name.startswith("persistent")}
    copy(DATA / "vehicle-sweep.csv.gz", tmp_path / "table.csv.gz")
    np.savez_compressed(tmp_path / FILE, **before)
    with pytest.warns(UserWarning, match=r"it has no array 'persistent_6553' .*; figures of examples are left out"):
        STUDY.rewrite(Data(tmp_path), tmp_path / "out")
    assert (tmp_path / "out/correlation.png").is_file() and not (tmp_path / "out/examples.png").exists()


def test_trajectories_that_cannot_be_are_one_line(tmp_path):
    name = "vehicle-trajectories.npz"
    with np.load(DATA / name) as file:
        whole = dict(file)
    for key, value, message in (
        ("paths_best", whole["paths_best"][:2], r"paths_best: shape \(2, 4, \d+, 2\) is not allowed; give \(3, 4"),
        ("reached_canonical", np.ones((2, 4)), "reached_canonical: type float64 is not allowed; give truth values"),
        ("reached_best", np.ones((2, 4), bool), r"reached_best: shape \(2, 4\) is not allowed; give \(3, 4\)"),
    ):
        np.savez_compressed(tmp_path / name, **{**whole, key: value})
        with pytest.raises(ValueError, match=rf"^{tmp_path / name}: {message}"):
            read_trajectories(Data(tmp_path), name)


def test_one_of_two_files_of_trajectories_does_not_silently_win(tmp_path):
    copy(DATA / "vehicle-sweep.csv.gz", tmp_path / "table.csv.gz")
    for name in ("vehicle-trajectories.npz", "trajectories.npz"):
        copy(DATA / "vehicle-trajectories.npz", tmp_path / name)
    with pytest.raises(
        ValueError, match=r"has vehicle-trajectories\.npz and trajectories\.npz; give a folder with one"
    ):
        STUDY.rewrite(Data(tmp_path), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_pictures_of_examples_are_laid_out_as_published(tmp_path, drawn):
    table = read_sweep_table(DATA / "vehicle-sweep-radius-0.2.csv.gz")
    found = read_examples(Data(DATA), "vehicle-examples-radius-0.2.npz", table)
    assert list(found) == [6553, 81, 80] and [each.persistent for each in found.values()] == [0, 1768, 1759]
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
        pictures = examples.save_figures_of_examples(found, table, folder)
    files = sorted(path.name for path in folders[0].iterdir())
    assert files == sorted([*pictures, "examples.npz", "examples.csv"])
    assert all((folders[0] / name).read_bytes() == (folders[1] / name).read_bytes() for name in files)
    again = read_examples(Data(folders[0]), "examples.npz", table)
    for design, each in found.items():
        assert all(np.array_equal(again[design].arrays()[n], array, True) for n, array in each.arrays().items())
    bodies, landscape, rows = (drawn[name] for name in pictures)
    assert bodies.shape == landscape.shape == (1, 3) and rows.shape == (3, 3)
    assert letters(bodies) == letters(landscape) == letters(rows) == "ABC"
    assert [to_hex(landscape[0, 0].images[0].cmap(level)) for level in range(5)] == list(CHAPTER_3_COLOURS)
    assert [to_hex(rows[0, 2].images[0].cmap(level)) for level in range(5)] == list(CHAPTER_4_COLOURS)
    assert landscape[0, 1].images[0].get_array().shape == (121, 121)
    assert all(axes.get_xlim() == axes.get_ylim() == (-4, 4) for axes in rows[:, 1])
    assert {len(axes.lines) for axes in rows[:, 1]} == {4 + 4 + 1}  # paths, starts, light
    assert told(landscape[0, 1])[0] == "best $M_L$, design 81\n1768 of 14641 solve all"


def test_both_sets_of_trajectories_have_one_scale_and_all_succeed(tmp_path, drawn):
    found = read_trajectories(Data(DATA), "vehicle-trajectories.npz")
    assert all(found[f"reached_{name}"].all() for name in trajectories.SHOWN)
    save_trajectories(found, tmp_path)
    panels = [drawn[name] for name in trajectories.PICTURES]
    assert [letters(each) for each in panels] == ["AB", "ABC"]
    assert {axes.get_xlim() for each in panels for axes in each.flat} == {(-5, 5)}
    assert told(panels[1][0, 2]) == ["$w_1 = -0.28$, $w_2 = 0.37$: 4 of 4 reached"]
    again = read_trajectories(Data(tmp_path), "trajectories.npz")
    assert again.keys() == found.keys() and all(
        np.array_equal(again[n], found[n], n.startswith("paths")) for n in found
    )


@pytest.mark.kernels
def test_kept_trajectories_are_those_that_are_computed():
    kept, found = read_trajectories(Data(DATA), "vehicle-trajectories.npz"), trajectories.trajectories()
    assert kept.keys() == found.keys()
    for name in trajectories.SHOWN:  # before paths pass the light, which other machines' rounding may turn
        assert np.array_equal(kept[f"reached_{name}"], found[f"reached_{name}"])
        assert found[f"paths_{name}"][:, :, :5] == pytest.approx(kept[f"paths_{name}"][:, :, :5], abs=1e-3)


def test_matrices_and_sketches_begin_with_a_letter_and_name_their_bodies(tmp_path, drawn):
    save_landscape({"one": SOLVED, "two": SOLVED}, tmp_path / "a.png", "D")
    assert letters(drawn["a.png"]) == "DE" and told(drawn["a.png"][0, 0]) == ["one\n2 of 9 solve all"]
    save_sketches({"best": VehicleBody.published(162), "canonical": BASELINE}, tmp_path / "b.png")
    shown = [text for text in told(drawn["b.png"][0, 0]) if text]
    assert set(shown) == {r"$\ell_1$", r"$\ell_2$", "best: 162"}
    dots = [line.get_xydata()[0].tolist() for line in drawn["b.png"][0, 1].lines if line.get_marker() == "o"]
    assert dots == [[0.5, 0.5], [0.5, -0.5]]


def test_histograms_have_the_theory_above_and_rigid_bodies_below(tmp_path, drawn):
    rover_sweep.rewrite(Data(DATA / "rover-sweep"), tmp_path)
    panels = drawn["rover-sweep.png"]
    assert letters(panels) == "ABCD"
    assert [axes.get_xlabel().split(", ")[1] for axes in panels[:, 0]] == ["theoretical", "rigid bodies"]


def test_co_optimisation_has_means_with_bands_in_the_published_colours(tmp_path, drawn):
    data = Data(DATA / "co-optimisation")
    co_optimisation.rewrite(data, tmp_path)
    (left, right), medians = drawn["co-optimisation.png"][0], drawn["medians.png"]
    assert letters(drawn["co-optimisation.png"]) == "AB" and letters(medians) == "abc"
    blue, red, _ = [line.get_color() for line in left.lines]
    assert (blue, red) == (co_optimisation.BLUE, co_optimisation.RED)
    assert len(left.collections) == 3 and len(right.collections) == 2 and right.get_yscale() == "linear"
    rows = [row for row in read_records(data.path("homeostasis.csv.gz")) if row["arm"] == "co_optimised"]
    means = [row["mean"] for row in rows if (row["signals"], row["solutions"]) == ("raw", "all")]
    assert right.lines[0].get_ydata().tolist() == means and right.get_ylim()[0] == 0


def test_training_has_a_row_for_each_method_and_a_column_for_each_metric(tmp_path, drawn):
    evaluations = np.array([[[10, 20], [30, 50], [500, 500]]] * 3)
    table = training.TrainingTable(("random", "nes", "de"), np.array([80, 162, 6553]), evaluations, evaluations < 500)
    sweep = SweepTable(table.designs, np.array([9, 9, 0]), np.array([12, 12, 8]), Sweep(weights=9))
    training.save_training(table, sweep, tmp_path / "a.png")
    panels = drawn["a.png"]
    assert panels.shape == (3, 2) and [told(axes)[0] for axes in panels[:, 0]] == [
        "random search",
        "natural evolution strategy",
        "differential evolution",
    ]
    assert [axes.get_xlabel() for axes in panels[-1]] == ["$M_L$", "$M_{CI}$"]
    assert panels[0, 1].collections[0].get_offsets().tolist() == [[0.75, 15], [0.75, 40], [0, 500]]


def test_a_sweep_without_examples_is_told_without_them(tmp_path, drawn):
    copy(DATA / "vehicle-sweep.csv.gz", tmp_path)
    STUDY.rewrite(Data(tmp_path), tmp_path / "told")
    names = {path.name for path in (tmp_path / "told").iterdir()}
    assert "distributions.png" in names and not names & {"examples.png", "landscape.png", *trajectories.PICTURES}


def test_figures_are_those_of_matplotlib_with_the_letters_that_are_asked_for(tmp_path):
    with examples.figure(tmp_path / "a.png", 3, 2, "", ncols=2) as (one, panels):
        assert isinstance(one, Figure)
    assert letters(panels) == ""
