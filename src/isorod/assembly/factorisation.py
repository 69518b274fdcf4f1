"""The direct solver that suits a model's matrices."""

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.model.model import Model
from isorod.petsc import banded

# The tangent of rods is banded in the numbering along the axis: by default LAPACK factorises the band.
BAND: dict[str, object] = {"pc_type": "python", "pc_python_type": banded.NAME}

# PETSc's own factors, on request or for a tangent that is not symmetric: natural ordering causes no fill-in.  For wide
# bands a supernodal factorisation is still faster (measured: equal at about 150 unknowns an element).
ROWS: dict[str, object] = {
    "pc_type": "lu",
    "pc_factor_mat_ordering_type": "natural",
    # PETSc's own bound is absolute: a modulus of 1e-12 would be refused.
    "pc_factor_zeropivot": 1e-300,
}


SPARSE: dict[str, object] = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}

WIDE = 150

# MUMPS's scaling, an iteration over all entries, takes a third of the time of a factorisation, and changes no pivot of
# a definite matrix.
_UNSCALED = "mat_mumps_icntl_8"


def factorisation(assembler: Assembler, prefix: str = "") -> dict[str, object]:
    """Return the options of the direct solver that suits a model: `isorod.petsc.banded` for bands, else MUMPS.

    None if the user's options name a preconditioner other than a factorisation, which might read some of them.
    """
    typed = PETSc.Options().getAll()
    own = any(name.startswith(f"{prefix}pc_") or name == "mat_type" for name in typed)
    if typed.get(f"{prefix}pc_type", "lu") not in ("lu", "cholesky"):
        return {}
    width = max(3 * body.space.element_nodes.shape[1] for body in assembler.model.bodies)
    # Contact couples bodies that are far apart in the numbering.
    plain, alone = assembler.contact is None and assembler.coupling is None, assembler.comm.getSize() == 1
    # The mixed formulation's tangent is indefinite and may need row exchanges: `banded` makes them on one rank.
    mixed = is_mixed(assembler.model)
    if plain and (alone or not mixed) and assembler.symmetric and not own and suits(assembler.model):
        chosen = BAND
    else:
        chosen = ROWS if plain and alone and not mixed and width <= WIDE else SPARSE
    if not assembler.symmetric:
        chosen = chosen | {"pc_type": "lu"}
    return {f"{prefix}{name}": value for name, value in chosen.items()}


def unscaled(assembler: Assembler, prefix: str = "") -> dict[str, object]:
    """Return the option that turns off MUMPS' scaling where the tangent is definite; MUMPS reads it at its start.

    With contact it is definite, except for friction and pressures.
    """
    definite = assembler.contact is not None and not is_mixed(assembler.model)
    return {f"{prefix}{_UNSCALED}": 0} if definite else {}


def is_mixed(model: Model) -> bool:
    """Return whether a body of the model has the mixed formulation."""
    return any(body.formulation == "mixed" for body in model.bodies)


# A band this many times wider than the unknowns of an element holds more zeros than entries.
_WIDE = 1.5


def suits(model: Model) -> bool:
    """Return whether the unknowns of each element are numbered close to each other, as in an open rod."""
    for body, first in zip(model.bodies, model.first_node[:-1], strict=True):
        nodes = first + body.space.element_nodes
        unknowns = model.free.reshape(-1, 3)[nodes].reshape(nodes.shape[0], -1)
        reach = unknowns.max(axis=1) - np.where(unknowns < 0, model.dofs, unknowns).min(axis=1)
        if reach.max() >= _WIDE * unknowns.shape[1]:
            return False
    return True
