"""A TOML file as read, and its places: errors name file, line and key."""

import difflib
import errno
import hashlib
import os
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from isorod.errors import InputError, SolveError
from isorod.files import lines

# What a scene's file has at its top; what may be there several times has names.
KEYS = (
    "title",
    "analysis",
    "rod",
    "solid",
    "support",
    "load",
    "gravity",
    "spin",
    "obstacle",
    "contact",
    "tie",
    "measure",
    "case",
    "step",
)

# A scene is written by hand; what is longer are data, which go beside it; and bytes of those at the most.
_LONGEST, _LARGEST = 1_000_000, 100_000_000

# Names in a dotted key, at most: no scene has more than six.
_DEEPEST = 20

# Folders in which data files may be besides that of the scene, as in PATH.
ALLOWED = "ISOROD_DATA"


class Document:
    """The content of a TOML file.

    Parameters
    ----------
    path
        The file, as the user names it.

    Attributes
    ----------
    content
        What `tomllib` makes of it.
    folder
        Where data files named in it are looked for.
    read
        Data files read so far, with the SHA-256 sum of each.

    Raises
    ------
    InputError
        If it cannot be read, is not UTF-8, too long, empty, or not TOML; with the line.
    """

    def __init__(self, path: str) -> None:
        self.name, self.folder = path, Path(path).parent
        self.read: dict[str, str] = {}
        text = _text(path)
        # `tomllib` takes the square of a key's names in memory.
        names, where = lines.longest_key(text)
        if names > _DEEPEST:
            raise InputError(f"{path}:{where}: a key of {names:,} names; at most {_DEEPEST}")
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except (ValueError, RecursionError) as problem:
            position = re.search(r"\(at line (\d+), column (\d+)\)", str(problem))
            reason = re.sub(r" \(at .*\)$", "", str(problem))
            column = f", column {position[2]}" if position else ""
            line = position[1] if position else text.rstrip().count("\n") + 1
            raise InputError(f"{path}:{line}: not TOML: {reason}{column}") from None
        if not self.content:
            raise InputError(f"{path}:1: empty file; 'isorod new' writes a scene to begin with")
        self._lines = lines.lines(text)

    @property
    def top(self) -> "Place":
        """The place of everything."""
        return Place(self, ())

    def moved(self, path: lines.Path, other: lines.Path) -> None:
        """Report what is at a path as standing where another is."""
        if other in self._lines:
            self._lines[path] = self._lines[other]

    def line(self, path: lines.Path) -> int:
        """Return the line of a key, or of the nearest thing that holds it."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)


class Place:
    """A place in a document: the path to a key, which need not exist."""

    def __init__(self, document: Document, path: lines.Path) -> None:
        self.document, self.path = document, path

    def __truediv__(self, key: str | int) -> "Place":
        return Place(self.document, (*self.path, key))

    def __str__(self) -> str:
        words = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.path)
        return words.removeprefix(".")

    def error(self, message: str) -> InputError:
        """Return an error at this place."""
        where = f"{self.document.name}:{self.document.line(self.path)}: "
        return InputError(where + (f"{self}: {message}" if self.path else message))

    def unknown(self, word: str, known: Collection[str]) -> InputError:
        """Return the error of a value here that is none of the words known, with the nearest of them."""
        return self.error(_unknown(word, known))

    def unknown_key(self, known: Collection[str]) -> InputError:
        """Return the error of this key, which is none of those known, with the nearest of them."""
        above, word = Place(self.document, self.path[:-1]), str(self.path[-1])
        text = _unknown(word, known)
        if above.path and word in KEYS:
            text = f"{word!r} is not known here; write it above the first [table], or as [{word}]"
        where = f"{self.document.name}:{self.document.line(self.path)}: "
        return InputError(where + (f"{above}: " if above.path else "") + text)

    def table(self, value: Any) -> dict[str, Any]:
        """Return a value that must be a table."""
        if not isinstance(value, dict):
            raise self.error(f"got {shown(value)}, need a table {{...}}")
        return value

    def data(self, name: str) -> bytes:
        """Return the content of a file beside the scene's or below, and note its sum.

        A scene may come from somebody else: it reads nothing that is not lying with it, unless the user allows folders
        (`ALLOWED`).

        Raises
        ------
        InputError
            If there is no such file, it is elsewhere, no plain file, or too large.
        """
        folder, content = self.document.folder, None
        try:
            path = (folder / name).resolve(strict=True)
            allowed = [folder, *(Path(one) for one in os.environ.get(ALLOWED, "").split(os.pathsep) if one)]
            near, plain = any(path.is_relative_to(one.resolve()) for one in allowed), path.is_file()
            if near and plain:
                with path.open("rb") as file:
                    content = file.read(_LARGEST + 1)
        except (OSError, ValueError, RuntimeError) as problem:
            raise self.error(f"{name}: cannot be read ({getattr(problem, 'strerror', None) or problem})") from None
        if content is None:
            what = (
                "is no plain file" if near else f"is neither beside the scene nor below; {ALLOWED}=FOLDER allows others"
            )
            raise self.error(f"{name}: {what}")
        if len(content) > _LARGEST:
            raise self.error(f"{name}: longer than {_LARGEST:,} bytes")
        self.document.read[name] = hashlib.sha256(content).hexdigest()
        return content

    @contextmanager
    def locating(self, keys: "Mapping[str, Place] | None" = None) -> Iterator[None]:
        """Turn errors raised within into errors of this place, or of the key that the message names."""
        try:
            yield
        except (InputError, SolveError, ValueError, TypeError) as problem:
            text = str(problem)
            if text.startswith(f"{self.document.name}:"):
                raise
            kind = SolveError if isinstance(problem, SolveError) else InputError
            raise kind(self.about(text, keys or {})) from None

    def about(self, message: str, keys: "Mapping[str, Place]") -> str:
        """Return an error's message at the key that it names, or else at this place."""
        head, _, rest = message.partition("got ")
        # A key of one letter may be a word of a sentence.
        for text, shortest in ((head, 1), (rest, 2)):
            for key, at in keys.items():
                if len(key) >= shortest and re.search(rf"\b{key.replace('_', '[_ ]')}\b", text):
                    return str(at.error(re.sub(rf"^{key.replace('_', '[_ ]')}: ", "", message)))
        return str(self.error(message))


