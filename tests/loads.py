"""The change of loads along a step, held against differences: for statics with contact, with pressures or without."""

import numpy as np


def assert_load_forces_are_differences(assembler):
    """Compare `Assembler.load_forces` at rest, half-way, with central differences of the residual."""
    x, out = assembler.vector(), assembler.vector()
    assembler.tangent(x, 0.5, assembler.matrix())
    assembler.load_forces(x, 0.5, 1e-4, out)
    sides = []
    for factor in (0.5 - 1e-4, 0.5 + 1e-4):
        side = assembler.vector()
        assembler.residual(x, factor, side)
        sides.append(side.array_r.copy())
    change = 0.5 * (sides[1] - sides[0])
    assert np.abs(change).max() > 1e-4
    np.testing.assert_allclose(out.array_r, change, atol=1e-6 * np.abs(change).max())
