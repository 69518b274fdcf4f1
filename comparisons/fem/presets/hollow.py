"""Configurations of rods with a hole or in layers, as arguments of ``python -m comparisons.fem rods FILE``.

Cells: one across a wall, two where that is better; Q2 and Q3 bricks, since the mesh's own nodes are the unknowns there.
Found by a search over 6 to 48 cells round the section, 3 to 60 along the rod and 1 to 2 across each ring.
"""

from comparisons.fem.presets.family import families

_family = families("around", "across", "layers")
_Q2, _Q3 = "--degree 2", "--degree 3"


# Of the spring of tube, and of that of core and sheath.
WIRE = (
    _family("Q2 bricks", _Q2, (8, 1, 36), (8, 1, 48), (12, 1, 60), (12, 1, 84)),
    _family("Q3 bricks", _Q3, (8, 1, 12), (6, 1, 24), (8, 1, 24), (12, 1, 36)),
)
WIRE_CONVERGED = _family("Q3 bricks", _Q3, (8, 1, 24), (12, 1, 36), (16, 1, 48))

# Of the hollow blade.
BLADE = (
    _family("Q2 bricks", _Q2, (32, 1, 8), (32, 2, 8), (48, 2, 8)),
    _family("Q3 bricks", _Q3, (16, 1, 4), (16, 1, 6), (20, 1, 5), (24, 1, 6), (20, 2, 6), (24, 2, 6)),
)
BLADE_CONVERGED = _family("Q3 bricks", _Q3, (16, 2, 8), (24, 2, 12), (32, 2, 16))
