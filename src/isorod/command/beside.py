"""Programs beside this package, in the checkout or installed with it, that a command becomes."""

import os
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import isorod

# Of the checkout, beside which this package lies in it.
CHECKOUT = Path(isorod.__file__).parents[2]


def is_there(package: str) -> bool:
    """Return whether there is a package of programs, in the checkout or installed."""
    return _inside(package) or find_spec(package) is not None


def become(package: str, words: Sequence[str]) -> NoReturn:
    """Become ``python -m PACKAGE WORDS``, whose exit code and answers to signals are then this program's."""
    around = dict(os.environ)
    if _inside(package):
        paths = [str(CHECKOUT / "src"), str(CHECKOUT), *filter(None, [around.get("PYTHONPATH")])]
        around["PYTHONPATH"] = os.pathsep.join(paths)
    # Nothing that lies in the folder where this is called is meant.
    around["PYTHONSAFEPATH"] = "1"
    sys.stdout.flush()
    os.execve(sys.executable, [sys.executable, "-m", package, *words], around)


def _inside(package: str) -> bool:
    return (CHECKOUT / package / "__main__.py").is_file()
