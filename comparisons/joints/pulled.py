"""A rod pulled in a held sleeve: the finite problem of Muki and Sternberg (1968), by a series and by elements.

A force on the rod's section at ``z = 0`` of a rod and sleeve from ``-length`` to ``length``, of which half is taken:
there displacements across are nothing, and where ``z = length`` that along the axis; the sleeve is held outside.
"""

from typing import Any, NamedTuple

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from scipy.special import ive, kve

import isorod
from comparisons.joints import meridian, sleeve
from comparisons.joints.exact import lame
from comparisons.joints.lattice import circle, ring
from comparisons.joints.traction import Traction
from isorod import LinearElastic, Space, Tie, statics
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface

Array = NDArray[np.float64]

E, NU, RADIUS, OUTER, LENGTH = (10.0, 1.0), (0.3, 0.3), 1.0, 4.0, 8.0

# Loads are times this, so that strains are small.
SIZE = 1e-4

# Terms of the series, summed with Lanczos' factors, so that the remainder oscillates little.
_TERMS = 4000


def mean() -> float:
    """Return the mean displacement of the loaded section under a unit force, of Fourier finite elements."""
    body = meridian.Meridian(
        [
            meridian.Block((0.0, RADIUS), (0.0, LENGTH), E[0], NU[0]),
            meridian.Block((RADIUS, OUTER), (0.0, LENGTH), E[1], NU[1]),
        ],
        [
            meridian.Held(lambda x: np.isclose(x[0], OUTER), "rtz"),
            meridian.Held(lambda x: np.isclose(x[1], 0.0), "rt"),
            meridian.Held(lambda x: np.isclose(x[1], LENGTH), "z"),
        ],
        ((RADIUS,), (0.0,)),
    )
    half = meridian.Load(0, 0.0, RADIUS, lambda r: (0.0, 0.0, 0.5 / (np.pi * RADIUS**2)))
    return 2.0 * body.compliance(half)


def forces(z: Array) -> Array:
    """Return the rod's force at places ``z`` under a unit force, by the series of ``cos kz``, ``k`` odd quarters.

    Each term is the load's own, ``u_z`` constant across the rod, and what makes both bodies fit: of the potentials
    ``I0``, ``K0`` and Papkovich's ``I1``, ``K1``, scaled at the radii ``a`` and ``b``.
    """
    total = np.zeros(len(z))
    for n in range(_TERMS):
        k = (2 * n + 1) * np.pi / (2.0 * LENGTH)
        smooth = np.sinc((2 * n + 1) / (2.0 * _TERMS))
        total += smooth * 2.0 * np.pi * RADIUS * _shear(k) / k * np.sin(k * z)
    # The shear carries the force of half the load.
    return -0.5 - total


def _shear(k: float) -> float:
    """Return the amplitude of ``s_rz`` at the rod's surface where ``u_z`` goes with ``cos kz``."""
    a, b = RADIUS, OUTER
    rod, inner, outer = (_columns(k, r, body) for r, body in ((a, 0), (a, 1), (b, 1)))
    lam, mu = lame(E[0], NU[0])
    own = 1.0 / (np.pi * a**2 * LENGTH) / ((lam + 2.0 * mu) * k**2)
    # With sin kz: u_r and s_rr; with cos kz: u_z and s_rz, of opposite sign to those of `_columns`.
    matrix = np.block([[rod, -inner], [np.zeros((2, 2)), outer[:2]]])
    right = np.array([0.0, own, lam * k * own, 0.0, 0.0, 0.0])
    solution = np.linalg.solve(matrix, right)
    return float(-(rod @ solution[:2])[3])


def _columns(k: float, r: float, body: int) -> Array:
    """Return u_r, u_z, s_rr, s_rz of each function, scaled: growing ones at the outer radius, falling ones at a."""
    z, c = k * r, 4.0 * (1.0 - NU[body])
    lam, mu = lame(E[body], NU[body])
    outer = RADIUS if body == 0 else OUTER
    grow, fall = np.exp(k * (r - outer)), np.exp(k * (RADIUS - r))
    families = [(ive(0, z) * grow, ive(1, z) * grow, 1.0)]
    if body:
        families.append((kve(0, z) * fall, kve(1, z) * fall, -1.0))
    columns = []
    for zero, one, sign in families:
        slope = sign * k * zero - one / r
        plain = sign * k * one, sign * k * slope, -k * zero, -sign * k * k * one
        papkovich = sign * z * zero - c * one, sign * k * zero + k * z * one - c * slope, -z * one, -sign * k * z * zero
        for U, dU, W, dW in (plain, papkovich):
            volume = lam * (dU + U / r + k * W)
            column = np.array([U, W, volume + 2.0 * mu * dU, mu * (dW - k * U)])
            columns.append(column)
    return np.array(columns).T


class Pulled(NamedTuple):
    """Results of a unit force: mean displacement of the loaded section, and the rod's force at places."""

    mean: float
    forces: Array
    unknowns: tuple[int, int]


def solve(
    space: Space, cells: tuple[int, int, int], z: Array, element: str = "P2 bricks", slave: str = "solid"
) -> Pulled:
    """Return the results of a rod's space and a sleeve of cells graded to the load."""
    shape, degree, geometry = sleeve.ELEMENTS[element]
    made = ring(RADIUS, circle(OUTER), LENGTH, cells, shape, geometry)
    x = made.mesh.geometry.x
    r = np.hypot(x[:, 0], x[:, 1])
    for size, own, first, power in ((OUTER - RADIUS, r, RADIUS, 1.5), (LENGTH, x[:, 2], 0.0, 2.5)):
        even = np.linspace(0.0, 1.0, (cells[0] if first else cells[2]) + 1)
        placed = first + size * np.interp((own - first) / size, even, even**power)
        if first:
            x[:, :2] *= (placed / r)[:, None]
        else:
            x[:, 2] = placed
    V = sleeve.vectors(made.mesh, degree)
    nothing = fem.Function(V)
    conditions = [fem.dirichletbc(nothing, fem.locate_dofs_topological(V, 2, made.outside))]
    for letter, at in (("x", 0.0), ("y", 0.0), ("z", LENGTH)):
        part = V.sub("xyz".index(letter))
        own, _ = compat.collapsed(part)
        dofs = fem.locate_dofs_geometrical((part, own), lambda x, at=at: np.isclose(x[2], at))
        conditions.append(fem.dirichletbc(fem.Function(own), dofs, part))
    solid = Solid(V, LinearElastic(E[1], NU[1]), conditions=conditions)
    own_surface, hole = LateralSurface(0), SolidSurface(0, made.hole)
    load = Traction(EndFace(0, "start"), lambda x: np.tile([0.0, 0.0, 0.5 * SIZE / np.pi], (len(x), 1)))
    model = Model(
        [Body(space, LinearElastic(E[0], NU[0]))],
        [Support.end(space, "start", "xy"), Support.end(space, "end", "z")],
        loads=[load],
        ties=[Tie(hole, own_surface, 0.5) if slave == "solid" else Tie(own_surface, hole, 0.5)],
        solids=[solid],
    )
    solution = statics.solve(model)
    work = float((load.nodal(space) * solution.displacement.reshape(-1, 3)).sum())
    along = [solution.section_forces(0, one / LENGTH).force[2] for one in z]
    return Pulled(2.0 * work / SIZE**2, np.array(along) / SIZE, (3 * space.nodes, 3 * solid.nodes))


def rod_space(**space: Any) -> Space:
    """Return a space on the rod."""
    return Space(isorod.straight(LENGTH).sweep(isorod.circle(8, RADIUS)), **space)
