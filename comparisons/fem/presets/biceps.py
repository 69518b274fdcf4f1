"""Configurations of the biceps worth a name, as arguments of ``python -m comparisons.fem biceps``.

At the equilibrium the end forces of 27-node bricks with 8, 12 and 16 round a branch differ by 0.04 %, their bulges by
0.3 %, their contact forces by 0.5 %; linear tetrahedra, as many as the paper has, hold with 2.3 % too much.  Area (2.7
to 3.5 cm^2) and depth (0.010 to 0.013 cm) of contact are not converged on these meshes.
"""

from comparisons.fem.presets.family import Family

_Q2 = "--cells bricks --degree 2"

PRESETS = {
    # As many tetrahedra as the paper's mesh has (25,315), on linear functions as explicit codes have them.
    "paper": "--analysis dynamics --degree 1 --size 0.3325",
    # The same mesh with quadratic functions, which do not lock.
    "paper-quadratic": "--degree 2 --size 0.3325",
    "bricks": f"{_Q2} --around 12 --layers 6",
}

# Uniform refinement of one element, coarse to fine; the study takes the first ones, and the last takes minutes.
CONVERGED = Family(
    "Q2 bricks",
    _Q2,
    tuple(f"--around {around} --layers {layers}" for around, layers in ((4, 2), (8, 4), (12, 6), (16, 8))),
)
