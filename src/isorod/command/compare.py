"""``isorod compare``: the comparison with finite elements, a program of its own that this one becomes."""

import os
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import isorod
from isorod.errors import InputError

# What the comparison needs besides, and how to get it.
NEEDED = {
    "dolfinx": "Debian: apt install python3-dolfinx-real; elsewhere: pip install 'isorod[wheels]' or conda install -c "
    "conda-forge fenics-dolfinx",
    "pyvista": "pip install 'isorod[compare]'",
    "matplotlib": "pip install 'isorod[compare]'",
    "rich": "pip install 'isorod[compare]'",
}

# Of the checkout, beside which this package lies in it.
_CHECKOUT = Path(isorod.__file__).parents[2]


def main(arguments: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Become ``python -m comparisons compare ...``, whose exit code and answers to signals are then this program's.

    Raises
    ------
    InputError
        If something that it needs is not installed, with how to get it.
    """
    inside = (_CHECKOUT / "comparisons" / "__main__.py").is_file()
    if not inside and find_spec("comparisons") is None:
        raise InputError(
            "compare: the comparisons are not installed: pip install 'isorod[compare]', or run in a checkout"
        )
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        how = "; ".join(dict.fromkeys(NEEDED[name] for name in missing))
        raise InputError(f"compare: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed; {how}")
    around = dict(os.environ)
    if inside:
        paths = [str(_CHECKOUT / "src"), str(_CHECKOUT), *filter(None, [around.get("PYTHONPATH")])]
        around["PYTHONPATH"] = os.pathsep.join(paths)
    # Nothing that lies in the folder where this is called is meant.
    around["PYTHONSAFEPATH"] = "1"
    sys.stdout.flush()
    os.execve(sys.executable, [sys.executable, "-m", "comparisons", "compare", *arguments], around)
