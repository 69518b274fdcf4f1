"""The line on which each key of a TOML text stands, which `tomllib` does not tell."""

import re
from collections.abc import Iterator

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
    for kind, word, line in _tokens(text):
        names = 0 if kind == "mark" else names + (1 if kind == "text" else len(word.replace(".", " ").split()))
        longest, at = max((longest, -at), (names, -line))
        at = -at
    return longest, at


def lines(text: str) -> dict[Path, int]:
    """Return the line, counted from 1, of each table and key of a valid TOML text, by what leads to it."""
    return _Scanner(text).found


class _Scanner:
    """Goes once through the tokens of a text."""

    def __init__(self, text: str) -> None:
        self.found: dict[Path, int] = {}
        self._tokens = _tokens(text)
        self._step()
        # How often each array of tables has been begun.
        self._begun: dict[Path, int] = {}
        table: Path = ()
        while self._kind:
            if self._word == "\n":
                self._step()
            elif self._kind == "mark" and self._word == "[":
                table = self._header()
            else:
                self._pair(table)

    def _step(self) -> str:
        word = getattr(self, "_word", "")
        self._kind, self._word, self._line = next(self._tokens, ("", "", 0))
        return word

    def _key(self) -> list[str]:
        """Take a key, dotted or not, up to the mark behind it."""
        parts = []
        while self._kind in ("bare", "text"):
            kind, word = self._kind, self._step()
            parts += [word[1:-1]] if kind == "text" else [part for part in word.split(".") if part]
        return parts

    def _note(self, path: Path, line: int) -> None:
        for end in range(1, len(path) + 1):
            self.found.setdefault(path[:end], line)

    def _header(self) -> Path:
        line = self._line
        opened = 0
        while self._word == "[":
            opened += 1
            self._step()
        keys = self._key()
        path: Path = ()
        for k, key in enumerate(keys):
            path += (key,)
            if k == len(keys) - 1 and opened == 2:
                self._begun[path] = self._begun.get(path, -1) + 1
            if path in self._begun:
                path += (self._begun[path],)
        while self._word == "]":
            self._step()
        self._note(path, line)
        return path

    def _pair(self, table: Path) -> None:
        line = self._line
        path = (*table, *self._key())
        self._note(path, line)
        # The equals sign.
        self._step()
        self._value(path)

    def _value(self, path: Path) -> None:
        if self._kind != "mark":
            # A date may have a space in it.
            while self._kind in ("bare", "text"):
                self._step()
            return
        ends = {"[": "]", "{": "}"}.get(self._step())
        place = 0
        while self._kind and self._word != ends:
            if self._kind == "mark" and self._word in ",\n":
                self._step()
            elif ends == "}":
                self._pair(path)
            else:
                self._note((*path, place), self._line)
                self._value((*path, place))
                place += 1
        self._step()


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    line, end = 1, 0
    for match in _TOKEN.finditer(text):
        line += text.count("\n", end, match.start())
        end = match.start()
        if match.lastgroup:
            yield match.lastgroup, match.group(), line
