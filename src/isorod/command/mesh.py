"""``isorod mesh``: finite elements of a scene's rods in a file, by a program of its own that this one becomes."""

from collections.abc import Sequence

from isorod.command import beside
from isorod.errors import InputError


def main(arguments: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Become ``python -m meshes ...``; raise `InputError` if that is not installed."""
    if not beside.is_there("meshes"):
        raise InputError("mesh: the meshes are not installed: pip install isorod has them, and a checkout")
    return beside.become("meshes", arguments)
