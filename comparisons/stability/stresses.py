"""Stresses of bars a diameter off their ends, from files with nothing chosen: right to 1 %, or warned of.

``python -m comparisons.stability.stresses`` prints a line a bar, and how many came out how; words after it are what a
line's name has to hold (``fibred``, ``"tube 0.9"``).  Sections, laws, loads and lengths are those below.  Errors are
the largest difference of Cauchy's stress, by its Frobenius norm, over the largest stress, at places of the surface, of
the inner one, on both sides of an interface and in the middle, farther from ends than the section is wide.  Exact is a
finer space: of degree 6, with three times the elements and twice the degree across up to 8; where that would be no more
with twice the elements and, of round sections, two rings of degree 6; of rings one degree more and twice the elements.
Closed forms agree for the bars that have one (`tests/test_boundary_layers.py`).
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, cast

import numpy as np

from comparisons.measure.records import Record
from comparisons.stability.point import Sweep
from isorod import options, statics
from isorod.arrays import Array
from isorod.command.solving import LARGE_STRESS
from isorod.files.scene import FileScene
from isorod.geometry.quadrature import WHOLE
from isorod.output import held, results
from isorod.space import Space, choice
from isorod.space.polynomial import MAX_DEGREE

TITLE = "stresses of bars a diameter off their ends, nothing chosen"
COLUMNS = {"estimate": "estimated", "unknowns": "unknowns", "solve": "solution, s", "outcome": "outcome"}

# All have the largest half width 1.
SECTIONS = {
    "circle": "section = {circle = 1.0}",
    "ellipse": "section = {ellipse = {a = 1.0, b = 0.5}}",
    "airfoil": 'section = {naca = {digits = "2412", chord = 2.0}}',
    "tube 0.5": "section = {circle = 1.0}\nrings = [0.5, 1.0]",
    "tube 0.7": "section = {circle = 1.0}\nrings = [0.7, 1.0]",
    "tube 0.9": "section = {circle = 1.0}\nrings = [0.9, 1.0]",
    "layers": "section = {circle = 1.0}\nrings = [0.0, 0.6, 1.0]",
}
LENGTHS = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
LOADS = ("tension", "bending", "torsion", "pressure", "shear")

# The core of two layers is so many times as stiff.
STIFFER = 10.0
E, NU, STRAIN = 200.0, 0.3, 1e-7
G = E / (2.0 * (1.0 + NU))

TOLERANCE = 0.01
LARGE = 0.03
OUTCOMES = ("right", "warned of", "within 3 %", "wrong in silence")

# Sections looked at, and points round each.
_SECTIONS, _AROUND = 61, 15
# Section degree of two rings that are compared with the largest one of the whole section.
_RINGED = 6
# On the inner side of an interface.
_INSIDE = 1.0 - 1e-9


def _fibred(ratio: float, size: float) -> str:
    across = size * E / ratio
    return (
        f"{{TransverselyIsotropic = {{E = {size * E}, E_across = {across}, nu = {NU}, nu_across = {NU}, "
        f"G = {across / (2.0 * (1.0 + NU))}}}}}"
    )


def _holzapfel(size: float) -> str:
    return f"{{HolzapfelGasserOgden = {{c = {size}, k1 = {size * 10.0}, k2 = 1.0, bulk = {size * 10.0}}}}}"


LAWS: dict[str, Callable[[float], str]] = {
    "isotropic": lambda size: f"{{LinearElastic = {{E = {size * E}, nu = {NU}}}}}",
    "fibred 5": partial(_fibred, 5.0),
    "fibred 20": partial(_fibred, 20.0),
    "Holzapfel": _holzapfel,
}


@dataclass(frozen=True)
class Bar:
    """A bar of the study.

    Parameters
    ----------
    section, law, load
        Of `SECTIONS`, `LAWS` and `LOADS`.
    length
        Over the largest half width.
    """

    section: str
    law: str
    load: str
    length: float

    def __str__(self) -> str:
        return f"{self.section}, {self.law}, {self.load}, {self.length:g}"

    def text(self) -> str:
        """Return its scene file."""
        law = LAWS[self.law]
        laws = f"[{law(STIFFER)}, {law(1.0)}]" if self.section == "layers" else law(1.0)
        # A bending moment's circle has its end there.
        angle, aside = STRAIN * self.length, 0.5 * STRAIN * self.length**2
        head = {
            "tension": f"displacement = [0.0, 0.0, {angle}]",
            "bending": f"rotation = [{np.degrees(angle)}, 0.0, 0.0]\ndisplacement = [0.0, {-aside}, 0.0]",
            "torsion": f"rotation = [0.0, 0.0, {np.degrees(angle)}]",
            "shear": f"displacement = [0.0, {angle}, 0.0]",
        }
        surface = "inner" if self.section.startswith("tube") else "outer"
        end = (
            f'[load.around]\npressure = {STRAIN * E}\nsurface = "{surface}"'
            if self.load == "pressure"
            else f'[support.head]\nend = "end"\n{head[self.load]}'
        )
        rod = f"[rod.bar]\ncurve = {{straight = {self.length}}}\n{SECTIONS[self.section]}\nlaw = {laws}"
        return f'analysis = "statics"\n{rod}\n[support.foot]\nend = "start"\n{end}\n'


def every(level: str = "full") -> Iterator[Bar]:
    """Yield all bars; at level quick of one length."""
    for section in SECTIONS:
        for law in LAWS:
            for load in LOADS:
                for length in LENGTHS if level == "full" else LENGTHS[2:3]:
                    yield Bar(section, law, load, length)


def scene(bar: Bar, folder: Path) -> FileScene:
    """Write a bar's file and return the result of `isorod run`."""
    path = folder / "bar.toml"
    path.write_text(bar.text())
    return FileScene(str(path))


