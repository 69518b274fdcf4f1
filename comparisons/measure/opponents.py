"""Which programs are here to be compared with, and why the others are not."""

import shutil
from collections.abc import Callable
from importlib import util

HOW = "docker/opponents installs it"


def here() -> tuple[list[str], dict[str, str]]:
    """Return the opponents beside dolfinx that are installed (keys of `comparisons.measure.work.MODULES`).

    And of each other one what is missing.
    """
    asked: dict[str, tuple[Callable[[], object], str]] = {
        "ngsolve": (lambda: util.find_spec("ngsolve"), f"this Python has no ngsolve; {HOW}"),
        "calculix": (lambda: shutil.which("ccx"), f"there is no program ccx; {HOW}"),
    }
    found = [name for name, (look, _) in asked.items() if look() is not None]
    return found, {name: missing for name, (_, missing) in asked.items() if name not in found}
