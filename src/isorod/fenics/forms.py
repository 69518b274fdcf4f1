"""The forms of a body: of a law's stored energy, or of a user's residual, split into inner and outer work."""

from typing import Any

import dolfinx.fem
import ufl
from ufl.algorithms import extract_coefficients

from isorod.errors import InputError
from isorod.fenics import stored
from isorod.material import symbols
from isorod.material.law import Material


def of_law(law: Material, unknown: Any, factor: Any, degree: int) -> tuple[Any, Any]:
    """Return the stored energy of a body and its first variation, UFL forms.

    Parameters
    ----------
    law
        The law.
    unknown
        The displacement, a dolfinx Function.
    factor
        The load factor, a dolfinx Constant, which activation grows with.
    degree
        Of quadrature.

    Raises
    ------
    InputError
        If the law is incompressible, or its fibres follow a rod.
    """
    if law.follows:
        raise InputError("law: its fibres follow a rod; on a finite element body give them as a vector")
    mesh = unknown.function_space.mesh
    # No numbers: code is compiled once for all values.
    given = [dolfinx.fem.Constant(mesh, one) for one in stored.constants_of(law)]
    fibres = tuple(dolfinx.fem.Constant(mesh, one) for one in law.fibres(()).reshape(-1, 3))
    values = dict(zip(law.stored.constants, given, strict=True)) | {symbols.activation: factor}
    F = ufl.Identity(3) + ufl.grad(unknown)
    dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": degree})
    energy = stored.density(law.stored.expression, F, values, fibres) * dx
    test = ufl.TestFunction(unknown.function_space)
    residual = ufl.derivative(energy, unknown, test)
    if not law.linear:
        # Else stress without a logarithm, as where nu = 0, has a value where there is no volume.
        nothing = dolfinx.fem.Constant(mesh, 0.0)
        residual += nothing * ufl.ln(ufl.det(F)) * ufl.div(test) * dx
    return energy, residual


def split(form: Any, unknown: Any) -> tuple[Any, Any]:
    """Return a residual less its value at rest, and minus that value: inner forces, and loads.

    At load factor 1 they are the residual as it was given, at 0 rest is an equilibrium; what is in between is right of
    loads that do not follow the body.

    Raises
    ------
    InputError
        If the unknown does not stand in it.
    """
    if unknown not in extract_coefficients(form):
        raise InputError("form of the solid: its unknown does not stand in it")
    at_rest = ufl.replace(form, {unknown: dolfinx.fem.Function(unknown.function_space)})
    return form - at_rest, -at_rest
