"""Ten rods of catalogues: files of at most 20 lines, run with nothing chosen, beside values from elsewhere.

``python -m comparisons.catalogue [NAME ...]`` runs them, all if none is named, computes the values beside them and
prints a table; that of the cable, of three wires in contact, is not computed but a stored one.
"""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from isorod import files

FOLDER = Path(files.__file__).parent / "examples" / "catalogue"


class Reference(NamedTuple):
    """A measure of a file, and a value independent of isorod; `by` is its source and accuracy."""

    name: str
    measure: str
    value: float
    by: str
    tolerance: float = 5e-3


# Stresses of meshes are known to 0.2 to 1.5 % by the mesh before.
_STRESS = 0.03
# Wires of a cable touch along lines far narrower than their control points, which are too stiff there, with a warning.
_PRESSED = 0.015
REFERENCES = (
    Reference("extension_spring", "pull", 0.144474, "Q3 bricks, 417,459 unknowns"),
    Reference("extension_spring", "stress", 8.367, "Q3 bricks, 417,459 unknowns", _STRESS),
    Reference("conical_spring", "rate", 2.324452, "Q3 bricks, 410,511 unknowns"),
    Reference("conical_spring", "stress", 13.798, "Q3 bricks, 410,511 unknowns", _STRESS),
    Reference("torsion_spring", "moment", 28.3948, "Q3 bricks, 222,915 unknowns"),
    Reference("torsion_spring", "stress", 41.3175, "Q3 bricks, 222,915 unknowns", _STRESS),
    Reference("wave_spring", "travel", -0.323797, "Q3 bricks, 129,150 unknowns"),
    Reference("clock_spring", "moment", 2.315821, "Q3 bricks, 522,921 unknowns"),
    Reference("clock_spring", "stress", 35.697, "Q3 bricks, 522,921 unknowns", _STRESS),
    Reference("s_hook", "opening", 0.544218, "Q2 bricks, limit of three meshes"),
    Reference("s_hook", "stress", 395.93, "Q2 bricks, limit of three meshes", _STRESS),
    Reference("stabiliser_bar", "drop", 21.2180, "Q2 bricks, limit of three meshes"),
    Reference("stabiliser_bar", "stress", 154.01, "Q2 bricks, limit of three meshes", _STRESS),
    Reference("coat_hanger", "sag", -0.432019, "Q3 bricks, 362,454 unknowns"),
    Reference("coat_hanger", "stress", 61.50, "Q3 bricks, 362,454 unknowns", _STRESS),
    Reference("paddle_shaft", "deflection", 0.522291, "Timoshenko's beam, exact"),
    Reference("paddle_shaft", "edge", -0.103826, "Timoshenko's beam and torsion, exact"),
    Reference("paddle_shaft", "stress", 50.87, "bending and torsion, exact", _STRESS),
    Reference("three_wire_cable", "pull-1", 560.70, "CalculiX, one wire, symmetry", _PRESSED),
    Reference("three_wire_cable", "torque-1", 154.17, "CalculiX, one wire, symmetry", _PRESSED),
    Reference("three_wire_cable", "stress-1", 160.46, "CalculiX, one wire, symmetry", _STRESS),
)


class Row(NamedTuple):
    """A reference's result: isorod's value, its relative error, seconds of the run, warnings."""

    reference: Reference
    value: float
    off: float
    seconds: float
    warnings: list[str]


def compare(names: Sequence[str] = ()) -> Iterator[Row]:
    """Yield the rows of files, each of which is run once by ``isorod run``."""
    for name in names or dict.fromkeys(one.name for one in REFERENCES):
        before = perf_counter()
        words = [sys.executable, "-m", "isorod", "run", str(FOLDER / f"{name}.toml"), "--json"]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        seconds = perf_counter() - before
        record = json.loads(done.stdout.splitlines()[-1])
        warned = [line for line in done.stderr.splitlines() if line.startswith("isorod: warning: ")]
        for one in REFERENCES:
            if one.name == name:
                value = record[one.measure]
                yield Row(one, value, value / one.value - 1.0, seconds, warned)
