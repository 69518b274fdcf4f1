"""Moments on sections: statically equivalent, exact in torsion and bending, the same in space however they turn."""

import numpy as np
import pytest
from petsc4py import PETSc
from refused import refused

from isorod import (
    LinearElastic,
    NeoHookean,
    Space,
    StVenantKirchhoff,
    buckling,
    circle,
    dynamics,
    modal,
    statics,
    straight,
)
from isorod.assembly.assembler import Assembler
from isorod.model import Body, Model, SectionLoad, Support
from isorod.model.mean import MeanSupport
from isorod.tensors import rotation

LENGTH, RADIUS = 10.0, 1.0


def space(length=LENGTH, radius=RADIUS, **given):
    return Space(straight(length).sweep(circle(8, radius)), **{"elements": 4, "degree": 3, "section_degree": 2} | given)


def bar(law, moment, own=None, held=(), **given):
    own = space() if own is None else own
    supports = [*held] or [MeanSupport.end(own, "start", mean="fixed")]
    return Model([Body(own, law, 1.0)], supports, loads=[SectionLoad.end(own, "end", moment=moment)], **given)


def test_resultants_wherever_the_section_is():
    """Bent and twisted by far, and stretched across: no force, and the moment about wherever the middle is."""
    own, moment = space(), np.array([0.3, -0.2, 0.7])
    for u in (0.4, 0.5, 1.0):
        load = SectionLoad(u=u, moment=tuple(moment))
        rest = load.nodal(own)
        assert np.cross(own.positions, rest).sum(axis=0) == pytest.approx(moment, abs=1e-12)
        model = Model([Body(own, NeoHookean(10.0, 0.3))], loads=[load])
        assembler = Assembler(model)
        turned = own.positions @ (np.diag([1.3, 0.8, 1.1]) @ rotation((1.0, 2.0, -0.7))) - own.positions
        change = assembler._pressing[0].forces(assembler.parts[0].nodal(assembler.local(turned.ravel())))
        forces = assembler.everywhere(assembler._sums([assembler.parts[0].padded(change)])).reshape(-1, 3)
        assert forces[own.is_control_point].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
        assert np.cross(own.positions + turned, forces).sum(axis=0) == pytest.approx(moment, rel=1e-10)


def test_tangent_is_the_derivative_of_the_residual():
    model = bar(NeoHookean(10.0, 0.3), (0.3, -0.2, 0.7), space(elements=2))
    assembler = Assembler(model)
    assert not assembler.symmetric
    rng = np.random.default_rng(1)
    x, way = assembler.vector(), assembler.vector()
    x.array_w[:], way.array_w[:] = 0.05 * rng.standard_normal((2, assembler.vector().getSize()))
    matrix = assembler.matrix()
    assembler.tangent(x, 0.8, matrix)
    change, ends = assembler.vector(), []
    matrix.mult(way, change)
    for sign in (1.0, -1.0):
        moved, out = x.copy(), assembler.vector()
        moved.axpy(sign * 1e-5, way)
        assembler.residual(moved, 0.8, out)
        ends.append(out.array_r.copy())
    assert change.array_r == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-7 * np.abs(change.array_r).max())


@pytest.mark.parametrize("u", [1.0, 0.5])
def test_torsion_of_a_round_bar_and_pure_bending_are_exact(u):
    """Twist ``T l / G Ip`` and slope ``M l / E I`` (Saint-Venant), with no stress but theirs from end to end."""
    young, nu, own = 2.6, 0.3, space(length=6.0, elements=4, continuity=0)
    polar = 0.5 * np.pi
    for moment in ((0.0, 0.0, 1e-3), (2e-3, 0.0, 0.0)):
        supports = [MeanSupport.end(own, "start", mean="fixed")]
        model = Model([Body(own, LinearElastic(young, nu))], supports, loads=[SectionLoad(u=u, moment=moment)])
        found = statics.solve(model)
        assert found.moments[0] == pytest.approx(-np.array(moment), abs=1e-12)
        twist = moment[2] * 6.0 * u / (young / 2.6 * polar)
        slope = moment[0] * 6.0 * u / (young * 0.5 * polar)
        side = found.at(0, 1.0, (1.0, 0.0)) - found.at(0, 1.0, (-1.0, 0.0))
        assert side[1] == pytest.approx(2.0 * twist, rel=1e-9, abs=1e-14)
        side = found.at(0, 1.0, (0.0, 1.0)) - found.at(0, 1.0, (0.0, -1.0))
        assert side[2] == pytest.approx(2.0 * slope, rel=1e-9, abs=1e-14)


