"""Uneven ground by name: hills, stairs, blocks, ramps, gaps, waves, friction, courses, files; sand and water on it.

A ground is a function of the place, the same everywhere and for every robot; robots stand on what they need of it (a
``Relief``). Its x axis is the direction of travel.
"""

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.course import TIE
from robots.ground_images import FORMATS, brightness_of, check_image
from robots.ground_kinds import COVERS, LEVEL, Cover, GroundKind, ground_kind, read_numbers, ways
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import UNREADABLE, array_of, content_of, copy_in, why_unread
from taichi_sim.base.short_text import shortest

if TYPE_CHECKING:
    from taichi_sim.lattice import Relief, Water

BEHIND, AHEAD, BESIDE = 1.0, 4.0, 1.5  # m of ground around the start of a robot; it goes on as at this edge
MOST_NODES_ALONG = 1500
SAMPLED, EVEN = 1e-3, 1e-9  # m along the way, and how much what is level differs, where that is asked
FILES = (".npy", *FORMATS)
_OF_FILE = re.compile(rf"(.*(?:{'|'.join(map(re.escape, FILES))}))(?::(.*))?", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Ground:
    """Ground that is not level, or not alike everywhere.

    Attributes:
        text: such as ``"rough:0.01,0.05"``, ``"stairs:0.01,0.1"`` or ``"hills.npy:0.01"``, a file of heights and maybe
            of friction; after it what is on it, or alone on level ground: ``"ramp:-5+water:0"``, ``"sand:2e5"``. Sand
            yields to a stress per depth [N/m^3]; water fills up to a level over the floor [m].
        folder: that keeps a copy of its file, which is then read in its place; None keeps none.
    """

    text: str
    folder: Path | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.text, str):
            raise ValueError(f"ground: {self.text!r} is not allowed; give its name, such as 'rough:0.01'")
        self._checked()
        self._check_laws()

    @property
    def solid(self) -> str:
        """The text without what is on the ground; empty for level ground."""
        return "+".join(part for part in self._parts if part not in self.covers)

    @property
    def covers(self) -> tuple[str, ...]:
        """The texts of what is on the ground.

        Raises:
            ValueError: for two of a kind.
        """
        found = tuple(part for part in self._parts if part.partition(":")[0] in COVERS)
        kinds = [part.partition(":")[0] for part in found]
        if len(set(kinds)) < len(kinds):
            raise ValueError(f"terrain: {self.text!r} is not allowed; give each of {', '.join(COVERS)} once")
        return found

    @property
    def is_wet(self) -> bool:
        """Whether there is water on it."""
        return any(cover.wet for cover, _ in self._covers)

    @property
    def laws(self) -> dict[str, Any]:
        """What is on it as arguments of a ``Relief``: the water, the stress per depth at which it yields."""
        return {name: law(*numbers) for cover, numbers in self._covers for name, law in cover.laws.items()}

    @property
    def water(self) -> "Water | None":
        """The water on it."""
        return self.laws.get("water")

    @property
    def _covers(self) -> list[tuple[Cover, tuple[float, ...]]]:
        """What is on the ground, with its numbers, in the order of ``COVERS``."""
        given = {name: numbers for name, _, numbers in (part.partition(":") for part in self.covers)}
        return [(cover, cover.read(given[name], self.text)) for name, cover in COVERS.items() if name in given]

    def _check_laws(self) -> None:
        """Refuse covers of which two say the same about the ground."""
        known: dict[str, str] = {}
        for cover, _ in self._covers:
            for law in cover.laws:
                if law in known:
                    told = f"{known[law]} and {cover.name} both say its {law}"
                    raise ValueError(f"terrain: {self.text!r} is not allowed, as {told}; give one of them")
                known[law] = cover.name

    @property
    def _parts(self) -> list[str]:
        """The parts of the text, one by one: the ground, then what is on it."""
        return _parts_of(self.text)

    @property
    def file(self) -> str | None:
        """The file of its heights; None for ground that is made from numbers."""
        found = _OF_FILE.fullmatch(self.solid)
        return found[1] if found else None

    @property
    def source(self) -> Path | None:
        """The file that is read: the copy that the folder keeps, or else the one that is named."""
        if self.file is None:
            return None
        copy = None if self.folder is None else copy_in(self.folder, self.file)
        return copy if copy and copy.is_file() else Path(self.file)

    def check_file(self) -> None:
        """Refuse a file that is missing, or an image that may not be named; what only tells of a ground needs none.

        Copies of images that a folder keeps are read as they were when they were named, by whichever version.

        Raises:
            ValueError: if there is none, or its image is not allowed.
        """
        if self.source is not None and not self.source.is_file():
            copy = "" if self.folder is None else f", and {self.folder} keeps no copy of it"
            raise ValueError(f"terrain: {self.file!r} is no file{copy}")
        if self.source is not None and self.folder is None and self.source.suffix.lower() in FORMATS:
            check_image(self.source, self.source.stat().st_mtime_ns)

    @property
    def content(self) -> bytes | None:
        """The bytes of the file of its heights; None without a file.

        Raises:
            ValueError: if the file is missing or cannot be read.
        """
        self.check_file()
        try:
            return None if self.source is None else content_of(self.source)
        except OSError as error:
            raise ValueError(f"terrain: {self.file!r} cannot be read ({why_unread(error)})") from None

    def _checked(self) -> tuple[GroundKind | None, tuple[float, ...]]:
        """The kind, or None for a file, and its numbers.

        Raises:
            ValueError: for any other text, and numbers that are not allowed.
        """
        if not self.solid:
            return LEVEL, ()
        if found := _OF_FILE.fullmatch(self.solid):
            return None, self._file_numbers(found[1], found[2] or "")
        name, _, numbers = self.solid.partition(":")
        if (kind := ground_kind(name)) is None:
            raise ValueError(f"terrain: {self.text!r} is unknown; give {ways()}")
        return kind, kind.read(numbers, self.text)

    def _file_numbers(self, file: str, given: str) -> tuple[float, ...]:
        image = Path(file).suffix.lower() in FORMATS
        numbers = read_numbers(given, self.text, 2 if image else 1)
        if len(numbers) != (2 if image else 1) or min(numbers) <= 0:
            way = "FILE.png:HEIGHT,SPACING" if image else "FILE.npy:SPACING"
            raise ValueError(f"terrain: {self.text!r} is not allowed; give {way}, in metres, more than 0")
        return numbers

    def relief(self, heading: float, edge: float) -> "Relief":
        """The ground around a robot that heads somewhere [degrees from x towards y], on a grid of half an edge [m].

        Raises:
            ValueError: for ground that is too steep on a grid of half an edge, and files that are no heights.
        """
        self.check_file()
        changed = None if self.source is None else self.source.stat().st_mtime_ns
        return _relief(self, float(heading), float(edge), changed)

    def level_until(self, begin: float, end: float) -> float | None:
        """Up to where it is as it is below a robot, from which on it differs [m ahead of the origin].

        Args:
            begin: where the robot begins along its heading [m].
            end: where it ends [m].

        Returns:
            Infinity where it is the same everywhere ahead; None where it already differs below or beside the robot.

        Raises:
            ValueError: for files that are no heights.
        """
        self.check_file()
        x, y = np.arange(begin, max(AHEAD, begin + SAMPLED), SAMPLED), (end - begin) * np.linspace(-1, 1, 9)
        found = _values(self, *np.meshgrid(x, y, indexing="ij"))
        changes = [abs(each - each[0, 0]).max(axis=1) > EVEN for each in found if each is not None]
        where = x[np.logical_or.reduce(changes)]
        if not len(where):
            return math.inf
        return None if where[0] <= end else float(where[0])

    @property
    def is_level(self) -> bool:
        """Whether it is the same height everywhere, whatever its friction and what is on it.

        Raises:
            ValueError: for files that are no heights.
        """
        kind, numbers = self._checked()
        if kind is not None:
            return kind.is_level(*numbers)
        self.check_file()
        heights, _ = _tables(str(self.source))
        return float(np.ptp(heights)) <= EVEN

    @property
    def start_name(self) -> str | None:
        """The number that says where it begins; None for kinds of ground that begin nowhere."""
        kind, _ = self._checked()
        return None if kind is None or kind.start is None else kind.numbers[kind.start].name

    def beginning_at(self, place: float) -> str | None:
        """The text with another start [m]; None for kinds of ground that begin nowhere."""
        kind, numbers = self._checked()
        if kind is None or kind.start is None:
            return None
        texts = [f"{place:g}" if n == kind.start else shortest(number) for n, number in enumerate(numbers)]
        return "+".join([f"{self.solid.partition(':')[0]}:{','.join(texts)}", *self.covers])

    @property
    def spoken(self) -> str:
        """The ground in words, such as ``"smooth random hills of sand (rough:0.01+sand:2e5)"``."""
        kind, _ = self._checked()
        told = "ground of a file" if kind is None else kind.description
        return " ".join([told, *(cover.spoken for cover, _ in self._covers), f"({self.text})"])


