"""Built-in things and those of installed packages, found by name."""

import sys

import pytest
from plug_in import install

from taichi_sim.base.registry import Registry

GROUP = "morpholab.shapes"


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.fixture
def shapes():
    return Registry(GROUP, "shape", {"square": "fractions:Fraction", "circle": "decimal:Decimal"})


def test_builtin_things_are_imported_when_asked_for(shapes):
    from fractions import Fraction

    assert list(shapes) == ["square", "circle"] and len(shapes) == 2 and "circle" in shapes
    assert shapes["square"] is shapes.find("square") is Fraction


def test_packages_add_things_and_cannot_replace_any(shapes, path):
    module = "class Star: pass\n"
    install(path, "starry", GROUP, {"star": "starry:Star", "square": "starry:Star"}, module)
    assert list(shapes) == ["square", "circle", "star"] and shapes.check("star") == "star"
    assert "starry" not in sys.modules
    assert shapes["star"].__name__ == "Star" and shapes["square"].__name__ == "Fraction"
    del sys.modules["starry"]


def test_what_is_installed_or_removed_later_is_noticed(shapes, path, monkeypatch):
    """In a folder of the path that was empty when names were listed, and with the path."""
    assert "star" not in shapes
    install(path, "starry", GROUP, {"star": "fractions:Fraction"})
    assert "star" in shapes and shapes.package_of("star") == "starry"
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder != str(path)])
    assert "star" not in shapes
    monkeypatch.syspath_prepend(path)
    assert "star" in shapes
    (path / "starry-1.0.dist-info").rename(path / "elsewhere")
    assert "star" not in shapes


def test_unknown_names_are_told_the_nearest(shapes):
    with pytest.raises(ValueError, match=r"shape: 'sqare' is unknown; did you mean square\? all of them: square, circ"):
        shapes.find("sqare")
    for wrong in ("zzz", 3, None):
        with pytest.raises(ValueError, match="is unknown; choose one of square, circle"):
            shapes.check(wrong)
    with pytest.raises(KeyError):
        shapes["zzz"]


def test_what_cannot_be_imported_is_told_in_one_line(shapes, path):
    install(
        path, "broken", GROUP, {"blob": "broken:Blob", "drop": "missing_module:Drop"}, "raise RuntimeError('no\\nway')"
    )
    with pytest.raises(ValueError, match=r"shape: 'blob' of the package broken cannot be imported \(no way\)"):
        shapes.find("blob")
    with pytest.raises(ValueError, match="'drop' of the package broken cannot be imported"):
        shapes.find("drop")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("raise SystemExit(0)", "SystemExit: 0"),
        ("raise SystemExit('no licence')", "SystemExit: no licence"),
        ("raise type('Panic', (BaseException,), {})('no\\nway')", "Panic: no way"),
    ],
)
def test_an_exit_while_it_is_imported_is_told_like_any_failure(shapes, path, line, told):
    install(path, "broken", GROUP, {"blob": "broken:Blob"}, line)
    with pytest.raises(ValueError, match=rf"shape: 'blob' of the package broken cannot be imported \({told}\)"):
        shapes.find("blob")


def test_one_name_of_two_packages_is_refused(shapes, path):
    install(path, "one", GROUP, {"star": "fractions:Fraction"})
    install(path, "two", GROUP, {"star": "decimal:Decimal"})
    with pytest.raises(ValueError, match=r"'star' is defined by several packages \(one, two\)"):
        shapes.find("star")
