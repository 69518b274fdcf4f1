"""``isorod new``: a scene file to begin with."""

import os
import tomllib
from pathlib import Path

from isorod import files
from isorod.errors import InputError
from isorod.output.results import refusal

_FOLDER = Path(files.__file__).parent / "examples"

STARTER = "starter"

# By name: those of the gallery, and in folders rods of catalogues and of the page on contact.
_FILES = {file.stem: file for pattern in ("*.toml", "*/*.toml") for file in sorted(_FOLDER.glob(pattern))}

GALLERY = tuple(name for name, file in _FILES.items() if file.parent == _FOLDER)

EXAMPLES = tuple(_FILES)


def listed() -> dict[str, tuple[str, str]]:
    """Return the analysis and the title of each example."""
    result = {}
    for name, file in _FILES.items():
        content = tomllib.loads(file.read_text(encoding="utf-8"))
        analysis = content["analysis"]
        result[name] = analysis if isinstance(analysis, str) else next(iter(analysis)), content.get("title", "")
    return result


def main(name: str, origin: str) -> int:
    """Write the example called ``origin`` to a file, and the data that it reads beside it; overwrite nothing.

    Raises
    ------
    InputError
        If there is no such example, the name does not end in ``.toml``, or a file is there or cannot be written.
    """
    if origin not in EXAMPLES:
        raise InputError(f"example {origin!r} is not known; there are: {', '.join(EXAMPLES)}")
    path = Path(name)
    if path.suffix != ".toml" or path.stem.startswith("-"):
        raise InputError(f"{name}: need a name that ends in .toml")
    copies = {path: _FILES[origin]}
    beside = _FILES[origin].parent.glob(f"{origin}.*")
    copies |= {path.parent / file.name: file for file in beside if file.suffix != ".toml"}
    there = next((copy for copy in copies if os.path.lexists(copy)), None)
    if there is not None:
        raise InputError(f"{there}: is there already, and is not overwritten; name another")
    written: list[Path] = []
    try:
        for copy, file in copies.items():
            with open(copy, "xb") as handle:
                written.append(copy)
                handle.write(file.read_bytes())
    except OSError as problem:
        for copy in written:
            copy.unlink()
        raise refusal(f"{path}: cannot be written", problem) from None
    print(f"{' and '.join(map(str, copies))} written; now: isorod run {path}")
    return 0
