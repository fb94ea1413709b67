"""What ``morpholab view`` can write: pages, pictures, films, and files for other programs."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import options
from taichi_sim.base.files import claimed_path

if TYPE_CHECKING:
    from robots.view.motion import Motion

COLOURS = ("material", "strain", "contact", "friction", "beams")
LONGEST_FILM = 10.0  # unless asked for [s]


@dataclass(frozen=True)
class Output:
    """A file or folder that can be asked for.

    Attributes:
        option: of the command line.
        metavar: what is given to it.
        told: what it is, for people.
        write: writes motions to a path, and tells the bytes.
        several: whether it can hold several robots.
        endings: that its name may have; any if there are none.
    """

    option: str
    metavar: str
    told: str
    write: Callable[[Sequence["Motion"], Path, argparse.Namespace], int]
    several: bool = False
    endings: tuple[str, ...] = ()


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Options for all of them, and for how they look."""
    for output in OUTPUTS:
        parser.add_argument(f"--{output.option}", type=Path, metavar=output.metavar, help=output.told)
    group = parser.add_argument_group("pictures and films")
    group.add_argument(
        "--at", type=options.number(0.0, unit="s"), metavar="SECONDS", help="time of the picture (default: the end)"
    )
    group.add_argument(
        "--colour",
        choices=COLOURS,
        default="material",
        help="of voxel robots: material; strain of "
        "links; contact with the floor and the robot itself; friction of feet; or beams and pressure "
        "(default: material)",
    )
    group.add_argument(
        "--seconds",
        type=options.number(0.5, 600.0, "s"),
        metavar="S",
        help=f"that films take (default: as long as the motion, at most {LONGEST_FILM:g})",
    )


def check_outputs(args: argparse.Namespace) -> None:
    """Check that everything asked for can be written, and keep other processes off it while the command runs.

    Raises:
        ValueError: if nothing is asked for, a path exists or cannot be written, or a file would hold several robots
            although it can hold only one.
    """
    asked = _asked(args)
    if not asked:
        raise ValueError("out: there is nothing to write; give --out page.html, --glb file.glb or --picture file.png")
    for output, path in asked:
        args.held.enter_context(claimed_path(output.option, path, output.metavar.lower()))
        if output.endings and path.suffix.lower() not in output.endings:
            endings = " or ".join(output.endings)
            raise ValueError(f"{output.option}: {path} is not allowed; give a name that ends in {endings}")
        if not output.several and len(args.sources) > 1:
            raise ValueError(f"{output.option}: {len(args.sources)} robots are not allowed in one file; give one")
    if args.at is not None and args.picture is None:
        raise ValueError("at: there is no picture; give --picture file.png")
    films = args.gif is not None or args.mp4 is not None
    if args.seconds is not None and not films:
        raise ValueError("seconds: there is no film; give --gif file.gif or --mp4 file.mp4")
    if args.colour != "material" and args.picture is None and args.strip is None and not films:
        raise ValueError(f"colour: {args.colour} is of pictures and films; give --picture file.png or --gif file.gif")
    if args.strip is not None and args.colour == "beams":
        raise ValueError("colour: beams is not allowed for a strip; give material, strain, contact or friction")
    if args.mp4 is not None:
        from robots.view.film import need_video

        need_video()


def write_outputs(motions: Sequence["Motion"], args: argparse.Namespace) -> list[tuple[Path, int]]:
    """Write everything asked for: paths and bytes."""
    return [(path, output.write(motions, path, args)) for output, path in _asked(args)]


def _asked(args: argparse.Namespace) -> list[tuple[Output, Path]]:
    given = [(output, getattr(args, output.option)) for output in OUTPUTS]
    return [(output, path) for output, path in given if path is not None]


def _picture(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.still import save_still

    return save_still(motions[0], path, at=args.at, colour=args.colour)


def _strip(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.film import save_strip

    return save_strip(motions[0], path, colour=args.colour)


def _gif(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.film import save_gif

    return save_gif(motions, path, seconds=_film_seconds(motions, args), colour=args.colour)


def _mp4(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.film import save_mp4

    return save_mp4(motions, path, seconds=_film_seconds(motions, args), colour=args.colour)


def _film_seconds(motions: Sequence["Motion"], args: argparse.Namespace) -> float:
    longest = max(float(m.times[-1] - m.times[0]) for m in motions)
    return args.seconds or max(min(longest, LONGEST_FILM), 0.5)


def _paraview(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.paraview import save_paraview

    return save_paraview(motions[0], path)


def _glb(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.glb import save_glb

    return save_glb(motions[0], path)


def _page(motions: Sequence["Motion"], path: Path, args: argparse.Namespace) -> int:
    from robots.view.player import save_player

    return save_player(list(motions), path, title=args.title or ", ".join(args.sources))


# What may be refused for a robot comes first, so that nothing is written then.
OUTPUTS = (
    Output(
        "picture", "FILE", "picture to write, of one robot (png, pdf, svg)", _picture, endings=(".png", ".pdf", ".svg")
    ),
    Output(
        "strip", "FILE", "film strip to write, of one robot (png, pdf, svg)", _strip, endings=(".png", ".pdf", ".svg")
    ),
    Output("gif", "FILE", "moving picture to write", _gif, several=True, endings=(".gif",)),
    Output("mp4", "FILE", "video to write; needs the extra 'video'", _mp4, several=True, endings=(".mp4",)),
    Output("paraview", "FOLDER", "folder to write, of one robot, for ParaView", _paraview),
    Output("glb", "FILE", "animation to write, of one robot, for Blender", _glb, endings=(".glb",)),
    Output("out", "FILE", "page to write, such as gait.html", _page, several=True, endings=(".html", ".htm")),
)
