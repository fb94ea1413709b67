"""Notebooks as pages of Markdown: text as it stands, code in blocks. They have no outputs, and nothing runs."""

import json
from pathlib import Path


def notebook_page(path: Path) -> str:
    """The page of a notebook, which tells after its title how to run it."""
    cells = json.loads(path.read_text())["cells"]
    texts = [(cell["cell_type"], "".join(cell["source"]).strip()) for cell in cells]
    blocks = [text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in texts if text]
    title, _, rest = blocks[0].partition("\n")
    hint = (
        f"This page is the notebook [`notebooks/{path.name}`]({path.name}?download), without its outputs. To run it: "
        f"`pip install -c constraints.txt -e '.[notebook]' jupyterlab`, then `jupyter lab notebooks/{path.name}`."
    )
    return "\n\n".join([title, hint, rest.strip(), *blocks[1:]]) + "\n"
