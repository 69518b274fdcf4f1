"""Results of ties: force, moment, traction on the surface, and relative displacements of both sides."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly.bonds import tangential
from isorod.model.model import Model
from isorod.model.tie import Tie

if TYPE_CHECKING:
    from petsc4py import PETSc

    from isorod.assembly.assembler import Assembler
    from isorod.assembly.constraints import Tied
    from isorod.assembly.coupling import Coupling


@dataclass(frozen=True, eq=False)
class TieResult:
    """The result of a tie.

    Attributes
    ----------
    tie
        The tie.
    force, moment
        Resultant of the tractions on the slave, shape ``(3,)``, and their moment about ``center``.
    center
        Mean of the surface at rest, shape ``(3,)``.
    jump
        Largest relative displacement of both sides, units of length; of a sliding tie along the normal alone.
    slip
        Largest relative displacement along the surface, of a sliding tie.
    gap
        Largest distance of the surfaces at rest, units of length.
    area
        Area of the slave's surface.
    points, normals, traction
        Quadrature points of the slave's surface and its normals there, at rest, and the traction on it, force per
        reference area, shape ``(q, 3)`` each.  Where the surface ends at an edge of the other body it is singular.
    """

    tie: Tie
    force: Array
    moment: Array
    center: Array
    jump: float
    slip: float
    gap: float
    area: float
    points: Array = field(repr=False)
    normals: Array = field(repr=False)
    traction: Array = field(repr=False)

    def record(self) -> dict[str, Any]:
        """Return the entries for a record."""
        return {name: getattr(self, name) for name in ("force", "moment", "jump", "slip", "gap", "area")}


def at_load(assembler: "Assembler", x: "PETSc.Vec", factor: float, acting: Array | None = None) -> list[TieResult]:
    """Return the result of each tie in an equilibrium, on every rank; ``acting`` may be known."""
    if assembler.coupling is None:
        return []
    acting = assembler.system_forces(x, factor) if acting is None else acting
    return results(assembler.model, assembler.coupling, acting, assembler.system_displacement(x, factor))


def results(model: Model, coupling: "Coupling", forces: Array, displacement: Array) -> list[TieResult]:
    """Return the result of each tie, on every rank.

    Parameters
    ----------
    model, coupling
        The model, and its ties.
    forces
        Forces of supports and ties on all degrees of freedom, those of solids behind those of rods: internal and
        inertial forces less external ones.
    displacement
        All degrees of freedom.
    """
    constraints, forces, moved = coupling.constraints, forces.copy(), displacement.reshape(-1, 3)
    # The functions of all nodes of solids add up to one, and those of control points of rods.
    control = np.ones(len(moved))
    control[: model.dofs // 3] = model.is_control_point
    of_solids = coupling.everywhere([solid.positions.ravel() for solid in model.solids])
    places = np.concatenate([*(body.space.positions for body in model.bodies), of_solids.reshape(-1, 3)])
    by_tie: list[TieResult | None] = [None] * len(constraints.ties)
    for k in constraints.order:
        tied, tie = constraints.ties[k], model.ties[k]
        carried = forces[tied.slaves]
        # Forces on the slave react on the master; entries of the slave's own body cancel.
        on_master = tied.rows.T @ carried
        forces[tied.slaves] = 0.0
        forces += on_master
        of_slave = constraints.body_of(tie.slave)
        nodal = np.zeros(3 * len(moved))
        nodal[tied.slaves] = carried
        nodal[of_slave] -= on_master[of_slave]
        if tied.bond is not None:
            nodal[of_slave] -= tied.bond.forces(moved.ravel())[of_slave]
        nodal = nodal.reshape(-1, 3)
        trace, traction = tied.trace, _traction(tied, nodal)
        center = trace.weights @ trace.points / trace.weights.sum()
        by_tie[k] = TieResult(
            tie=tie,
            force=control @ nodal,
            moment=np.cross(places - control[:, None] * center, nodal).sum(axis=0),
            center=center,
            jump=_jump(tie, tied, moved),
            slip=_slip(tie, tied, moved),
            gap=tied.gap,
            area=float(trace.weights.sum()),
            points=trace.points,
            normals=trace.normals,
            traction=traction,
        )
    return [result for result in by_tie if result is not None]


def _traction(tied: "Tied", nodal: Array) -> Array:
    """Return tractions at the points from nodal forces ``(nodes, 3)`` on the slave.

    Those of a weld are combinations of its multiplier functions, others of the slave's functions.
    """
    points, weights = tied.trace.points, tied.trace.weights[:, None]
    if tied.multipliers:
        result = np.zeros(points.shape)
        for a, multipliers in tied.multipliers.items():
            nodes = tied.slaves[tied.slaves % 3 == a] // 3
            result[:, a] = multipliers.values @ np.linalg.solve(multipliers.forces, nodal[nodes, a])
        return result
    nodes = np.flatnonzero(nodal.any(axis=1))
    values = tied.own[:, nodes].toarray()
    return np.asarray(values @ np.linalg.lstsq(values.T @ (weights * values), nodal[nodes], rcond=None)[0])


def _jump(tie: Tie, tied: "Tied", moved: Array) -> float:
    """Return the largest relative displacement of both sides, of a sliding tie along the normal alone."""
    apart = tied.jump @ moved
    if tie.kind == "slide":
        return float(np.abs(np.sum(apart * tied.trace.normals, axis=1)).max())
    return float(np.linalg.norm(apart, axis=1).max())


def _slip(tie: Tie, tied: "Tied", moved: Array) -> float:
    """Return the largest slip; zero unless the tie slides."""
    if tie.kind != "slide":
        return 0.0
    return float(np.linalg.norm(tangential(tied.jump @ moved, tied.trace.normals), axis=1).max())
