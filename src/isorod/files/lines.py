"""The line on which each key of a TOML text stands, which `tomllib` does not report."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

# Where a key stands: the names of tables and keys, and the places in arrays, that lead to it.
Path = tuple[str | int, ...]

_TOKEN = re.compile(
    r"""(?P<text>\"{3}(?:\\.|[^\\])*?\"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
    r"""|(?P<mark>[][{}=,\n])|(?P<bare>[^\s\[\]{}=,#"']+)|\#[^\n]*""",
    re.DOTALL,
)


def longest_key(text: str) -> tuple[int, int]:
    """Return how many names a key of a text has at most, dotted ones together, and the line of the longest."""
    longest, names, at = 0, 0, 1
    for kind, word, line, _ in _tokens(text):
        names = 0 if kind == "mark" else names + (1 if kind == "text" else len(word.replace(".", " ").split()))
        longest, at = max((longest, -at), (names, -line))
        at = -at
    return longest, at


def places(text: str) -> dict[Path, tuple[int, int]]:
    """Return where in a valid TOML text each value that is no text, list or table begins and ends."""
    spans: dict[Path, tuple[int, int]] = {}
    lines(text, spans)
    return spans


def lines(text: str, spans: dict[Path, tuple[int, int]] | None = None) -> dict[Path, int]:
    """Return the line, counted from 1, of each table and key of a valid TOML text, by what leads to it.

    ``spans`` is filled with what `places` returns.
    """
    numbers: dict[Path, int] = {}
    spans = {} if spans is None else spans
    begun: dict[Path, int] = {}
    key: list[str] = []
    start, brackets = 0, 0
    frames = [_Frame(())]
    for kind, word, line, span in _tokens(text):
        frame = frames[-1]
        if frame.entry is not None:
            # An array, whose entries are between commas.
            if word == "]":
                frames.pop()
            elif word == ",":
                frame.entry += 1
            elif word != "\n":
                _note(numbers, entry := (*frame.path, frame.entry), line)
                frames += _opened(entry, word)
                spans |= {entry: span} if kind == "bare" else {}
        elif frame.value is not None:
            frames += _opened(frame.value, word)
            spans |= {frame.value: span} if kind == "bare" else {}
            if word in (",", "\n"):
                frame.value = None
            elif word == "}":
                frames.pop()
        elif kind != "mark":
            start = start if key else line
            key += [word[1:-1]] if kind == "text" else [part for part in word.split(".") if part]
        elif word == "=":
            frame.value = (*frame.path, *key)
            _note(numbers, frame.value, start)
            key = []
        elif word == "}":
            frames.pop()
        elif word == "]" and key:
            frame.path = _header(key, brackets == 2, begun)
            _note(numbers, frame.path, start)
            key = []
        elif word in ("[", "\n"):
            brackets = brackets + 1 if word == "[" else 0
    return numbers


@dataclass
class _Frame:
    """A table, or an array with the number of its entry, that is open; in a table the key whose value is read."""

    path: Path
    entry: int | None = None
    value: Path | None = None


def _opened(path: Path, word: str) -> list[_Frame]:
    return [_Frame(path, 0 if word == "[" else None)] if word in ("[", "{") else []


def _note(numbers: dict[Path, int], path: Path, line: int) -> None:
    for end in range(1, len(path) + 1):
        numbers.setdefault(path[:end], line)


def _header(keys: list[str], several: bool, begun: dict[Path, int]) -> Path:
    """Return the path of a table's header; ``begun`` counts the tables of each array of tables."""
    path: Path = ()
    for k, key in enumerate(keys):
        path += (key,)
        if several and k == len(keys) - 1:
            begun[path] = begun.get(path, -1) + 1
        if path in begun:
            path += (begun[path],)
    return path


def _tokens(text: str) -> Iterator[tuple[str, str, int, tuple[int, int]]]:
    line, end = 1, 0
    for match in _TOKEN.finditer(text):
        line += text.count("\n", end, match.start())
        end = match.start()
        if match.lastgroup:
            yield match.lastgroup, match.group(), line, match.span()
