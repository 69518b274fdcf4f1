"""Coriolis forces in the frame that turns with a spin: ``G v``, ``G_jl,km = 2 int rho S_l R_j [w] S_m R_k dV``."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Index
from isorod.assembly.assembler import Assembler
from isorod.assembly.mass import masses
from isorod.assembly.pattern import joined
from isorod.errors import InputError
from isorod.petsc.matrix import create_matrix, set_values
from isorod.tensors import cross

# Pairs of components coupled by Coriolis forces.
_PAIRS = [(a, b) for a in range(3) for b in range(3) if a != b]


def coriolis(assembler: Assembler, lumped: bool = False) -> PETSc.Mat:
    """Return the antisymmetric matrix ``G`` of a model with a spin, at load factor 1."""
    model = assembler.model
    if "sbaij" in PETSc.Options().getString("mat_type", ""):
        raise InputError("-mat_type sbaij: the Coriolis matrix is antisymmetric; use aij, the default")
    assert model.spin is not None
    across = np.sqrt(model.amplitude(model.spin.history, 1.0)) * cross(model.spin.velocity)
    mass = masses(assembler.parts, [assembler.unknown_of[a::3] for a in range(3)], lumped)

    def indices() -> tuple[Index, Index]:
        places = mass.places()
        return joined([places[a][0] for a, _ in _PAIRS], int), joined([places[b][1] for _, b in _PAIRS], int)

    sizes = assembler.rows, assembler.unknowns
    matrix = create_matrix(assembler.comm, sizes, assembler.block, indices)
    set_values(matrix, joined([2.0 * across[pair] * mass.entries for pair in _PAIRS], float))
    assembler.note("Coriolis forces")
    if assembler.coupling is None:
        return matrix
    system = assembler.coupling.matrix(matrix, (), symmetric=False, stiffness=False)
    assembler.coupling.fill(system, ())
    return system
