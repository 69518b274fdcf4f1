"""The pages of docs/keys, made from the schema: ``python -m tests.files_page`` writes them anew."""

import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from isorod.files import schema
from isorod.files.form import ROD, Form

FOLDER = Path(__file__).parent.parent / "docs" / "keys"

# Pages by their files: what they are called, and with which of the titles below they begin.
PAGES = {
    "analyses": ("Analyses", "Analyses:"),
    "curves": ("Curves", "Curves:"),
    "sections": ("Sections", "Sections:"),
    "laws": ("Laws", "Laws:"),
    "rods": ("More of rods", "More keys of a rod"),
    "solids": ("Finite element bodies", "Finite element bodies:"),
    "supports": ("Supports", "Supports:"),
    "loads": ("Loads", "Loads:"),
    "contacts": ("Obstacles, contacts and ties", "Obstacles:"),
    "measures": ("Measures", "What is measured:"),
}

_HEAD = "| key | value | if not given | |\n|---|---|---|---|\n"

TITLES: dict[str, Mapping[str, Form]] = {
    'Analyses: `[analysis.WORD]`, or `analysis = "WORD"`': schema.ANALYSES,
    "Curves: `curve = {WORD ...}` of a rod": schema.CURVES,
    "Pieces of a chain: `curve = {chain = [{WORD ...}, ...]}`": schema.PIECES,
    "Sections: `section = {WORD ...}` of a rod": schema.SECTIONS,
    "Laws: `law = {WORD ...}` of a rod": schema.LAWS,
    "More keys of a rod": {"": schema.SWEEP, " ": schema.RINGS, "  ": schema.BODY, "   ": schema.THERMAL},
    "Trees: `tree = {...}` of a rod, in the place of a curve": {"": schema.TREE},
    "Copies of a rod: `copy = {...}`": {"": schema.COPIES},
    "The space of a rod: `space = {...}`": {"": schema.SPACE},
    "Finite element bodies: `[solid.NAME]`": {"": schema.SOLID},
    "What holds a solid: `held = {...}`, or several in a list": {"": schema.HELD},
    "What loads a solid: `load = {WORD ...}`, or several in a list": schema.SOLID_LOADS,
    "Supports: `[support.NAME]`": schema.SUPPORTS,
    "Loads: `[load.NAME]`": schema.LOADS,
    "Weight of all rods and solids: `[gravity]`": {"": schema.GRAVITY},
    "Rotation of the frame: `[spin]`": {"": schema.SPIN},
    "Obstacles: `[obstacle.NAME]`": schema.OBSTACLES,
    "How an obstacle moves: `motion = {...}`": {"": schema.MOTION},
    "Contacts: `[contact.NAME]`": {"": schema.CONTACTS},
    "Ties: `[tie.NAME]`": {"": schema.TIES},
    "What is measured: `[measure.NAME]`": schema.MEASURES,
}


def pages() -> dict[str, str]:
    """Return the pages by their files' names: a heading for each title and each word, and a table of its keys."""
    found: dict[str, list[str]] = {}
    begin = {first: name for name, (_, first) in PAGES.items()}
    for title, words in TITLES.items():
        for name in (name for first, name in begin.items() if title.startswith(first)):
            found[name] = [f"# {PAGES[name][0]}\n\n[Scenes from files](../files.md) says how these are read.\n"]
        parts = found[[*found][-1]]
        parts.append(f"## {title}\n")
        parts += [part for word, form in words.items() for part in _word(word.strip(), form)]
    # Of forms without a word all keys are in one table.
    return {f"{name}.md": "\n".join(parts).replace(f"|\n\n{_HEAD}", "|\n") for name, parts in found.items()}


def _word(word: str, form: Form) -> Iterator[str]:
    documentation = inspect.getdoc(form.function) or ""
    if word:
        first = " ".join(documentation.split("\n\n")[0].split())
        yield f"### `{word}`\n\n{_capital(first.removeprefix('Return '))}\n"
    told = _parameters(documentation)
    rows = []
    for key, one in form.parameters.items():
        main = " (main)" if word and key == form.principal else ""
        default = "needed" if one.required else f"`{_shown(one.default)}`" if one.default is not None else ""
        meant = told.get(one.name, "")
        if key in form.more:
            meant = "A word for people, beside the number." if one.kind is str else "`rotation`, as files had it once."
        if one.kind == ROD and not one.required:
            default, meant = "the only one", "What it acts on."
        rows.append(_row(f"`{key}`{main}", one.words, default, meant))
    if rows:
        yield _HEAD + "".join(rows)


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _parameters(documentation: str) -> dict[str, str]:
    """Return what a docstring says of each parameter."""
    found: dict[str, str] = {}
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n\w+\n-+\n|\Z)", documentation, re.DOTALL)
    names: list[str] = []
    for line in section[1].splitlines() if section else []:
        if line and not line.startswith(" "):
            names = line.split(", ")
        for name in names if line.startswith(" ") else ():
            found[name] = f"{found.get(name, '')} {line.strip()}".strip()
    return {name: re.sub(r"`{2}", "`", text) for name, text in found.items()}


def _shown(default: Any) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    return str(list(default)) if isinstance(default, tuple) else repr(default).replace("'", '"')


def _capital(text: str) -> str:
    return re.sub(r"`{2}", "`", text[:1].upper() + text[1:])


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text)
