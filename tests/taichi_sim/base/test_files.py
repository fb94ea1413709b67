"""Files and folders that are written whole or not at all."""

import os
import subprocess
import sys

import pytest

from taichi_sim.base.claims import claimed_path
from taichi_sim.base.file_kinds import check_no_pipe
from taichi_sim.base.files import ASIDE, _aside, check_parent, new_folder, remove_cut_off, replacing, write_text


def cut_off(path):
    """What a process that has ended wrote aside for a path."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    return path.with_name(_aside(path).name.replace(str(os.getpid()), str(ended.pid), 1))


def test_a_new_folder_takes_its_name_when_it_is_whole(tmp_path):
    path = tmp_path / "above" / "new"
    with new_folder(path) as inside:
        (inside / "deep").mkdir()
        (inside / "deep" / "file").write_text("content")
        assert not path.exists() and inside.name.startswith(ASIDE)
    assert (path / "deep" / "file").read_text() == "content"
    assert [each.name for each in path.parent.iterdir()] == ["new"]


def test_a_new_folder_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(KeyError), new_folder(tmp_path / "new") as inside:
        (inside / "file").write_text("content")
        raise KeyError
    assert not any(tmp_path.iterdir())


def test_what_a_killed_process_of_the_same_number_left_is_no_hindrance(tmp_path):
    """As in a container that starts again, in which a command has always the same number."""
    left = _aside(tmp_path / "new")
    left.mkdir()
    (left / "half").write_text("old")
    with new_folder(tmp_path / "new") as inside:
        (inside / "file").write_text("content")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["file"]


def test_a_folder_that_has_come_meanwhile_is_not_replaced(tmp_path):
    with pytest.raises(OSError, match="not empty"), new_folder(tmp_path / "new") as inside:
        (inside / "file").write_text("mine")
        (tmp_path / "new").mkdir()
        (tmp_path / "new" / "file").write_text("theirs")
    assert (tmp_path / "new" / "file").read_text() == "theirs"
    assert [each.name for each in tmp_path.iterdir()] == ["new"]


@pytest.mark.parametrize("remove", [remove_cut_off, lambda folder: new_folder(folder / "other").__enter__()])
def test_folders_and_files_that_a_kill_cut_off_are_removed_and_others_are_not(tmp_path, remove):
    folder, file, living = cut_off(tmp_path / "folder"), cut_off(tmp_path / "file"), _aside(tmp_path / "living")
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "part").write_text("half")
    file.write_text("half")
    living.mkdir()
    remove(tmp_path)
    assert not folder.exists() and not file.exists() and living.exists()


def test_a_run_goes_on_beside_a_folder_that_is_being_written_in_it(tmp_path):
    """Such as one for ParaView; that of a killed process goes."""
    from optim.runs.folder import open_run

    config = {"problem": {"name": "any"}, "method": {"name": "genetic"}, "generations": 2}
    for _ in "ab":
        with open_run(tmp_path / "run", config, resume=True):
            pass
        living, left = _aside(tmp_path / "run" / "view"), cut_off(tmp_path / "run" / "view")
        living.mkdir(exist_ok=True)
        left.mkdir()
    with open_run(tmp_path / "run", config, resume=True):
        assert living.exists() and not left.exists()


def test_a_pipe_stays_one(tmp_path):
    """Also where a link leads to it."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for name in ("pipe", "link"):
        path = tmp_path / name
        with pytest.raises(ValueError, match=f"{name}: cannot be written .{name} is a pipe or device; name a file"):
            write_text(path, "new")
        with pytest.raises(ValueError, match=f"^out: {path} is a pipe or device; name a file$"):
            check_no_pipe("out", path)
        assert path.is_fifo()
    assert (tmp_path / "link").is_symlink() and len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_and_the_file_to_which_it_leads_is_written(tmp_path, there):
    (tmp_path / "folder").mkdir()
    target, link = tmp_path / "folder" / "target", tmp_path / "link"
    link.symlink_to("folder/target")
    if there:
        target.write_text("old")
    check_no_pipe("out", link)
    with replacing(link) as aside:
        aside.write_text("new")
        assert aside.parent == target.parent  # else another disk could not rename it
    assert link.is_symlink() and link.read_text() == target.read_text() == "new" and not target.is_symlink()
    assert [each.name for each in target.parent.iterdir()] == ["target"]


def test_a_link_to_itself_is_told(tmp_path):
    (tmp_path / "link").symlink_to("link")
    with pytest.raises(ValueError, match=r"link: cannot be written .Too many levels of symbolic links"):
        write_text(tmp_path / "link", "new")
    with pytest.raises(ValueError, match=r"out: .*link cannot be written .Too many levels of symbolic links"):
        check_no_pipe("out", tmp_path / "link")


def test_a_folder_that_may_be_written_but_not_listed_takes_files(tmp_path, monkeypatch):
    """A new name in it cannot be waited for, and is there all the same."""
    opened = os.open

    def unlisted(path, *given, **options):
        if os.fspath(path) == str(tmp_path):
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *given, **options)

    monkeypatch.setattr(os, "open", unlisted)
    write_text(tmp_path / "file", "content")
    with new_folder(tmp_path / "folder") as inside:
        (inside / "file").write_text("content")
    assert (tmp_path / "file").read_text() == (tmp_path / "folder" / "file").read_text() == "content"


LONG = {"one byte": "b" * 250 + ".html", "three": "\N{BLACK STAR}" * 83 + ".csv", "no UTF-8": "b" * 240 + "\udcff.html"}


@pytest.mark.parametrize("name", LONG.values(), ids=LONG)
def test_a_name_as_long_as_the_disk_takes_is_written(tmp_path, name):
    path = tmp_path / name
    left = cut_off(path)
    left.write_text("half")
    with claimed_path("out", path), replacing(path) as aside:
        aside.write_text("content")
        assert aside.suffix == path.suffix and aside.name.startswith(ASIDE)
    remove_cut_off(tmp_path)
    assert [each.read_text() for each in tmp_path.iterdir()] == ["content"] and path.exists()


def test_long_names_of_one_end_do_not_share_what_is_aside(tmp_path):
    first, second = (tmp_path / (letter + "b" * 200) for letter in "ac")
    with claimed_path("out", first), claimed_path("out", second):
        assert _aside(first) != _aside(second)


def test_a_name_longer_than_the_disk_takes_is_refused_before_work(tmp_path):
    with pytest.raises(ValueError, match=r"^out: a name of 256 bytes is too long for a file; give at most 255$"):
        check_parent("out", tmp_path / ("\N{BLACK STAR}" * 84 + ".csv"))
