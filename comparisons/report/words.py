"""Explanations for readers of the page."""

import html
from collections.abc import Iterable

from comparisons import STUDIES
from isorod.space.basis import FAMILIES, PAPER, POLYHARMONIC, POLYNOMIALS

TITLE = "Rods as solids of few unknowns, beside finite elements"

# Features of isorod, and those that were run.
_FAMILIES = (
    f"across a section it has three families of functions. <em>{PAPER.capitalize()}</em>, the cylindrical element of "
    'J. Lu and X. Zhou (2011, <a href="https://doi.org/10.1016/j.cma.2010.08.007">doi</a>), has harmonic functions of '
    f"control points on the surface; <em>{POLYHARMONIC}</em> ones extend it to orders of 2 and more; and "
    f"<em>{POLYNOMIALS}</em> of the section's coordinates, which know no control points, are what is chosen for most "
    "rods without contact. Which of them ran stands beside each result."
)

INTRODUCTION = (
    "<p>A spring's wire, a blade, a muscle with its tendons: a rod is a solid that is long and slender. Finite "
    "elements fill it with thousands of small bricks or tetrahedra. <code>isorod</code> computes the same solid, with "
    f"all its stresses, from functions of a section times splines along an axis; {_FAMILIES}</p>"
    "<p>Each scene below is solved both ways, by isorod and by <code>dolfinx</code> (FEniCSx), a widely used finite "
    "element library, on the same geometry and machine, with one thread. The finite elements are the fastest that a "
    "search over elements, meshes, quadrature rules and solvers found, not a straw man. What is compared is the run "
    "time that each takes to come within an error of the converged three-dimensional solution, and, beside it, the "
    "numbers that the paper printed.</p>"
)

COMPARED = (
    "<p>Each scene below is solved both ways, by <code>isorod</code>, and by <code>dolfinx</code> (FEniCSx), a widely "
    "used finite element library, with bricks that are curved with the same rods, or, of rods that are tied, with "
    "tetrahedra of all as one solid; on the same machine, with one thread a rank. What is compared is how far each is "
    "from what the finite elements converge to, and the run time that it takes. isorod's elements are functions of a "
    "section times splines along an axis; "
    f"{_FAMILIES}</p>"
)

# Of those below, what pages about scenes of anyone's have.
_OF_COMPARED = (
    "error",
    "run time",
    "check",
    "unknowns",
    *FAMILIES,
    "n",
    "K",
    "N",
    "p",
    "C0 to C3",
    "2x1x2",
    "Q1 to Q4, S2 to S4",
    "P1 to P3",
)

MEANINGS = {
    "error": "Distance from the converged solution, relative. That solution is extrapolated from dolfinx on three "
    "meshes, each finer than the last; where only two were solved it is that of the finer one.",
    "run time": "Set-up + assembly + solve + check of one solution, in a process that has solved it before: the median "
    "of five. Import, compilation and, for dolfinx, mesh generation are left out.",
    "check": "What proves a result and is part of its run time: of modes a Sturm count, one more factorisation, which "
    "shows that none of the lowest frequencies was missed; of few quadrature points, that no motion escaped them.",
    "unknowns": "Displacement components of all control points, or nodes, those held by supports included.",
    PAPER: "Harmonic functions of n control points round a section (K = 1); curves that are called paper have its "
    "degree, continuity and quadrature rule as well.",
    POLYHARMONIC: "Functions of n control points round a section of order K = 2 and more, which bending and twisting "
    "of thick and thin sections need.",
    POLYNOMIALS: "Polynomials of degree N in a section's coordinates, where all sections have one shape; no control "
    "points.",
    "n": "Control points round a section.",
    "K": f"Order of the functions of control points across a section: {PAPER} has K = 1, {POLYHARMONIC} ones more.",
    "N": "Degree of the polynomials across a section. Thin directions take half of it.",
    "p": "Degree of the B-splines along the axis.",
    "C0 to C3": "How many derivatives are continuous from one element of the axis to the next; p - 1 if not said, 0 in "
    "the paper's spring.",
    "elements a turn": "Elements along the axis of the spring, in each of its turns.",
    "2x1x2": "Quadrature rule R x S x T: R points along the radius and S round it in each of n slices of the section, "
    "T along an element.",
    "Q1 to Q4, S2 to S4": "Bricks of degree 1 to 4 in dolfinx, curved with the rod: Q with all inner nodes, S "
    "(serendipity) with few of them. Q1 has 8 nodes, Q2 has 27, S2 has 20.",
    "P1 to P3": "Tetrahedra of degree 1 to 3.",
    "enhanced": "Bricks of 8 nodes with nine more modes of strain in each, which bend well: the paper's own finite "
    "elements. dolfinx cannot remove those modes cell by cell, so their run times are not what they could be.",
    "14 points": "Irons' quadrature rule, half the points of Gauss's.",
    "quasi-Newton, CG + GAMG": "Other solvers of PETSc than the default, Newton with a direct factorisation: fewer "
    "tangents for more iterations; conjugate gradients with algebraic multigrid.",
    "layers, around, along, across, grading": "Cells of a finite element mesh along the axis, round the wire, along "
    "the blade's chord and through its thickness; a grading above 1 makes layers thinner towards the root.",
}


# Said otherwise there.
_IN_COMPARED = {
    "run time": "Set-up + assembly + solve + check of one solution, in a process that has solved it before: the median "
    "of four, of fewer on the second mesh; the largest meshes are solved once. Import, compilation and, for dolfinx, "
    "mesh generation are left out.",
}


def introduction(studies: Iterable[str]) -> str:
    """Return the introduction of a page with these studies."""
    return INTRODUCTION if set(STUDIES) & set(studies) else COMPARED


def words(studies: Iterable[str]) -> str:
    """Return the list of letters and words of a page that has these studies."""
    meanings = MEANINGS
    if not set(STUDIES) & set(studies):
        meanings = {word: (MEANINGS | _IN_COMPARED)[word] for word in _OF_COMPARED}
    items = [f"<dt>{html.escape(word)}</dt><dd>{html.escape(text)}</dd>" for word, text in meanings.items()]
    return "<dl>" + "\n".join(items) + "</dl>"
