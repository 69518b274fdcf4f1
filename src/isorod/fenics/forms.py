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
    given, dx = _given(law, unknown.function_space.mesh, factor), _measure(unknown, degree)
    F = ufl.Identity(3) + ufl.grad(unknown)
    energy = stored.density(law.stored.expression, F, *given) * dx
    residual = ufl.derivative(energy, unknown, ufl.TestFunction(unknown.function_space))
    return energy, residual if law.linear else residual + _refusal(F, unknown, dx)


def between(law: Material, start: Any, unknown: Any, place: Any, factor: Any, degree: int) -> Any:
    """Return the virtual work of a stress between two states, a UFL form.

    Averaged over the places from 0 to 1 it is that of the mean value discrete gradient of rods
    (`isorod.material.discrete_gradient_kernel`), ``F_m S(C_0 + t (C_1 - C_0))``: it does the work of the energy.

    Parameters
    ----------
    law
        A law whose energy knows no rotation.
    start, unknown
        Displacements of both states, dolfinx Functions.
    place
        The place ``t`` on the way, a dolfinx Constant.
    factor, degree
        As for `of_law`.

    Raises
    ------
    InputError
        As for `of_law`.
    """
    given, dx = _given(law, unknown.function_space.mesh, factor), _measure(unknown, degree)
    before, after = (ufl.Identity(3) + ufl.grad(one) for one in (start, unknown))
    C = before.T * before
    C = ufl.variable(C + place * (after.T * after - C))
    slope = ufl.diff(stored.density_of(law.stored.expression, C, *given), C)
    stress = 0.5 * (before + after) * (slope + slope.T)
    test = ufl.TestFunction(unknown.function_space)
    return ufl.inner(stress, ufl.grad(test)) * dx + _refusal(after, unknown, dx)


def _measure(unknown: Any, degree: int) -> Any:
    return ufl.dx(domain=unknown.function_space.mesh, metadata={"quadrature_degree": degree})


def _given(law: Material, mesh: Any, factor: Any) -> tuple[dict[Any, Any], tuple[Any, ...]]:
    """Return the values of a law's constants, and its fibres."""
    if law.follows:
        raise InputError("law: its fibres follow a rod; on a finite element body give them as a vector")
    # No numbers: code is compiled once for all values.
    given = [dolfinx.fem.Constant(mesh, one) for one in stored.constants_of(law)]
    fibres = tuple(dolfinx.fem.Constant(mesh, one) for one in law.fibres(()).reshape(-1, 3))
    return dict(zip(law.stored.constants, given, strict=True)) | {symbols.activation: factor}, fibres


def _refusal(F: Any, unknown: Any, dx: Any) -> Any:
    """Return a form that is zero, and NaN where there is no volume.

    A stress without a logarithm, as where nu = 0, has a value there.
    """
    nothing = dolfinx.fem.Constant(unknown.function_space.mesh, 0.0)
    return nothing * ufl.ln(ufl.det(F)) * ufl.div(ufl.TestFunction(unknown.function_space)) * dx


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
