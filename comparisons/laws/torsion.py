"""Universal torsion and extension of a solid cylinder: every incompressible law against one-dimensional quadrature.

``python -m comparisons.laws.torsion`` prints, for each law, torque and axial force, how far a rod in the mixed
formulation is from them, and the orders at which Newton's method converged.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from comparisons.measure.convergence import newton_orders
from isorod import statics
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.law import Material
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.ogden import Ogden
from isorod.material.yeoh import Yeoh
from isorod.model import Body, Model, Support
from isorod.space import Space
from meshes.mesh import Array

# Twist per reference length of a cylinder of radius 1.
TAU = 0.5
# Stretches along the axis.
STRETCHES = (1.0, 1.3)
# Step of differentiation in the complex plane.
_STEP = 1e-30

# Ogden's constants of Treloar's rubber, MPa; a carotid artery's of Holzapfel, Gasser and Ogden, kPa.
TRELOAR = ((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0))
ARTERY = (3.0, 2.3632, 0.8393)

Stored = Callable[[Any, Any, Any, Any], Any]


class Case(NamedTuple):
    """A law, and its stored energy, written independently: ``stored(I1, I2, I4, stretches)``."""

    law: Material
    stored: Stored


def _ogden(I1: Any, I2: Any, I4: Any, stretches: Any) -> Any:
    return sum(m / a * sum(one**a for one in stretches) for m, a in zip(*TRELOAR, strict=True))


def _artery(I1: Any, I2: Any, I4: Any, stretches: Any) -> Any:
    c, k1, k2 = ARTERY
    return c / 2 * I1 + k1 / (2 * k2) * np.exp(k2 * (I4 - 1) ** 2)


CASES = {
    "NeoHookean": Case(NeoHookean(3.0, 0.5), lambda I1, I2, I4, own: 0.5 * I1),
    "MooneyRivlin": Case(MooneyRivlin(0.3, 0.2, math.inf), lambda I1, I2, I4, own: 0.3 * I1 + 0.2 * I2),
    "Yeoh": Case(
        Yeoh(0.5, -0.1, 0.03, math.inf),
        lambda I1, I2, I4, own: 0.5 * I1 - 0.1 * (I1 - 3) ** 2 + 0.03 * (I1 - 3) ** 3,
    ),
    "Gent": Case(Gent(1.0, 10.0, math.inf), lambda I1, I2, I4, own: -5.0 * np.log(1 - (I1 - 3) / 10)),
    "Ogden": Case(Ogden(*TRELOAR, math.inf), _ogden),
    "HolzapfelGasserOgden": Case(HolzapfelGasserOgden(*ARTERY, math.inf), _artery),
}


def taken(stored: Stored, stretch: float = 1.0) -> tuple[float, float]:
    """Return torque and axial force of the cylinder of radius 1 of any incompressible law.

    Of what is stored per reference length these are the derivatives by ``tau``, the twist per reference length, and by
    the stretch: the deformation ``r = R/sqrt(stretch), theta = Theta + tau Z, z = stretch Z`` is one of all such laws,
    isotropic or with fibres along the axis, and keeps the volume, so that no pressure does work.
    """
    nodes, weights = np.polynomial.legendre.leggauss(60)
    R = 0.5 * (1.0 + nodes)

    def per_length(stretch: complex, tau: complex) -> Any:
        shear = (R * tau) ** 2 / stretch
        I1, I4 = 2.0 / stretch + stretch**2 + shear, stretch**2 + shear
        # det C = 1: the second invariant is the trace of the inverse.
        I2 = 1.0 / stretch**2 + 2.0 * stretch + (R * tau / stretch) ** 2
        half = 0.5 * (I1 - 1.0 / stretch)
        root = np.sqrt(half**2 - stretch)
        stretches = stretch**-0.5 + 0.0 * R, np.sqrt(half + root), np.sqrt(half - root)
        return np.sum(np.pi * weights * R * stored(I1, I2, I4, stretches))

    along, across = per_length(stretch, TAU + _STEP * 1j), per_length(stretch + _STEP * 1j, TAU)
    return float(along.imag / _STEP), float(across.imag / _STEP)


def twisted(law: Material, stretch: float = 1.0, **options: Any) -> statics.Equilibrium:
    """Return the solution of a rod of length and radius 1 whose end sections are turned, drawn in and pulled so."""
    chosen: dict[str, Any] = {"elements": 2, "degree": 5, "section_degree": 4, "quadrature": "full"} | options
    where = Space.paper(straight(1.0).sweep(circle(8)), **chosen)
    supports = []
    for which, turned in (("start", 0.0), ("end", TAU)):
        nodes = Support.end(where, which).nodes
        at = where.positions[nodes]
        supports.append(Support(nodes, "xyz", _moved(at, turned, stretch) - at, space=where))
    return statics.solve(Model([Body(where, law, formulation="mixed")], supports))


def _moved(at: Array, turned: float, stretch: float) -> Array:
    c, s = np.cos(turned), np.sin(turned)
    moved = at @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 0.0]]) / np.sqrt(stretch)
    moved[:, 2] = stretch * at[:, 2]
    return np.asarray(moved)


def main() -> None:
    """Print the table."""
    print("| law | stretch | M | N | error of M | of N | orders of Newton's method |\n|---|---|---|---|---|---|---|")
    for name, case in CASES.items():
        for stretch in STRETCHES:
            torque, force = taken(case.stored, stretch)
            solution = twisted(case.law, stretch)
            errors = solution.moments[1, 2] / torque - 1.0, solution.reactions[1, 2] / force - 1.0
            orders = " ".join(f"{one:.1f}" for one in newton_orders(solution.residual_norms))
            print(
                f"| {name} | {stretch:g} | {torque:.6f} | {force:.6f} | {abs(errors[0]):.1e} | {abs(errors[1]):.1e} "
                f"| {orders} |"
            )


if __name__ == "__main__":
    main()