def is_ground(text: str) -> bool:
    """Whether a name begins like that of a kind of ground, or of a file of heights."""
    first, of_file = text.partition(":")[0], _OF_FILE.fullmatch(_parts_of(text)[0])
    return ground_kind(first) is not None or (first in COVERS and first != text) or of_file is not None


def _parts_of(text: str) -> list[str]:
    """What the name of a ground names, one by one: the ground, then what is on it; names of files may have a plus."""
    parts = text.split("+")
    last = next((n for n, part in enumerate(parts) if part.partition(":")[0] in COVERS), len(parts))
    return [*(["+".join(parts[:last])] if last else []), *parts[last:]]


@lru_cache(maxsize=16)
def _relief(given: Ground, heading: float, edge: float, changed: int | None) -> "Relief":
    """:meth:`Ground.relief`; a batch shares the ground of robots that head alike, of a file as it last changed."""
    from taichi_sim.lattice import Relief

    spacing = _spacing(edge)
    _check_fineness(given, spacing)
    angle = math.radians(heading)
    cosine, sine = math.cos(angle), math.sin(angle)
    corners = [(cosine * x - sine * y, sine * x + cosine * y) for x in (-BEHIND, AHEAD) for y in (-BESIDE, BESIDE)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    counts = np.ceil((high - low) / spacing).astype(int) + 1
    x, y = np.meshgrid(*(first + spacing * np.arange(n) for first, n in zip(low, counts, strict=True)), indexing="ij")
    heights, friction = _values(given, x * cosine + y * sine, y * cosine - x * sine)
    try:
        origin = float(low[0]), float(low[1])
        return Relief(heights, spacing, origin, friction, **given.laws)
    except ValueError as refused:
        raise ValueError(f"terrain: {given.text!r} on a grid of {spacing:g} m: {refused}") from None


def _check_fineness(ground: Ground, spacing: float) -> None:
    """Refuse ground with shapes that the nodes of its grid could miss, however it is turned."""
    kind, values = ground._checked()
    for number, value in zip(kind.numbers if kind is not None else (), values, strict=False):
        if number.nodes and value < (least := number.nodes * spacing) - TIE:
            raise ValueError(
                f"terrain: {number.name} {shortest(value)} of {ground.text!r} is not allowed on this robot's grid of "
                f"{1e3 * spacing:.3g} mm; give at least {math.ceil(1e5 * least - 1e-6) / 1e5:g}"
            )


def _values(ground: Ground, along: Floats, across: Floats) -> tuple[Floats, Floats | None]:
    """Heights [m] and factors of friction at places; None where that is 1 everywhere."""
    from taichi_sim.lattice import Relief

    kind, numbers = ground._checked()
    if kind is not None:
        friction = kind.friction and kind.friction(along, across, *numbers)
        return kind.height(along, across, *numbers), friction
    file = str(ground.source)
    heights, friction = _tables(file)
    *height, spacing = numbers
    if height:
        heights = heights * height[0]
    try:
        given = Relief(heights, spacing, tuple(-spacing * (count - 1) / 2 for count in heights.shape), friction)
    except ValueError as refused:
        raise ValueError(f"terrain: {file!r}: {refused}") from None
    return given.height(along, across), None if friction is None else given.factor(along, across)


def _tables(file: str) -> tuple[Floats, Floats | None]:
    """Heights [m], or the brightness of an image from 0 to 1, and factors of friction if a file has any; rows along x.

    Raises:
        ValueError: for a file of anything else.
    """
    try:
        content = content_of(file)
        if Path(file).suffix.lower() == ".npy":
            table: Any = array_of(content)
        else:
            table = brightness_of(content, Path(file).suffix)
    except UNREADABLE as failed:
        raise ValueError(f"terrain: {file!r} cannot be read as heights: {failed}") from None
    _check_table(file, table)
    heights, *friction = np.asarray(table[None] if table.ndim == 2 else table, float)
    return heights, friction[0] if friction else None


def _check_table(file: str, table: Any) -> None:
    """Refuse an array of another shape, of anything but real numbers, and with numbers that are not finite."""
    if not (table.ndim == 2 or (table.ndim == 3 and len(table) == 2)):
        found = f"has shape {table.shape}"
    elif table.dtype.kind not in "iuf":
        found = f"holds {table.dtype}"
    elif count := int((~np.isfinite(table)).sum()):
        found = f"holds {count} of {table.size} values that are not finite"
    else:
        return
    allowed = "a table of finite numbers, shape (X, Y), or (2, X, Y) with factors of friction second"
    raise ValueError(f"terrain: {file!r} {found}; give {allowed}")


def level(edge: float) -> "Relief":
    """Level ground on the grid of :meth:`Ground.relief`, for robots beside others on uneven ground."""
    from taichi_sim.lattice import Relief

    return Relief(np.zeros((2, 2)), _spacing(edge))


def _spacing(edge: float) -> float:
    """Distance between nodes of the ground [m], for voxels of an edge [m]."""
    return max(edge / 2, (BEHIND + AHEAD) / MOST_NODES_ALONG)
