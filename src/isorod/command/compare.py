"""``isorod compare``: the comparison with finite elements, by a program of its own that this one becomes."""

from collections.abc import Sequence
from importlib.util import find_spec

from isorod.command import beside, pages
from isorod.command.parser import Parser
from isorod.errors import InputError

# What the comparison needs besides, and how to get it.
NEEDED = {
    "dolfinx": "Debian: apt install python3-dolfinx-real; elsewhere: pip install 'isorod[wheels]' or conda install -c "
    "conda-forge fenics-dolfinx",
    "pyvista": "pip install 'isorod[compare]'",
    "matplotlib": "pip install 'isorod[compare]'",
    "rich": "pip install 'isorod[compare]'",
}


def main(arguments: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Become ``python -m comparisons compare ...``.

    Raises
    ------
    InputError
        If an option is not known, or something that it needs is not installed, with how to get it.
    """
    if not arguments or {"-h", "--help"} & {*arguments}:
        print(pages.page("compare"))
        return 0
    parser = Parser(prog="isorod compare", allow_abbrev=False)
    parser.add_argument("scene")
    parser.add_argument("--level", choices=("quick", "full"))
    parser.add_argument("--results")
    parser.add_argument("--ranks", type=int)
    parser.known(arguments)
    if not beside.is_there("comparisons"):
        raise InputError(
            "compare: the comparisons are not installed: pip install 'isorod[compare]', or run in a checkout"
        )
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        how = "; ".join(dict.fromkeys(NEEDED[name] for name in missing))
        raise InputError(f"compare: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed; {how}")
    return beside.become("comparisons", ["compare", *arguments])
