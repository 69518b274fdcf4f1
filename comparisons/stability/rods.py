"""Common to several cases: the shallow arch, bars of Saint-Venant's stiffness, condition numbers."""

import numpy as np

from isorod import statics
from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import LinearElastic
from isorod.model import Body, Model, Support
from isorod.space import Space

STIFFNESSES = {
    "torsion": "torsion constant",
    "weak": "bending the thin way",
    "strong": "bending the wide way",
}
NU, E = 0.3, 1.0
ANGLE = 0.01


def arch(span: float, rise: float) -> Rod:
    """Return a parabolic arch in the x-z plane, one quadratic element."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    rotations = []
    for slope in (4.0 * rise / span, 0.0, -4.0 * rise / span):
        t, y = np.array([1.0, 0.0, slope]) / np.hypot(1.0, slope), np.array([0.0, 1.0, 0.0])
        rotations.append(np.stack([y, np.cross(t, y), t], axis=1))
    centers = np.array([[-0.5 * span, 0.0, 0.0], [0.0, 0.0, 2.0 * rise], [0.5 * span, 0.0, 0.0]])
    return Rod.sweep(circle(4), axis, centers, np.array(rotations))


def stiffness(space: Space, kind: str, a: float, b: float, length: float) -> tuple[float, float, Model]:
    """Return the stiffness of a straight elliptical bar along z, the exact one, and the model.

    The end faces stay free to warp (torsion) and to change their shape (bending): then Saint-Venant's solutions are
    exact.

    Parameters
    ----------
    space
        Of the bar.
    kind
        One of `STIFFNESSES`.
    a, b
        Half axes along x and y, units of length.
    length
        Of the bar.
    """
    ends = [np.arange(space.layer_nodes), (space.layers - 1) * space.layer_nodes + np.arange(space.layer_nodes)]
    # Rotations are linear in the position, which has the coefficients of the rod's map.
    axis = {"torsion": 2, "weak": 0, "strong": 1}[kind]
    turn = np.cross(
        np.eye(3)[axis] * ANGLE,
        space.positions[ends[1]] - space.is_control_point[ends[1], None] * np.array([0.0, 0.0, length]),
    )
    held = "xy" if kind == "torsion" else "z"
    supports = [Support(ends[0], held), Support(ends[1], held, turn)]
    # What the faces leave free of rigid motions, held where it takes no force.
    first = int(np.argmax(space.is_control_point))
    if kind == "torsion":
        supports.append(Support(np.array([first]), "z"))
    else:
        other = space.points_around // 2 if space.basis.on_surface else 1
        supports += [Support(np.array([first]), "xy"), Support(np.array([other]), "y")]
    model = Model([Body(space, LinearElastic(E, NU))], supports)
    solution = statics.solve(model)
    moment = abs(solution.moments[1, axis])
    exact = {
        "torsion": E / (2.0 * (1.0 + NU)) * np.pi * a**3 * b**3 / (a**2 + b**2),
        "weak": E * np.pi * a * b**3 / 4.0,
        "strong": E * np.pi * a**3 * b / 4.0,
    }[kind]
    return float(moment * length / ANGLE), float(exact), model


def condition(model: Model, displacement: Array | None = None) -> tuple[float, float]:
    """Return the condition number of a model's tangent, as it is and with a unit diagonal; beyond 1e16 a lower bound.

    At rest, or at full load and the displacement ``(dofs,)`` if one is given.
    """
    assembler = Assembler(model)
    matrix = assembler.matrix()
    if displacement is None:
        assembler.tangent(assembler.vector(), 0.0, matrix)
    else:
        assembler.tangent(assembler.state(displacement), 1.0, matrix)
    dense = matrix.convert("dense").getDenseArray()
    root = 1.0 / np.sqrt(np.abs(np.diag(dense)))
    conditions = []
    for one in (dense, root[:, None] * dense * root):
        sizes = np.abs(np.linalg.eigvalsh(one))
        conditions.append(float(sizes.max() / max(sizes.min(), np.finfo(float).tiny)))
    return conditions[0], conditions[1]
