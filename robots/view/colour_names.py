"""Names of the colours in which views show robots. Needs nothing heavy, so that commands can list them."""

BEAMS = "beams"  # links and pressure in place of the parts' faces
COLOURS = ("material", "strain", "contact", "friction", BEAMS)


def listed(names: tuple[str, ...]) -> str:
    """Names as a text, such as ``material, strain or contact``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def check_colour_of_strip(colour: str) -> None:
    """Check that film strips have a colour: they lay faces side by side.

    Raises:
        ValueError: if they do not.
    """
    if colour == BEAMS:
        others = tuple(name for name in COLOURS if name != BEAMS)
        raise ValueError(f"colour: {BEAMS} is not allowed for a strip; give {listed(others)}")
