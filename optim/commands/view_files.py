"""What ``morpholab view`` can write: pages, pictures, films, and files for other programs."""

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import options
from optim.commands.options import Option, path_to
from robots.view.colour_names import COLOURS, listed
from taichi_sim.base.claims import claimed_path, undone_if_it_fails
from taichi_sim.base.lazy import imported

if TYPE_CHECKING:
    from robots.view.motion import Motion

LONGEST_FILM = 10.0  # unless asked for [s]
PICTURES = (".png", ".pdf", ".svg")
TITLE = Option("title", "of the page", default="")
APPEARANCE = (
    Option("at", "time of the picture (default: the end)", options.number(0.0, unit="s"), "SECONDS"),
    Option(
        "colour",
        "of voxel robots: material; strain of links; contact with the floor and the robot itself; friction of feet; "
        "channel that drives them; or beams and pressure (default: material)",
        choices=COLOURS,
        default="material",
    ),
    Option(
        "seconds",
        f"that films take (default: as long as the motion, at most {LONGEST_FILM:g})",
        options.number(0.5, 600.0, "s"),
        "S",
    ),
)


@dataclass(frozen=True)
class Output:
    """A file or folder that can be asked for.

    Attributes:
        name: of its option.
        description: what it is, for people.
        writer: module and name of the function that writes a motion, or several, to a path, and tells the bytes.
        settings: options that the writer takes, by the same name.
        several: whether it can hold several robots.
        endings: that its name may have; any if there are none.
        metavar: what is given to the option.
        checker: module and name of a function that refuses, before any work, what cannot be written.
        checked: options that it takes, by the same name.
    """

    name: str
    description: str
    writer: str
    settings: tuple[str, ...] = ()
    several: bool = False
    endings: tuple[str, ...] = ()
    metavar: str = "FILE"
    checker: str = ""
    checked: tuple[str, ...] = ()

    @property
    def option(self) -> Option:
        """The option that asks for it."""
        return path_to(self.name, self.metavar, self.description)

    def check(self, args: argparse.Namespace) -> None:
        """Refuse what cannot be written.

        Raises:
            ValueError: if a package is missing, or an option is of other files.
        """
        if self.checker:
            imported(self.checker)(*(getattr(args, name) for name in self.checked))

    def write(self, motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
        """Write motions to a path; the bytes."""
        settings: dict[str, Any] = {name: getattr(args, name) for name in self.settings}
        if "seconds" in settings and args.seconds is None:
            longest = max(float(m.times[-1] - m.times[0]) for m in motions)
            settings["seconds"] = max(min(longest, LONGEST_FILM), 0.5)
        if "title" in settings:
            settings["title"] = args.title or ", ".join(args.sources)
        return int(imported(self.writer)(list(motions) if self.several else motions[0], path, **settings))


# What may be refused for a robot comes first, so that nothing is written then.
OUTPUTS = (
    Output(
        "picture",
        "picture to write, of one robot (png, pdf, svg)",
        "robots.view.still:save_still",
        ("at", "colour"),
        endings=PICTURES,
    ),
    Output(
        "strip",
        "film strip to write, of one robot (png, pdf, svg)",
        "robots.view.film:save_strip",
        ("colour",),
        endings=PICTURES,
        checker="robots.view.colour_names:check_colour_of_strip",
        checked=("colour",),
    ),
    Output("gif", "moving picture to write", "robots.view.film:save_gif", ("seconds", "colour"), True, (".gif",)),
    Output(
        "mp4",
        "video to write; needs the extra 'video'",
        "robots.view.film:save_mp4",
        ("seconds", "colour"),
        True,
        (".mp4",),
        checker="robots.view.film:need_video",
    ),
    Output(
        "paraview",
        "folder to write, of one robot, for ParaView",
        "robots.view.paraview:save_paraview",
        metavar="FOLDER",
    ),
    Output(
        "rerun",
        "recording to write, of one robot, for the Rerun viewer; needs the extra 'rerun'",
        "robots.view.rerun_file:save_rerun",
        endings=(".rrd",),
        checker="robots.view.rerun_file:need_rerun",
    ),
    Output("glb", "animation to write, of one robot, for Blender", "robots.view.glb:save_glb", endings=(".glb",)),
    Output(
        "out", "page to write, such as gait.html", "robots.view.player:save_player", ("title",), True, (".html", ".htm")
    ),
)


def check_outputs(args: argparse.Namespace) -> None:
    """Check that everything asked for can be written, and keep other processes off it while the command runs.

    Raises:
        ValueError: if nothing is asked for, a path exists or cannot be written, a package is missing, a file would hold
            several robots although it can hold only one, or an option is of no file that is asked for.
    """
    asked = _asked(args)
    if not asked:
        raise ValueError(f"out: there is nothing to write; give {_flags(OUTPUTS)}")
    for output, path in asked:
        args.held.enter_context(claimed_path(output.name, path, output.metavar.lower()))
        if output.endings and path.suffix.lower() not in output.endings:
            endings = " or ".join(output.endings)
            raise ValueError(f"{output.name}: {path} is not allowed; give a name that ends in {endings}")
        if not output.several and len(args.sources) > 1:
            raise ValueError(f"{output.name}: {len(args.sources)} robots are not allowed in one file; give one")
    for option in (TITLE, *APPEARANCE):
        given, of = getattr(args, option.name), [each for each in OUTPUTS if option.name in each.settings]
        if given != option.default and not any(output in of for output, _ in asked):
            raise ValueError(f"{option.name}: no file asked for takes it; give {_flags(of)}")
    for output, _ in asked:
        output.check(args)


def write_outputs(motions: Sequence["Motion"], args: argparse.Namespace) -> list[tuple[Path, int]]:
    """Write everything asked for: paths and bytes."""
    written: list[tuple[Path, int]] = []
    with undone_if_it_fails() as made:
        for output, path in _asked(args):
            if not os.path.lexists(path):  # what another program has put there since is refused, and stays
                made.append(path)
            written.append((path, output.write(motions, path, args)))
    return written


def _asked(args: argparse.Namespace) -> list[tuple[Output, Path]]:
    paths = [(output, getattr(args, output.name)) for output in OUTPUTS]
    return [(output, path) for output, path in paths if path is not None]


def _flags(outputs: Sequence[Output]) -> str:
    return listed(tuple(f"--{output.name}" for output in outputs))
