"""XML without document types: those can make a small file endless."""

from xml.etree import ElementTree
from xml.parsers import expat

LARGEST = 50_000_000  # characters
DEEPEST = 200  # elements in each other: copies of trees and what else walks along them recurse


def parse_xml(text: str, field: str = "model") -> ElementTree.Element:
    """The root of an XML text.

    Args:
        text: of the file.
        field: what messages call it.

    Raises:
        ValueError: in one line, for a text that is too long or too deep, no XML, or has a document type (and so
            entities of its own); all of it is found before anything is built or expanded.
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
        return ElementTree.fromstring(text)
    except (expat.ExpatError, ElementTree.ParseError) as error:
        raise ValueError(f"{field}: this is no XML: {error}") from None
