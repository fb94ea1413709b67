"""Parse XML without document types, which could make a small file expand without end."""

from xml.etree import ElementTree
from xml.parsers import expat

from taichi_sim.base.parsing import DEEPEST

LARGEST = 50_000_000  # characters


def parse_xml(text: str, field: str = "model", comments: bool = False) -> ElementTree.Element:
    """Parse an XML text and return its root.

    Args:
        text: the content of a file.
        field: its name in messages.
        comments: whether comments within the root are kept, as elements whose tags are functions.

    Raises:
        ValueError: if the text is too long, too deep, no XML, or has a document type; nothing is expanded before.
    """

    def refuse(*_: object) -> None:
        raise ValueError(f"{field}: a document type is not allowed; give plain XML")

    level = 0

    def deeper(*_: object) -> None:
        nonlocal level
        level += 1
        if level > DEEPEST:
            raise ValueError(f"{field}: more than {DEEPEST} elements in each other are not allowed")

    def higher(*_: object) -> None:
        nonlocal level
        level -= 1

    if len(text) > LARGEST:
        raise ValueError(f"{field}: {len(text)} characters are not allowed; give at most {LARGEST}")
    try:
        checker = expat.ParserCreate()
        checker.StartDoctypeDeclHandler = refuse
        checker.StartElementHandler, checker.EndElementHandler = deeper, higher
        checker.Parse(text, True)
        builder = ElementTree.TreeBuilder(insert_comments=comments)
        return ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))
    except (expat.ExpatError, ElementTree.ParseError) as error:
        raise ValueError(f"{field}: this is no XML: {error}") from None