def test_a_cantilever_rolls_up_to_a_circle():
    """``M = 2 pi E I / L``: the moment keeps its direction in space while the end turns once about it."""
    own = space(20.0, 0.05, elements=8, degree=4)
    moment = 1e3 * np.pi * 0.05**4 / 4.0 * 2.0 * np.pi / 20.0
    found = statics.solve(bar(StVenantKirchhoff(1e3, 0.0), (moment, 0.0, 0.0), own), load_steps=6)
    tip = found.position(0, 1.0)
    assert np.linalg.norm(tip) < 1e-3 * 20.0


def test_a_free_body_turns_faster_by_the_moment():
    """Angular momentum about any point grows by the moment times the time, in implicit steps exactly."""
    own, moment = space(elements=2), np.array([0.2, 0.0, 0.1])
    model = Model([Body(own, NeoHookean(10.0, 0.3), 1.0)], loads=[SectionLoad.end(own, "end", moment=tuple(moment))])
    found = dynamics.solve(model, 2.0, 0.1, 2, integrator="implicit", petsc={"snes_rtol": 1e-12}, comm=PETSc.COMM_SELF)
    momenta = Assembler(model.in_motion("implicit"), PETSc.COMM_SELF)
    mass = momenta.mass()
    v = momenta.state(found.velocity[-1])
    p = v.duplicate()
    mass.mult(v, p)
    places = own.positions + found.displacement[-1].reshape(-1, 3)
    spun = np.cross(places, p.array_r.reshape(-1, 3)).sum(axis=0)
    assert spun == pytest.approx(2.0 * moment, rel=1e-8, abs=1e-10)
    assert abs(found.energy_error[-1]) < 1e-8 and found.momentum_error[-1] < 1e-8


def on_held(how):
    own = space()
    support = MeanSupport.end(own, "end", **how) if how else Support.end(own, "end")
    return bar(NeoHookean(1.0, 0.3), (0.1, 0.0, 0.0), own, [support])


def test_a_moment_about_the_axis_of_a_hinge_acts():
    own, length = space(20.0), 20.0
    supports = [
        MeanSupport.end(own, "start", mean="fixed"),
        MeanSupport.end(own, "end", mean="hinge", axis=(1.0, 0.0, 0.0)),
    ]
    found = statics.solve(bar(LinearElastic(10.0, 0.3), (0.1, 0.0, 0.0), own, supports))
    # Timoshenko's beam, clamped here and propped there: about half of it reaches the clamp.
    bending, shear = 10.0 * np.pi / 4.0, 7.8 / 8.8 * np.pi * 10.0 / 2.6
    prop = (length**2 / (2.0 * bending)) / (length**3 / (3.0 * bending) + length / shear)
    assert found.moments[0, 0] == pytest.approx(0.1 * (prop * length - 1.0), rel=5e-3)


test_bad_input = refused(
    (lambda: SectionLoad(), "section load: got neither force nor moment, need one of them, or both"),
    (lambda: SectionLoad(moment=(np.inf, 0.0, 0.0)), "section load: moment: got"),
    (lambda: modal.solve(bar(NeoHookean(1.0, 0.3), (0.1, 0.0, 0.0))), "load 0: a moment that stays the same in space"),
    (lambda: buckling.solve(bar(NeoHookean(1.0, 0.3), (0.1, 0.0, 0.0))), "load 0: a moment that stays"),
    (lambda: statics.solve(bar(NeoHookean(1.0, 0.3), (0.1, 0.0, 0.0)), stable=True), "stability is unknown with"),
    (lambda: on_held({}), "load 0: the section is held: a moment on it does nothing; leave it out"),
    (lambda: on_held({"mean": "hinge", "axis": (0.0, 1.0, 0.0)}), "load 0: the section is held"),
    (lambda: MeanSupport.section(space(), 2.0), "got u = 2, need an axis parameter from 0 to 1"),
)
