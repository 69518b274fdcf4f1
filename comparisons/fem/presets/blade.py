"""Configurations of the blade worth a name, as arguments of ``python -m comparisons.fem blade``.

Found by a search over elements (Lagrange bricks of degree 1 to 4, serendipity, 8 nodes with incompatible modes,
tetrahedra of degree 1 to 3), 2 to 12 cells along the chord and 1 to 3 across it, 3 to 48 layers, gradings, quadrature
rules, compiler flags and solvers.  What it showed:

- The blade is thin: one cell across is enough down to 0.1 %, and isoparametric cells cope with the blunt trailing edge,
  where serendipity cells (10 % off) and geometry of higher order than the displacement (50 % off) do not.
- Cubic bricks on 27 Gauss points come within 0.4 % with 2,280 unknowns, but stiffness and mass are then singular, and
an inertia
  count does not confirm the modes: not used.  Quadratic bricks on Irons' 14 points keep their rank.
- Shift-and-invert with MUMPS' Cholesky beats PETSc's, CHOLMOD, UMFPACK and SuperLU.  To a tolerance of 1e-6, LOBPCG
takes 500 times
  as long with GAMG or BoomerAMG, and conjugate gradients with GAMG inside shift-and-invert 1000 times: the blade is
  slender and its cells are flat.
"""

from comparisons.fem.presets.family import blades

_Q2 = "--degree 2 --quadrature irons14"
_P = "--cells tetrahedra --degree"

PRESETS = {
    # The fastest within 0.5 % that stays within when section or axis is refined further.
    "best": f"{_Q2} --along 4 --layers 20",
    # Within 0.1 %.
    "accurate": "--degree 3 --along 5 --layers 16 --grading 1.25",
    "best-q3": "--degree 3 --along 3 --layers 9 --grading 1.25",
    "best-q4": "--degree 4 --along 3 --layers 5",
    "best-tetrahedra": f"{_P} 3 --along 8 --layers 16",
    # A mesh of the paper's counts.
    "paper-q1": "--cells paper --degree 1",
    "paper-q2": "--cells paper --degree 2",
    "paper-enhanced": "--cells paper --degree 1 --family enhanced",
}

# The elements on a mesh of the paper's counts, by name; enhanced strain was the paper's.
PAPER = {
    "8 nodes, trilinear": PRESETS["paper-q1"],
    "8 nodes, enhanced strain": PRESETS["paper-enhanced"],
    "27 nodes": PRESETS["paper-q2"],
}

# One step finer along the axis, and one in the section.
FINER = (("--layers", 4), ("--along", 2))


FULL = (
    blades("Q2 bricks, 14 points", _Q2, (4, 1, 12), (4, 1, 16), (4, 1, 18), (4, 1, 20), (6, 1, 24), (8, 1, 28)),
    blades(
        "Q3 bricks", "--degree 3", (3, 1, 6), (3, 1, 9), (4, 1, 12), (5, 1, 16), (6, 1, 20), (8, 2, 20), grading=1.25
    ),
    blades("Q3 bricks, graded", "--degree 3", (5, 1, 14), (6, 1, 20), (6, 2, 16), (5, 2, 20), (6, 2, 20), grading=1.5),
    blades("Q4 bricks", "--degree 4", (2, 1, 4), (3, 1, 5), (4, 1, 8)),
    blades("Q2 bricks", "--degree 2", (4, 1, 16), (6, 1, 24), (8, 2, 32), (12, 2, 48)),
    blades("Q1 bricks", "--degree 1", (8, 1, 32), (16, 2, 64), (24, 4, 128)),
    blades("enhanced bricks", "--degree 1 --family enhanced", (6, 1, 20), (8, 1, 32), (12, 2, 48)),
    blades("P2 tetrahedra", f"{_P} 2", (4, 1, 16), (8, 2, 32), (12, 2, 48)),
    blades("P3 tetrahedra", f"{_P} 3", (4, 1, 10), (6, 1, 12), (8, 1, 16)),
)
# What was fastest within each error at full level.  Every level measures those of its targets, so that a quick answer
# is not better for us than the full one.
BEST = {
    1e-2: (f"{_Q2} --along 4 --across 1 --layers 18",),
    5e-3: (f"{_Q2} --along 4 --across 1 --layers 20",),
    3e-3: (f"{_Q2} --along 6 --across 1 --layers 24",),
    1e-3: ("--degree 3 --along 5 --across 1 --layers 16 --grading 1.25",),
    5e-4: tuple(f"--degree 3 --along {along} --across 2 --layers 20 --grading 1.5" for along in (5, 6)),
}
QUICK = (
    blades("Q2 bricks, 14 points", _Q2, (4, 1, 16), (4, 1, 18), (4, 1, 20), (6, 1, 24)),
    blades("Q3 bricks", "--degree 3", (3, 1, 6), (3, 1, 9), (4, 1, 12), grading=1.25),
    blades("P2 tetrahedra", f"{_P} 2", (4, 1, 16), (8, 2, 32)),
)

# Uniform refinement of one element for Richardson's extrapolation; the grading is for the singular clamped edge.
CONVERGED = {
    "quick": blades("Q2 bricks", "--degree 2", (8, 2, 24), (12, 3, 36), (16, 4, 48), grading=1.5),
    "full": blades("Q3 bricks", "--degree 3", (8, 2, 16), (12, 3, 24), (16, 4, 32), grading=1.5),
}
