"""Tangents beside the machine's product of large matrices: ``python -m comparisons.scaling.roofline``."""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from comparisons.measure import timing
from comparisons.scaling import wire
from isorod import options
from isorod.assembly.assembler import Assembler
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern
from isorod.output import results
from isorod.scenes.spring import Spring

# Spaces that are measured: the study's, and finer ones.
FAMILIES: dict[str, dict[str, int]] = {
    **{name: fields | {"degree": wire.DEGREE} for name, fields in wire.FAMILIES.items()},
    "order 2, 8 control points, degree 4": {"section_points": 8, "order": 2, "degree": 4},
    "order 2, 16 control points, degree 4": {"section_points": 16, "order": 2, "degree": 4},
}
COILS, REPEAT, SIZE = 20, 5, 1000


def operations(part: Part) -> int:
    """Return multiplications and additions in the products of matrices that one tangent takes.

    Across, each of the 45 moduli of a point meets each pair of section functions; along, six pairs of components have
    two sums over pairs of functions ``j <= m`` and nine have one over all.
    """
    elements, along, points = part.table.weights.shape
    functions, pairs = part.table.axial.shape[2], part.table.section.shape[2] ** 2
    both = 12 * (functions * (functions + 1) // 2) + 9 * functions**2
    return int(2 * elements * along * pairs * (45 * points + both))


def least(work: Callable[[], object]) -> float:
    """Return the least processor time of several runs, seconds."""
    return timing.least([work], REPEAT)[0]


def measure(name: str, fields: dict[str, int], peak: float) -> dict[str, Any]:
    """Return the record of one kind of functions; ``peak`` is that of the machine, operations a second."""
    own: Any = fields | {"continuity": fields["degree"] - 1}
    scene = Spring(
        helix="paper",
        coils=COILS,
        elements_per_turn=wire.ELEMENTS,
        quadrature="auto",
        formulation="displacement",
        **own,
    )
    assembler = Assembler(scene.model())
    (part,) = assembler.parts
    (blocks,) = Pattern([part.of_dofs], assembler.free).blocks
    entries, rest, total = (np.zeros(n) for n in (blocks.total, *(assembler.model.dofs,) * 2))
    unknowns = assembler.model.unknowns
    part.add_entries(rest, 1.0, blocks, entries)
    exact = least(lambda: part.add_entries(rest, 1.0, blocks, entries))
    part.extrapolate(True)
    part.add_entries(rest, 1.0, blocks, entries)
    extrapolated = least(lambda: part.add_entries(rest, 1.0, blocks, entries))
    forces = least(lambda: part.add_forces(rest, 1.0, total))
    rate = operations(part) / exact
    return {
        "family": name,
        "unknowns": unknowns,
        "points": int(part.table.weights.size),
        "tangent": exact / unknowns,
        "extrapolated": extrapolated / unknowns,
        "forces": forces / unknowns,
        "rate": rate,
        "dgemm": peak,
        "share": rate / peak,
    }


def main(_: Sequence[str]) -> int:
    """Measure all and print them."""
    options.initialize([])
    square = np.random.default_rng(0).standard_normal((SIZE, SIZE))
    peak = 2.0 * SIZE**3 / least(lambda: square @ square)
    print(results.line({"families": [measure(name, fields, peak) for name, fields in FAMILIES.items()]}))
    return 0


if __name__ == "__main__":
    from isorod.command import ending

    sys.exit(ending.run("comparisons.scaling.roofline", lambda: main(sys.argv[1:])))
