"""Laws in the words of Abaqus and CalculiX: ``*ELASTIC``, ``*HYPERELASTIC``, and notes on what these cannot express."""

import numpy as np

from isorod.errors import InputError
from isorod.material.law import Isotropic, Material, plane_waves
from isorod.material.neo_hookean import NeoHookean
from isorod.material.ogden import Ogden
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff

# An incompressible law gets a bulk modulus of so many shear moduli: nu = 0.4995.
STIFF = 1000.0

# Coefficients C10, C01, C20 ... of a polynomial of so many powers of I1bar - 3 and I2bar - 3.
_MOST = 3

# Numbers in a line of constants.
_IN_LINE = 8

# Moduli of a law whose directions differ by less are those of an isotropic one.
_ROUNDING = 1e-6

_ADVICE = (
    "LinearElastic, StVenantKirchhoff, NeoHookean, MooneyRivlin, Yeoh, Ogden and energies that are polynomials of "
    "I1bar - 3 and I2bar - 3, up to the third power, are written"
)


def elastic(law: Material) -> tuple[list[str], str]:
    """Return the lines of a law at rest, or of one linear in Green's strain, and a note; `InputError` if none.

    Young's modulus and Poisson's ratio of laws that do not have these follow from the moduli of plane waves.
    """
    if law.families:
        raise refused(law)
    if isinstance(law, Isotropic) and law.nu < 0.5:
        return ["*ELASTIC", f"{law.E:.12g},{law.nu:.12g}"], ""
    waves = plane_waves(law if np.isfinite(law.lame) else law.shear)
    if np.ptp(waves, axis=0).max() > _ROUNDING * waves.max():
        raise refused(law)
    (mu, bulk), note = _moduli(law)
    young, poisson = 9.0 * bulk * mu / (3.0 * bulk + mu), 0.5 * (3.0 * bulk - 2.0 * mu) / (3.0 * bulk + mu)
    return ["*ELASTIC", f"{young:.12g},{poisson:.12g}"], note


def _moduli(law: Material) -> tuple[tuple[float, float], str]:
    """Return shear and bulk modulus at rest, a finite one in the place of an infinite one, and a note on that."""
    if np.isfinite(law.lame):
        waves = plane_waves(law)
        return (waves.min(), waves.max() - 4.0 / 3.0 * waves.min()), ""
    mu = law.shear_modulus
    return (mu, STIFF * mu), f"incompressible, and written with a bulk modulus of {STIFF:g} shear moduli"


def finite(law: Material) -> tuple[list[str], str]:
    """Return the lines of a law for large displacements, and how it differs from the file's own; `InputError` if none.

    The law of St. Venant and Kirchhoff is what CalculiX makes of ``*ELASTIC``.  Others store ``(J - 1)^2`` for a change
    of volume and not ``(ln J)^2``; so does the neo-Hookean law, and takes its invariant free of volume.
    """
    if law.families:
        raise refused(law)
    if isinstance(law, StVenantKirchhoff):
        return elastic(law)[0], "in Abaqus *ELASTIC is linear in logarithmic strain: the same where strains are small"
    (_, bulk), note = _moduli(law)
    factor = f"{2.0 / bulk:.12g}"
    if isinstance(law, NeoHookean):
        # Under uniaxial stress 0.27 of the strain at nu = 0.3, 0.09 at 0.45.
        near = "" if note else "stresses differ from the file's law by less than a third of the strain, 0.3 % at 1 %"
        return ["*HYPERELASTIC,NEO HOOKE", f"{0.5 * law.mu:.12g},{factor}"], note or near
    if isinstance(law, Ogden):
        terms = [one for m, a in zip(law.mu, law.alpha, strict=True) for one in (0.5 * m * a, a)]
        if len(law.mu) > _MOST:
            raise refused(law)
        return _constants(f"OGDEN,N={len(law.mu)}", terms, factor, len(law.mu)), note or _VOLUME
    coefficients = _polynomial(law)
    powers = max(i + j for i, j in coefficients)
    order = [(n - j, j) for n in range(1, powers + 1) for j in range(n + 1)]
    return _constants(
        f"POLYNOMIAL,N={powers}", [coefficients.get(one, 0.0) for one in order], factor, powers
    ), note or _VOLUME


_VOLUME = "a change of volume J stores bulk/2 (J - 1)^2 in it, and bulk/2 (ln J)^2 by the file"


def _constants(kind: str, terms: list[float], factor: str, count: int) -> list[str]:
    words = [f"{one:.12g}" for one in terms] + [factor] + ["0."] * (count - 1)
    return [f"*HYPERELASTIC,{kind}", *(",".join(words[k : k + _IN_LINE]) for k in range(0, len(words), _IN_LINE))]


def _polynomial(law: Material) -> dict[tuple[int, int], float]:
    """Return the coefficients of a law's energy in powers of ``I1bar - 3`` and ``I2bar - 3``; `InputError` if none."""
    import sympy as sp

    from isorod.material import symbols as s

    stored, x, y = law.stored, sp.Symbol("x"), sp.Symbol("y")
    if stored.small or not stored.quadratic:
        raise refused(law)
    values = dict(zip(stored.constants, law.constants, strict=True))
    # The invariants free of volume are expressions of the others.
    free = stored.shape.subs({s.I1: (x + 3) * s.J ** sp.Rational(2, 3), s.I2: (y + 3) * s.J ** sp.Rational(4, 3)})
    free = sp.expand(sp.powdenest(sp.simplify(free.subs(values)), force=True))
    if not free.is_polynomial(x, y) or free.free_symbols - {x, y}:
        raise refused(law)
    terms = {powers: float(one) for powers, one in sp.Poly(free, x, y).terms() if sum(powers)}
    if not terms or max(sum(powers) for powers in terms) > _MOST:
        raise refused(law)
    return terms


def refused(law: Material) -> InputError:
    """Return the error of a law that has no counterpart."""
    return InputError(f"law {type(law).__name__} has no counterpart in input files of Abaqus and CalculiX; {_ADVICE}")
