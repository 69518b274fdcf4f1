"""The assembler for a model's formulations; the mixed one is imported only if a body needs it."""

from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import is_mixed
from isorod.model.model import Model


def assembler_for(model: Model, comm: PETSc.Comm | None = None) -> Assembler:
    """Return the assembler of a model: the mixed one where a body has pressures."""
    if not is_mixed(model):
        return Assembler(model, comm)
    from isorod.assembly.mixed import MixedAssembler

    return MixedAssembler(model, comm)
