"""Configurations of spring and blade for NGSolve, chosen as those of `comparisons.fem.presets` were.

Blocks of three components, NGSolve's own Cholesky factors (`comparisons.ngsolve.space`, `statics`, `modal`), and
elements without inner functions (``hollow``) where they cost more than they give: cubic bricks of the blade.  Irons'
points leave the quadratic ones of the blade so soft inside that Cholesky factors lose digits; one refinement brings
them back.
"""

from comparisons.fem.presets.family import blades, wires

_S2 = "--family S --degree 2 --quadrature irons14"
_S3 = "--family S --degree 3 --quadrature 5"
_S4 = "--family S --degree 4 --quadrature 6"
_Q2 = "--degree 2 --quadrature irons14 --refinements 1"
_H3 = "--family hollow --degree 3"
_H4 = "--family hollow --degree 4"


SPRING = {
    "quick": (
        wires("S2 bricks", _S2, (4, 24), (8, 48), (12, 48), (12, 60)),
        wires("S3 bricks", _S3, (4, 12), (4, 24), (8, 24)),
        wires("S4 bricks", _S4, (4, 24), (8, 24)),
    ),
    "full": (
        wires("S2 bricks", _S2, (4, 24), (8, 48), (12, 48), (12, 60), (16, 84)),
        wires("S3 bricks", _S3, (4, 12), (4, 24), (8, 24), (12, 24), (16, 36)),
        wires("S4 bricks", _S4, (4, 12), (4, 24), (8, 24), (12, 36)),
        wires("Q2 bricks", "--degree 2", (4, 24), (8, 48), (12, 60)),
        wires("Q3 bricks", "--degree 3", (4, 12), (8, 24), (12, 24)),
        wires("P2 tetrahedra", "--cells tetrahedra --degree 2", (8, 48), (12, 60)),
    ),
}
BLADE = {
    "quick": (
        blades("Q2 bricks, 14 points", _Q2, (4, 1, 16), (4, 1, 18), (4, 1, 20), (6, 1, 24)),
        blades("hollow Q3 bricks", _H3, (3, 1, 6), (3, 1, 9), (4, 1, 12), (5, 1, 16), grading=1.25),
        blades("hollow Q3 bricks, graded", _H3, (6, 1, 20), (5, 2, 20), (6, 2, 20), grading=1.5),
    ),
    "full": (
        blades("Q2 bricks, 14 points", _Q2, (4, 1, 12), (4, 1, 16), (4, 1, 18), (4, 1, 20), (6, 1, 24), (8, 1, 28)),
        blades("hollow Q3 bricks", _H3, (3, 1, 6), (3, 1, 9), (4, 1, 12), (5, 1, 16), (6, 1, 20), grading=1.25),
        blades(
            "hollow Q3 bricks, graded", _H3, (5, 1, 14), (6, 1, 20), (5, 2, 20), (6, 2, 16), (6, 2, 20), grading=1.5
        ),
        blades("hollow Q4 bricks", _H4, (3, 1, 5), (4, 1, 8), (5, 1, 12), grading=1.5),
        blades("Q3 bricks", "--degree 3", (3, 1, 9), (5, 1, 16), grading=1.25),
        blades("P2 tetrahedra", "--cells tetrahedra --degree 2", (4, 1, 16), (8, 2, 32)),
    ),
}
