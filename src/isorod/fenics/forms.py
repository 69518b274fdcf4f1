"""The forms of a body: from a law's stored energy, or a user's residual split into internal and external work."""

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
        The load factor, a dolfinx Constant, which scales activation.
    degree
        Degree of quadrature.

    Raises
    ------
    InputError
        If the law is incompressible, or its fibres follow a rod.
    """
    constants, dx = _given(law, unknown.function_space.mesh, factor), _measure(unknown, degree)
    F = ufl.Identity(3) + ufl.grad(unknown)
    energy = stored.density(law.stored.expression, F, *constants) * dx
    residual = ufl.derivative(energy, unknown, ufl.TestFunction(unknown.function_space))
    return energy, residual if law.linear else residual + _refusal(F, unknown, dx)


def between(law: Material, start: Any, unknown: Any, place: Any, factor: Any, degree: int) -> Any:
    """Return the virtual work of a stress between two states, a UFL form.

    Averaged over ``t`` from 0 to 1 it is that of the mean value discrete gradient of rods
    (`isorod.material.discrete_gradient_kernel`), ``F_m S(C_0 + t (C_1 - C_0))``, whose work is the change of energy.

    Parameters
    ----------
    law
        A frame-invariant law.
    start, unknown
        Displacements of both states, dolfinx Functions.
    place
        The parameter ``t``, a dolfinx Constant.
    factor, degree
        As for `of_law`.

    Raises
    ------
    InputError
        As for `of_law`.
    """
    constants, dx = _given(law, unknown.function_space.mesh, factor), _measure(unknown, degree)
    before, after = (ufl.Identity(3) + ufl.grad(displacement) for displacement in (start, unknown))
    C = before.T * before
    C = ufl.variable(C + place * (after.T * after - C))
    slope = ufl.diff(stored.density_of(law.stored.expression, C, *constants), C)
    stress = 0.5 * (before + after) * (slope + slope.T)
    test = ufl.TestFunction(unknown.function_space)
    return ufl.inner(stress, ufl.grad(test)) * dx + _refusal(after, unknown, dx)


def _measure(unknown: Any, degree: int) -> Any:
    return ufl.dx(domain=unknown.function_space.mesh, metadata={"quadrature_degree": degree})


def _given(law: Material, mesh: Any, factor: Any) -> tuple[dict[Any, Any], tuple[Any, ...]]:
    """Return the values of a law's constants, and its fibres."""
    if law.follows:
        raise InputError("law: its fibres follow a rod; on a finite element body give them as a vector")
    # Constants, not numbers, so that code is compiled once for all values.
    constants = [dolfinx.fem.Constant(mesh, value) for value in stored.constants_of(law)]
    fibres = tuple(dolfinx.fem.Constant(mesh, value) for value in law.fibres(()).reshape(-1, 3))
    return dict(zip(law.stored.constants, constants, strict=True)) | {symbols.activation: factor}, fibres


def _refusal(F: Any, unknown: Any, dx: Any) -> Any:
    """Return a form that is zero, and NaN where ``det F <= 0``.

    A stress without a logarithm, as with nu = 0, is finite there.
    """
    zero = dolfinx.fem.Constant(unknown.function_space.mesh, 0.0)
    return zero * ufl.ln(ufl.det(F)) * ufl.div(ufl.TestFunction(unknown.function_space)) * dx


def split(form: Any, unknown: Any) -> tuple[Any, Any]:
    """Return a residual less its value at rest, and minus that value: internal forces, and loads.

    At load factor 1 they add up to the given residual, at 0 rest is an equilibrium; between these they are exact for
    loads that do not follow the body.

    Raises
    ------
    InputError
        If the form does not contain the unknown.
    """
    if unknown not in extract_coefficients(form):
        raise InputError("form of the solid: its unknown does not stand in it")
    at_rest = ufl.replace(form, {unknown: dolfinx.fem.Function(unknown.function_space)})
    return form - at_rest, -at_rest
