"""Coriolis forces in the frame that turns with a spin: ``G v``, ``G_jl,km = 2 int rho S_l R_j [w] S_m R_k dV``."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.assembler import Assembler
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern, add, joined
from isorod.errors import InputError
from isorod.petsc.matrix import create_matrix, set_values

# Pairs of components that they couple.
_PAIRS = [(a, b) for a in range(3) for b in range(3) if a != b]


def coriolis(assembler: Assembler, lumped: bool = False) -> PETSc.Mat:
    """Return the antisymmetric matrix ``G`` of a model with a spin at load factor 1."""
    model = assembler.model
    if "sbaij" in PETSc.Options().getString("mat_type", ""):
        raise InputError("-mat_type sbaij: the Coriolis matrix is antisymmetric; use aij, the default")
    assert model.spin is not None
    x, y, z = model.spin.velocity
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    entries, rows, columns = _pairs(assembler, lumped)

    def indices() -> tuple[Index, Index]:
        return joined([rows[a] for a, _ in _PAIRS], int), joined([columns[b] for _, b in _PAIRS], int)

    sizes = assembler.rows, assembler.unknowns
    matrix = create_matrix(assembler.comm, sizes, assembler.block, indices)
    set_values(matrix, joined([2.0 * across[pair] * entries for pair in _PAIRS], float))
    assembler.note("Coriolis forces")
    return matrix


def _pairs(assembler: Assembler, lumped: bool) -> tuple[Array, list[Index], list[Index]]:
    """Return the entries of the mass of one component, and of each component the rows and columns they are at."""
    parts: list[Part] = assembler.parts
    numbers = [assembler.unknown_of[a::3] for a in range(3)]
    if lumped:
        nodes = joined([part.nodes for part in parts], int)
        places = [number[nodes] for number in numbers]
        return joined([part.lumped_mass() for part in parts], float), places, places
    pattern = Pattern([part.of_nodes for part in parts], np.max(numbers, axis=0))
    entries = np.zeros(pattern.total)
    for part, blocks in zip(parts, pattern.blocks, strict=True):
        add(part.mass, blocks, entries)
    found = [pattern.indices(number) for number in numbers]
    return entries, [row for row, _ in found], [column for _, column in found]