def places(model: Any) -> tuple[Array, Array]:
    """Return axis parameters ``(t,)`` and disk points ``(q, 2)`` at which stresses are compared."""
    rod = model.bodies[0].space.rod
    # Straight, from 0 to 1.
    length = float(np.ptp(rod.grid([[0.0, 0.0]], [0.0, 1.0])[0][..., 2]))
    off = held.width(model, 0) / length
    ring = _ring(_AROUND)
    sides = [radius * _INSIDE for radius in rod.rings[1:-1]]
    xi = [radius * (ring if radius else ring[:1]) for radius in (*rod.rings, *sides)]
    return np.linspace(off, 1.0 - off, _SECTIONS), np.concatenate(xi)


def finer(space: Space) -> Space:
    """Return the space that a chosen one is compared with."""
    axis, solid = space.axis, space.rod.rings == WHOLE
    degree = cast(int, space.section_degree)
    # Beyond the largest degree there are rings alone, of round sections.  Those have functions enough.
    rod = choice.with_rim(space.rod) if degree == MAX_DEGREE else space.rod
    ringed = solid and rod is not space.rod
    parts = 3 if solid and not ringed else 2
    elements = parts * cast(int, space.elements)
    even = space.rod.axis.refine(elements // space.rod.axis.elements, 6, 3).breaks
    fractions = np.arange(1, parts) / parts
    cut = (axis.breaks[:-1, None] + np.diff(axis.breaks)[:, None] * fractions).ravel()
    more = np.sort(np.concatenate([space.knots or (), cut]))
    apart = np.abs(more[:, None] - even).min(axis=1) > 1e-9 * np.ptp(axis.breaks)
    across = _RINGED if ringed else min(2 * degree, MAX_DEGREE) if solid else degree + 1
    return Space(rod, elements, 6, 3, section_degree=across, knots=tuple(map(float, more[apart])))


def off(values: Array, exact: Array) -> float:
    """Return the largest difference of stresses ``(t, q, 3, 3)`` over the largest stress."""
    size = np.linalg.norm(exact, axis=(2, 3)).max()
    return float(np.linalg.norm(values - exact, axis=(2, 3)).max() / size)


def compare(bar: Bar, folder: Path) -> dict[str, Any]:
    """Return the error of a bar's default space, its estimate and warnings, its size and processor time."""
    made = scene(bar, folder)
    start = process_time()
    solution = statics.solve(made.model())
    seconds = process_time() - start
    space = solution.model.bodies[0].space
    at = places(solution.model)
    error = off(solution.stress(0, *at), statics.solve(made.on([finer(space)]).model()).stress(0, *at))
    estimate = solution.errors().stress
    return {
        "error": error,
        "estimate": estimate,
        "unknowns": solution.model.unknowns,
        "solve": seconds,
        "outcome": outcome(error, estimate),
        "space": str(space),
    }


def outcome(error: float, estimate: float | None) -> str:
    """Return how a bar came out."""
    if error <= TOLERANCE:
        return OUTCOMES[0]
    if estimate is not None and estimate > LARGE_STRESS:
        return OUTCOMES[1]
    return OUTCOMES[2] if error <= LARGE else OUTCOMES[3]


def point(bar: Bar) -> dict[str, Any]:
    """Return the record of a bar."""
    with tempfile.TemporaryDirectory() as folder:
        sweep = Sweep(f"{bar.section}, {bar.load}: length over radius", "a finer space", TOLERANCE)
        return sweep.point(bar.length, partial(compare, bar, Path(folder)), bar=str(bar), series=bar.law)


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    yield from map(point, every(level))


def _ring(count: int) -> Array:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def LIMITS(records: list[Record]) -> list[str]:
    """Return how many bars came out how, and the worst of each section and law."""
    lines = []
    for section in SECTIONS:
        for law in LAWS:
            own = [one for one in records if one["bar"].startswith(f"{section}, {law}, ") and "error" in one]
            if not own:
                continue
            worst = max(own, key=lambda one: one["error"])
            counts = {name: sum(one["outcome"] == name for one in own) for name in OUTCOMES}
            text = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
            lines.append(
                f"{section}, {law}: {len(own)} bars, {text}; "
                f"the worst {100.0 * worst['error']:.2g} % ({worst['bar']}), {worst['unknowns']} unknowns."
            )
    return lines


def main(words: Sequence[str]) -> int:
    """Print the bars that have the words."""
    options.initialize([])
    records = []
    for bar in every():
        if {*words} <= {bar.section, bar.law, bar.load, f"{bar.length:g}"}:
            records.append(point(bar))
            print(results.line(records[-1]), flush=True)
    print("\n".join(LIMITS(records)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
