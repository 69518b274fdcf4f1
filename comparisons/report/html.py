"""Pieces of the report page."""

import html
from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[object]], text: Sequence[int] = (0,)) -> str:
    """Return a table; the columns ``text`` are set left, the others are numbers."""

    def cells(tag: str, values: Sequence[object]) -> str:
        return "".join(
            f"<{tag}{' class=text' if k in text else ''}>{html.escape(str(value))}</{tag}>"
            for k, value in enumerate(values)
        )

    lines = [f"<tr>{cells('td', row)}</tr>" for row in rows]
    return f"<div class=wide><table><tr>{cells('th', head)}</tr>\n" + "\n".join(lines) + "\n</table></div>"


def percent(value: float) -> str:
    """Return a share in percent, two digits."""
    return f"{100 * value:.2g} %"


def milliseconds(value: float) -> str:
    """Return seconds in milliseconds."""
    return f"{1e3 * value:.1f}" if value < 0.1 else f"{1e3 * value:.0f}"
