"""Files of heights on which worlds are: their checksums, and the copies that folders of results keep of them."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from robots.robot import World
from robots.world import Terrain
from taichi_sim.base.files import copy_in, sha256, write_bytes

WorldType = TypeVar("WorldType", bound=World)


def ground_files(worlds: Iterable[World]) -> dict[str, str]:
    """SHA-256 of each file of heights on which some worlds are, by its name, as it is now.

    Raises:
        ValueError: for a file that is missing or cannot be read.
    """
    return {file: sha256(content) for file, content in _contents(worlds).items()}


def keep_ground_files(worlds: Iterable[World], folder: Path) -> None:
    """Copy the files of heights on which some worlds are to a folder, which may then be moved or read elsewhere.

    Raises:
        ValueError: for a file that is missing or cannot be read, or a folder that cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    for file, content in _contents(worlds).items():
        write_bytes(copy_in(folder, file), content)


def kept_in(folder: Path, world: WorldType) -> WorldType:
    """A world that reads the copy of its file of heights that a folder keeps, if it keeps any; others as they are."""
    if isinstance(world, Terrain) and world.uneven is not None and world.uneven.file is not None:
        return dataclasses.replace(world, folder=folder)
    return world


def by_file_read(world: WorldType) -> WorldType:
    """A world whose name has the file of heights that is read, which may be a copy; others as they are."""
    if isinstance(world, Terrain) and world.uneven is not None and world.uneven.file is not None:
        ground = world.uneven.text.replace(world.uneven.file, str(world.uneven.source), 1)
        return dataclasses.replace(world, ground=ground, folder=None)
    return world


def _contents(worlds: Iterable[World]) -> dict[str, bytes]:
    """What is in each file of heights on which some worlds are, by its name."""
    grounds = [world.uneven for world in worlds if isinstance(world, Terrain) and world.uneven]
    return {str(ground.file): content for ground in grounds if (content := ground.content) is not None}
