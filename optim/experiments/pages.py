"""Pages of Markdown: paragraphs and tables, and numbers in them."""

from collections.abc import Sequence

MISSING = "–"


def page(*parts: str | Sequence[str]) -> str:
    """Join paragraphs, and tables given by their lines; empty ones are left out."""
    texts = (part if isinstance(part, str) else "\n".join(part) for part in parts)
    return "\n\n".join(text for text in texts if text) + "\n"


def cell(value: float | None, form: str = ".4f", missing: str = MISSING) -> str:
    """Format a number of a table; ``missing`` for None."""
    return missing if value is None else format(value, form)
