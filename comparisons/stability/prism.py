"""Torsion and bending stiffness of an elliptical bar as a 3-D solution, against Saint-Venant's, and condition numbers."""

import numpy as np

from isorod import statics
from isorod.assembly.assembler import Assembler
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


def stiffness(space: Space, kind: str, a: float, b: float, length: float) -> tuple[float, float, Model]:
    """Return the stiffness of a straight bar along z with half axes ``a`` (x) and ``b`` (y), the exact one, and the model.

    The end faces stay free to warp (torsion) and to change their shape (bending): then Saint-Venant's solutions are
    exact.
    """
    ends = [np.arange(space.layer_nodes), (space.layers - 1) * space.layer_nodes + np.arange(space.layer_nodes)]
    # Rotations are linear in the position, whose coefficients are those of the rod's map.
    axis = {"torsion": 2, "weak": 0, "strong": 1}[kind]
    turn = np.cross(
        np.eye(3)[axis] * ANGLE,
        space.positions[ends[1]] - space.is_carrier[ends[1], None] * np.array([0.0, 0.0, length]),
    )
    held = "xy" if kind == "torsion" else "z"
    supports = [Support(ends[0], held), Support(ends[1], held, turn)]
    # What the faces leave free of rigid motions, held where it takes no force.
    first = int(np.argmax(space.is_carrier))
    if kind == "torsion":
        supports.append(Support(np.array([first]), "z"))
    else:
        other = space.points_around // 2 if space.basis.on_surface else 1
        supports += [Support(np.array([first]), "xy"), Support(np.array([other]), "y")]
    model = Model([Body(space, LinearElastic(E, NU))], supports)
    found = statics.solve(model)
    moment = abs(found.moments[1, axis])
    exact = {
        "torsion": E / (2.0 * (1.0 + NU)) * np.pi * a**3 * b**3 / (a**2 + b**2),
        "weak": E * np.pi * a * b**3 / 4.0,
        "strong": E * np.pi * a**3 * b / 4.0,
    }[kind]
    return float(moment * length / ANGLE), float(exact), model


def condition(model: Model) -> tuple[float, float]:
    """Return the condition number of a model's stiffness at rest, as it is and with a unit diagonal."""
    assembler = Assembler(model)
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    dense = matrix.convert("dense").getDenseArray().copy()
    dense = 0.5 * (dense + dense.T)
    root = 1.0 / np.sqrt(np.diag(dense))
    found = []
    for one in (dense, root[:, None] * dense * root):
        values = np.linalg.eigvalsh(one)
        found.append(float(values[-1] / max(values[0], 1e-300)))
    return found[0], found[1]
