"""Values and derivatives of laws' energies, computed from their expressions by NumPy alone."""

import numpy as np
import sympy as sp

from isorod.material import symbols as s


def by_complex_steps(law, F):
    """Return energy and stress at a deformation gradient ``(3, 3)``, at full activation.

    The derivatives are those of complex steps, which lose no digits (Squire & Trapp, SIAM Review 40 (1998) 110-112).
    """
    evaluate = _energy(law)
    steps = np.imag(evaluate(F + 1e-30j * np.eye(9).reshape(9, 3, 3))) / 1e-30
    return np.real(evaluate(F[None].astype(complex)))[0], steps.reshape(3, 3)


def _energy(law):
    """Return the energy of deformation gradients ``(m, 3, 3)``, complex or not."""
    stored, fibres = law.stored, np.resize(np.append(law.fibres((1,))[0], np.zeros(6)), 6)
    names = (*s.F, *s.STRAINS, *s.a, *s.b, *s.INVARIANTS, s.activation, *stored.constants)
    # NumPy's maximum takes no numbers beside arrays in a list.
    function = sp.lambdify(names, stored.expression.rewrite((sp.Max, sp.Min), sp.Piecewise), "numpy")

    def energy(F):
        C = np.swapaxes(F, -1, -2) @ F
        first = np.trace(C, axis1=-2, axis2=-1)
        second = 0.5 * (first**2 - np.trace(C @ C, axis1=-2, axis2=-1))
        a, b = fibres[:3], fibres[3:]
        along = [np.einsum("A,mAB,B->m", x, C, y) for x, y in ((a, a), (b, b), (a, b))]
        stretches = np.sqrt(np.linalg.eigvals(C)).T
        invariants = (first, second, np.linalg.det(F), *along, *stretches)
        strains = [C[:, A, B] for A in range(3) for B in range(A, 3)]
        values = function(*F.reshape(-1, 9).T, *strains, *fibres, *invariants, 1.0, *law.constants)
        return np.broadcast_to(values, F.shape[:1])

    return energy
