"""The report page is built of sections with parts, and tables of columns; the same tables in Markdown."""

import html
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

_HEADING = re.compile(r"<h([23]) id=([\w-]+)>(.*?)</h\1>", re.DOTALL)


def section(name: str, about: str, parts: Mapping[str, str | Sequence[str]], prefix: str | None = None) -> list[str]:
    """Return a section: its heading, an introduction, and its parts, the HTML of each by its title.

    Titles follow the name of the section, or a ``prefix`` in its place.
    """
    lines = [heading(2, name), about]
    for title, body in parts.items():
        lines += [heading(3, f"{prefix or name}: {title}"), *([body] if isinstance(body, str) else body)]
    return lines


def columns(
    rows: Iterable[Any], shown: Mapping[str, Callable[[Any], object]]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows of a table: ``shown`` maps headings to functions of a row; None is left out."""
    values = ([of(row) for of in shown.values()] for row in rows)
    return tuple(shown), [tuple("" if one is None else str(one) for one in row) for row in values]


def table(head: Sequence[str], rows: Iterable[Sequence[object]], text: Sequence[int] = (0,)) -> str:
    """Return a table that scrolls in a box of its own where it is too wide.

    The columns ``text`` are set left, the others are numbers; the first column stays in sight.  A value may have
    several lines.
    """

    def cells(tag: str, values: Sequence[object]) -> str:
        return "".join(
            f"<{tag}{' class=text' if k in text else ''}>{html.escape(str(value)).replace(chr(10), '<br>')}</{tag}>"
            for k, value in enumerate(values)
        )

    lines = [f"<tr>{cells('td', row)}</tr>" for row in rows]
    return (
        f"<div class=wide tabindex=0><table><thead><tr>{cells('th', head)}</tr></thead>\n"
        + "\n".join(lines)
        + "\n</table></div>"
    )


def plain(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table of text."""
    lines = [head, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(head))]
    return ["  ".join(text.ljust(wide) for text, wide in zip(line, widths, strict=True)).rstrip() for line in lines]


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, without a line break at its end."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows))


def heading(level: int, text: str) -> str:
    """Return a heading of level 2 (a scene) or 3 (a part of it) that the table of contents leads to."""
    identity = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
    return f"<h{level} id={identity}>{html.escape(text)}</h{level}>"


def contents(body: str) -> str:
    """Return the table of contents: each `heading` of the body, parts below their scene and without its name."""
    scenes: list[list[str]] = []
    for level, identity, text in _HEADING.findall(body):
        if level == "2":
            scenes.append([f'<a href="#{identity}"><strong>{text}</strong></a>'])
        else:
            scenes[-1].append(f'<a href="#{identity}">{text.partition(": ")[2] or text}</a>')
    blocks = ("<ul>" + "".join(f"<li>{link}</li>" for link in links) + "</ul>" for links in scenes)
    return '<nav aria-label="Contents">' + "\n".join(blocks) + "</nav>"


def figure(file: str, alt: str, caption: str, fits: bool = False) -> str:
    """Return a picture with a caption.

    On narrow screens it scrolls in a box of its own, or ``fits`` them, shrunk.
    """
    image = f'<img src="{file}" alt="{html.escape(alt)}">'
    shown = image if fits else f"<div class=wide>{image}</div>"
    return f"<figure>{shown}<figcaption>{caption}</figcaption></figure>"


def fold(summary: str, *lines: str) -> str:
    """Return lines that a click unfolds."""
    return f"<details><summary>{html.escape(summary)}</summary>\n" + "\n".join(lines) + "\n</details>"


def commands(lines: Iterable[str]) -> str:
    """Return commands to type, each once."""
    return "<pre>" + html.escape("\n".join(dict.fromkeys(lines))) + "</pre>"


def percent(value: float) -> str:
    """Return a fraction in percent, two digits."""
    return f"{100 * value:.2g} %"


def milliseconds(value: float) -> str:
    """Return seconds in milliseconds."""
    return f"{1e3 * value:.1f}" if value < 0.1 else f"{1e3 * value:,.0f}"