def shown(value: Any) -> str:
    """Return a value of TOML in short."""
    if isinstance(value, dict):
        return "a table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return "a list" if isinstance(value, list) and len(text) > 40 else f"{text:.40}"


def _nearest(word: str, known: Collection[str]) -> str | None:
    """Return the known word that a word was meant to be: letters in another case, or a few of them wrong."""
    plain = {one.lower().replace("_", ""): one for one in known}
    near = difflib.get_close_matches(word.lower().replace("_", "").replace("-", ""), plain, 1)
    return plain[near[0]] if near else None


def _unknown(word: str, known: Collection[str]) -> str:
    near = _nearest(word, known)
    hint = f"did you mean {near}?" if near else f"known: {', '.join(known) or 'none'}"
    return f"{word!r} is not known; {hint}"


def _text(path: str) -> str:
    """Return the text of a scene's file; raises `InputError`."""
    try:
        # A pipe that nobody writes to would be waited for.
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError(errno.EINVAL, "it is no plain file")
        with open(path, "rb") as file:
            content = file.read(_LONGEST + 1)
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{path}: cannot be read ({reason}); 'isorod new' writes a scene to begin with") from None
    if len(content) > _LONGEST:
        raise InputError(f"{path}: longer than {_LONGEST:,} bytes; arrays go into files beside it")
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        raise InputError(f"{path}:{line}: byte {content[problem.start]:#04x} is not UTF-8; save it as UTF-8") from None


def as_json(value: Any) -> Any:
    """Return a value of TOML as JSON takes it: a stiffness without bound is a word."""
    if isinstance(value, dict):
        return {key: as_json(one) for key, one in value.items()}
    if isinstance(value, list):
        return [as_json(one) for one in value]
    return "inf" if value == float("inf") else value
