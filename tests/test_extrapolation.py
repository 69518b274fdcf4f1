"""The tangent with extrapolated stress, against its formula written out."""

import numpy as np
import pytest
from models import gradients_of_functions
from petsc4py import PETSc

from isorod import Body, Model, Muscle, NeoHookean, Space
from isorod.assembly.assembler import Assembler
from isorod.assembly.mixed import MixedAssembler
from isorod.assembly.pattern import Pattern, add
from isorod.scenes.spring import Spring

LAWS = {
    "neo-Hooke": NeoHookean(80.0, 0.3),
    "fibres": Muscle(80.0, 0.3, sigma_max=50.0, m1=20.0, m2=2.0, activation=0.5, fibre=(0.2, 0.3, 1.0)),
}


def states(dofs):
    random = np.random.default_rng(3)
    return [0.05 * random.uniform(-1, 1, dofs) for _ in range(3)]


def geometric(part, excess):
    """Element matrices of ``delta_ab excess_AB``."""
    t = part.table
    slopes = gradients_of_functions(t)
    one = np.einsum("etq,etqAi,etqAB,etqBk->eik", t.weights, slopes, excess, slopes, optimize=True)
    size = 3 * one.shape[1]
    return np.einsum("eik,ab->eiakb", one, np.eye(3)).reshape(-1, size, size)


def merged(matrices, blocks):
    entries = np.zeros(blocks.total)
    add(matrices, blocks, entries)
    return entries


def symmetric(S):
    return 0.5 * (S + np.swapaxes(S, -1, -2))


@pytest.mark.parametrize("law", LAWS.values(), ids=list(LAWS))
def test_stress_is_that_of_the_last_state_and_its_derivative(law):
    """``S' = S0 + F0^-1 (A0 : D - D S0)``; the third tangent knows the second state, not the first."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=5).rod(), elements=4, degree=3)
    assembler = Assembler(Model([Body(space, law)]), PETSc.COMM_SELF)
    (part,), (blocks,) = assembler.parts, Pattern([assembler.parts[0].of_dofs], assembler.free).blocks
    part.extrapolate(True)
    last = None
    for local in states(3 * space.nodes):
        entries = np.zeros(blocks.total)
        part.add_entries(local, 1.0, blocks, entries)
        matrices, F = part.matrices(local, 1.0), part.gradients(local)
        S = np.linalg.solve(F, law.stress(F))
        if last is not None:
            before, S0, moduli = last
            D = F - before
            grown = np.einsum("...aAbB,...bB->...aA", moduli, D) - D @ S0
            excess = symmetric(S0 + np.linalg.solve(before, grown) - S)
            assert np.abs(excess).max() > 0.1
            matrices = matrices + geometric(part, excess)
        expected = merged(matrices, blocks)
        assert np.abs(entries - expected).max() < 1e-12 * np.abs(expected).max()
        last = F, S, law.tangent(F)


def test_pressure_changes_with_the_states():
    """Of the mixed formulation: the stress that it adds is of the present pressure, pulled back in the last state."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4, degree=3)
    law = NeoHookean(80.0, 0.49)
    assembler = MixedAssembler(Model([Body(space, law, formulation="mixed")]), PETSc.COMM_SELF)
    (part,), (blocks,) = assembler.parts, Pattern([assembler.parts[0].of_dofs], assembler.free).blocks
    size = int(part.dofs.max()) + 1
    first, second, _ = states(size)
    part.extrapolate(True)
    part.add_entries(first, 1.0, blocks, np.zeros(blocks.total))
    found = np.zeros(blocks.total)
    part.add_entries(second, 1.0, blocks, found)

    def at(local):
        F, p = part.gradients(local), part.pressure(local)[..., None, None]
        G = np.linalg.inv(F)
        S = np.linalg.solve(F, law.shear.stress(F)) + p * (G @ np.swapaxes(G, -1, -2))
        moduli = law.shear.tangent(F) - p[..., None, None] * np.einsum("...Ba,...Ab->...aAbB", G, G)
        return F, p, G, S, moduli

    F0, p0, G0, S0, moduli = at(first)
    F, p, _, S, _ = at(second)
    D = F - F0
    grown = np.einsum("...aAbB,...bB->...aA", moduli, D) - D @ S0
    excess = symmetric(S0 + G0 @ grown + (p - p0) * (G0 @ np.swapaxes(G0, -1, -2)) - S)
    own = geometric(part, excess).reshape(part.shape[0], part.shape[1], part.moves, part.shape[1], part.moves)
    matrices = part.matrices(second, 1.0) + part.padded_matrices(own).reshape(
        part.dofs.shape[0], -1, part.dofs.shape[1]
    )
    expected = merged(matrices, blocks)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
