"""Universal torsion and extension of a solid cylinder: what it takes by quadrature, and a rod that is twisted so."""

import numpy as np
from conftest import straight

from isorod import statics
from isorod.model import Body, Model, Support
from isorod.space import Space

TAU = 0.5
# Step of differentiation in the complex plane.
STEP = 1e-30


def taken(energy, stretch, tau):
    """Return torque and axial force of the cylinder of radius 1 of any incompressible law.

    Of what ``energy(I1, I2, I4, stretches)`` stores per length the derivatives by ``tau``, the twist per reference
    length, and the stretch: the deformation ``r = R/sqrt(stretch), theta = Theta + tau Z, z = stretch Z`` is one of all
    such laws, isotropic or with fibres along the axis, and keeps the volume, so that no pressure does work.
    """
    R, weights = np.polynomial.legendre.leggauss(60)
    R, weights = 0.5 * (1.0 + R), 0.5 * weights

    def stored(stretch, tau):
        shear = (R * tau) ** 2 / stretch
        I1, I4 = 2.0 / stretch + stretch**2 + shear, stretch**2 + shear
        # det C = 1: the second invariant is the trace of the inverse.
        I2 = 1.0 / stretch**2 + 2.0 * stretch + (R * tau / stretch) ** 2
        half = 0.5 * (I1 - 1.0 / stretch)
        root = np.sqrt(half**2 - stretch)
        stretches = stretch**-0.5 + 0.0 * R, np.sqrt(half + root), np.sqrt(half - root)
        return np.sum(weights * 2.0 * np.pi * R * energy(I1, I2, I4, stretches))

    return np.imag(stored(stretch, tau + 1j * STEP)) / STEP, np.imag(stored(stretch + 1j * STEP, tau)) / STEP


def twisted(law, stretch=1.0, tau=TAU, **options):
    """Return the solution of a rod of length and radius 1 whose end sections are turned, drawn in and pulled so."""
    rod = straight(8)
    where = Space.paper(rod, **({"elements": 2, "degree": 5, "section_degree": 4, "quadrature": "full"} | options))
    supports = []
    for which, turned in (("start", 0.0), ("end", tau)):
        held = Support.end(where, which)
        at = where.positions[held.nodes]
        c, s = np.cos(turned), np.sin(turned)
        moved = at @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 0.0]]) / np.sqrt(stretch)
        moved[:, 2] = stretch * at[:, 2]
        supports.append(Support(held.nodes, "xyz", moved - at, space=where))
    return statics.solve(Model([Body(where, law, formulation="mixed")], supports))
