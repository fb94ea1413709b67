"""Patches of neighbouring cells, and the mutations of the genetic algorithm that change them together."""

import numpy as np
import pytest
from searching import CELL_GRID as SPACE
from searching import PLACES, SIDES
from standard_functions import mixed_space

from optim.problem import Evaluation
from optim.problems.function import FIELDS
from optim.search import GeneticSearch
from optim.search.neighbourhood import Neighbourhood
from optim.space import Space, Variable

CELLS = len(PLACES)
THERE = slice(1, 1 + CELLS)


def block():
    """A body of six cells in the middle."""
    there = np.zeros(SIDES)
    there[1:4, 1:3] = 1
    return np.concatenate([[0.5], there.ravel(), np.full(CELLS, 5.0), np.full(CELLS, 0.5)])


def one_family(parent, count=3000, **settings):
    """The children of copies of one point."""
    method = GeneticSearch(SPACE, population=count, seed=2, **settings)
    method.tell(np.tile(parent, (count, 1)), Evaluation(np.zeros(count)))
    return method.ask()


def connected(cells):
    """Whether places are one piece whose neighbours share sides."""
    left, edge = set(cells[1:]), [cells[0]]
    while edge:
        x, y = edge.pop()
        beside = {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)} & left
        left -= beside
        edge += beside
    return not left


def test_variables_of_one_place_are_a_cell_and_layers_are_their_kinds():
    found = Neighbourhood(SPACE)
    assert found.cell[0] == -1 and len(found.places) == CELLS
    np.testing.assert_array_equal(found.cell[1:].reshape(3, CELLS), np.tile(np.arange(CELLS), (3, 1)))
    np.testing.assert_array_equal(found.layers, np.arange(1, 1 + 3 * CELLS).reshape(3, CELLS))


def test_a_patch_is_one_layer_of_cells_side_by_side():
    parent = block()
    shares = np.zeros(3)
    for child in one_family(parent, patches=1.0):
        changed = np.flatnonzero(child != parent) - 1
        layers = set(changed // CELLS)
        assert len(changed) and len(layers) == 1
        layer = layers.pop()
        shares[layer] += 1 / 3000
        if layer:  # a ball, all of it by the same step
            assert connected([PLACES[n % CELLS] for n in changed])
            away = SPACE.offset(child, parent)[changed + 1]
            np.testing.assert_allclose(away, away[0])
        else:
            assert len(set(child[changed + 1])) == 1  # added or removed together
    assert shares == pytest.approx(1 / 3, abs=0.04)


def test_cells_are_added_and_removed_at_the_surface_more_than_elsewhere():
    parent = block()
    added, removed = np.zeros(CELLS), np.zeros(CELLS)
    for child in one_family(parent, patches=1.0):
        change = child[THERE] - parent[THERE]
        added, removed = added + (change > 0), removed + (change < 0)
    assert added.sum() > 300 and removed.sum() > 300
    corner, beside = added.reshape(SIDES)[0, 0], added.reshape(SIDES)[0, 1:3]
    assert (beside > 2 * corner).all() and corner > 0  # inside a ball about a cell that is not there


def test_a_full_grid_has_a_surface_too():
    parent = block()
    parent[THERE] = 1
    gone = (one_family(parent, patches=1.0)[:, THERE] == 0).mean(axis=0).reshape(SIDES)
    rim = np.ones(SIDES, bool)
    rim[1:-1, 1:-1] = False
    assert gone[rim].min() > 0.01 and gone[~rim].min() > 0.01


def test_without_patches_places_change_nothing():
    bare = Space(tuple(Variable(v.name, v.low, v.high, v.kind, v.step) for v in SPACE.variables))
    children = []
    for space in (SPACE, bare):
        method = GeneticSearch(space, population=20, seed=5)
        method.tell(method.ask(), Evaluation(np.arange(20.0)))
        children.append(method.ask())
    np.testing.assert_array_equal(*children)


def test_some_children_mutate_in_patches():
    parent = block()
    patched = (one_family(parent, patches=0.25) != parent).sum(axis=1) > 4
    assert 0.05 < patched.mean() < 0.25


def test_patches_are_found_again_after_a_resume():
    method, again = (GeneticSearch(SPACE, population=8, patches=0.5) for _ in range(2))
    for _ in range(3):
        method.tell(method.ask(), Evaluation(method.ask()[:, 0]))
    again.restore(method.state())
    np.testing.assert_array_equal(method.ask(), again.ask())


@pytest.mark.parametrize(
    "space",
    [mixed_space(4), Space((Variable("a", 0, 1, place=(1,)), Variable("b", 0, 1, place=(1, 2))))],
    ids=["no places", "other axes"],
)
def test_patches_need_places(space):
    with pytest.raises(ValueError, match=r"^patches: only allowed where variables have places"):
        GeneticSearch(space, patches=0.5)


def test_a_place_is_neither_shown_nor_described():
    assert "place" not in repr(SPACE.variables[1]) and "place" not in FIELDS
