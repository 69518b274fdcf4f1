"""Symbols for stored energies (`isorod.material.energy`).

``F`` is the deformation gradient and ``C = F^T F``, matrices of symbols ``(3, 3)``; ``I1`` and ``I2`` are the principal
invariants of ``C``, ``J = det F``; ``stretches`` are the three principal stretches, in which an energy is symmetric;
``a`` and ``b`` are unit vectors ``(3,)`` along two families of fibres at rest, ``I4a = a.C a`` and ``I4b = b.C b`` the
squares of the stretches of these, and ``I8 = a.C b``.  ``I1bar`` and ``I2bar`` are the invariants of
``J^(-2/3) C``.  ``activation`` is 0 at rest and 1 at full activation; energies are linear in it.  ``temperature`` is
that of the point, ``heat`` that of the body or the current fraction of ``temperature`` (`isorod.material.thermal`).
"""

from typing import Any

from sympy import Matrix, Rational, Symbol, symbols

F = Matrix(3, 3, lambda a, A: Symbol(f"F{a}{A}", real=True))
C = Matrix(3, 3, lambda A, B: Symbol(f"C{min(A, B)}{max(A, B)}", real=True))
I1, I2, J, I4a, I4b = symbols("I1 I2 J I4a I4b", positive=True)
I8 = Symbol("I8", real=True)
stretches = symbols("l1 l2 l3", positive=True)
a = symbols("a0 a1 a2", real=True)
b = symbols("b0 b1 b2", real=True)
activation = Symbol("activation", nonnegative=True)
bulk = Symbol("bulk", nonnegative=True)
temperature = Symbol("temperature", real=True)
heat = Symbol("heat", real=True)

I1bar = J ** Rational(-2, 3) * I1
I2bar = J ** Rational(-4, 3) * I2

STRAINS = tuple(C[A, B] for A in range(3) for B in range(A, 3))
"""The components of ``C``: 00, 01, 02, 11, 12, 22."""

INVARIANTS = (I1, I2, J, I4a, I4b, I8, *stretches)
"""Arguments of an energy without components of tensors, in the order of derivatives."""

strain = Matrix(3, 3, lambda A, B: Symbol(f"strain{min(A, B)}{max(A, B)}", real=True))
"""The logarithmic strain ``ln(C)/2``, for laws of two potentials (`isorod.material.dissipative`)."""

ENTRIES = tuple(strain[A, B] for A in range(3) for B in range(A, 3))
"""Its components: 00, 01, 02, 11, 12, 22."""

trace = strain.trace()


def internal(name: str, kind: str) -> tuple[Any, Any]:
    """Return the symbols of an internal variable and of its rate, matrices ``(3, 3)`` of those that are tensors.

    Parameters
    ----------
    name, kind
        Its name, and ``"scalar"``, ``"symmetric"`` or ``"deviatoric"``: without trace.
    """
    words = name, f"{name}_rate"
    if kind == "scalar":
        return Symbol(words[0], real=True), Symbol(words[1], real=True)
    pair = [Matrix(3, 3, lambda A, B, one=one: Symbol(f"{one}{min(A, B)}{max(A, B)}", real=True)) for one in words]
    if kind == "deviatoric":
        for one in pair:
            one[2, 2] = -one[0, 0] - one[1, 1]
    return pair[0], pair[1]
