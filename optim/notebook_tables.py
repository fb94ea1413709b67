"""Tables of results in notebooks: as HTML, and as data frames of pandas."""

import html
from collections.abc import Iterable, Mapping
from typing import Any

from optim.wording import cell_value

MOST_ROWS = 12  # of a table in a notebook


def html_table(columns: Mapping[str, Any], units: Mapping[str, str], rows: Iterable[int]) -> str:
    """Write some rows of columns of values as HTML, with the units of those that have one."""
    titles = (f"{name} [{units[name]}]" if units.get(name) else name for name in columns)
    head = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
    cells = ("".join(f"<td>{html.escape(cell_value(values[n]))}</td>" for values in columns.values()) for n in rows)
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


def data_frame(columns: Mapping[str, Any], units: Mapping[str, str]) -> Any:
    """Make a pandas DataFrame of columns, whose ``attrs["units"]`` tells units by column.

    Raises:
        ValueError: if pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise ValueError("to_dataframe: pandas is not installed; pip install pandas") from None
    table = pandas.DataFrame(dict(columns))
    table.attrs["units"] = dict(units)
    return table
