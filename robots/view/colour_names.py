"""Names of the colourings in which views show robots. Imports nothing heavy, so that commands can list them."""

BEAMS = "beams"  # shows links and pressure in place of faces
COLOURS = ("material", "strain", "contact", "friction", "channel", BEAMS)


def listed(names: tuple[str, ...]) -> str:
    """Join names to a text such as ``material, strain or contact``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def check_colour_of_strip(colour: str) -> None:
    """Check that film strips support a colouring; they draw faces, not beams.

    Raises:
        ValueError: if they do not support it.
    """
    if colour == BEAMS:
        others = tuple(name for name in COLOURS if name != BEAMS)
        raise ValueError(f"colour: {BEAMS} is not allowed for a strip; give {listed(others)}")
