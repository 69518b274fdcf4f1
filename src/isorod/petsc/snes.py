"""SNES on equations that are evaluated in Python."""

from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from isorod.options import defaults

# PETSc counts a line search that fails as convergence where stol times the state exceeds the step, which from 3.25 on
# is zero where the residual is no number.
OPTIONS = {"snes_stol": 0.0}


def create_snes(
    vector: PETSc.Vec,
    matrix: PETSc.Mat,
    residual: Callable[[PETSc.Vec, PETSc.Vec], object],
    tangent: Callable[[PETSc.SNES, PETSc.Vec, PETSc.Mat], object],
    test: Callable[..., Any],
    options: Mapping[str, object],
) -> PETSc.SNES:
    """Return SNES on a residual and its tangent, with the user's options.

    Parameters
    ----------
    vector, matrix
        Storage of residual and tangent.
    residual
        ``residual(x, out)`` fills a vector.
    tangent
        ``tangent(snes, x, out)`` fills a matrix.
    test
        Convergence test as SNES takes it; PETSc's own stays where ``-snes_atol`` is typed.
    options
        Defaults, which the user's options override.
    """

    def jacobian(snes: PETSc.SNES, x: PETSc.Vec, product: PETSc.Mat, filled: PETSc.Mat) -> None:
        tangent(snes, x, filled)
        # With -snes_mf_operator they differ: one is used for products only.
        if product.handle != filled.handle:
            product.assemble()

    snes = PETSc.SNES().create(matrix.getComm())
    snes.setFunction(lambda snes, x, out: residual(x, out), vector)
    snes.setJacobian(jacobian, matrix)
    with defaults(OPTIONS | dict(options)):
        snes.setFromOptions()
    if not PETSc.Options().hasName("snes_atol"):
        snes.setConvergenceTest(test)
    return snes
