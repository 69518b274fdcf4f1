"""Scenes written down in TOML files: what ``isorod run my.toml`` reads.

A choice - of a curve, a section, a law - is a table with one word of a list (`isorod.files.schema`), and the word is
the name of the function or class of this package that is called.  Its parameters are the keys, its docstring the
documentation: what is new there shows up here by one line in that list.
"""

from typing import Any

from isorod import scenes


def find(name: str) -> Any:
    """Return the scene of a file, whose name ends in ``.toml``, or the ready one of that name, as it is by default.

    Raises
    ------
    InputError
        If there is none, or the file cannot be used: with line and place.
    """
    if not name.endswith(".toml"):
        return scenes.find(name)()
    from isorod.files.scene import FileScene

    return FileScene(name)
