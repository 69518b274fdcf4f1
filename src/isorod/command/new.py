"""``isorod new``: a scene file to begin with."""

import os
import tomllib
from pathlib import Path

from isorod import files
from isorod.errors import InputError
from isorod.output.results import refusal

_FOLDER = Path(files.__file__).parent / "examples"

STARTER = "starter"

EXAMPLES = tuple(sorted(file.stem for file in _FOLDER.glob("*.toml")))


def told() -> dict[str, tuple[str, str]]:
    """Return the analysis and the title of each example."""
    result = {}
    for name in EXAMPLES:
        content = tomllib.loads((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
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
    copies = {path: _FOLDER / f"{origin}.toml"}
    copies |= {path.parent / file.name: file for file in _FOLDER.glob(f"{origin}.*") if file.suffix != ".toml"}
    there = next((one for one in copies if os.path.lexists(one)), None)
    if there is not None:
        raise InputError(f"{there}: is there already, and is not overwritten; name another")
    written: list[Path] = []
    try:
        for one, file in copies.items():
            with open(one, "xb") as handle:
                written.append(one)
                handle.write(file.read_bytes())
    except OSError as problem:
        for one in written:
            one.unlink()
        raise refusal(f"{path}: cannot be written", problem) from None
    print(f"{' and '.join(map(str, copies))} written; now: isorod run {path}")
    return 0
