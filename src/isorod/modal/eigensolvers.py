"""SLEPc's eigensolvers: what each is offered, and what it wants of the mass."""

from collections.abc import Mapping

from petsc4py import PETSc
from slepc4py import SLEPc

from isorod.errors import InputError
from isorod.options import defaults
from isorod.petsc.direct import room

# What a user's option overrides.
OPTIONS = {"eps_tol": 1e-10, "st_type": "sinvert", "st_ksp_type": "preonly"}

# Measured on the blade: below a tolerance of 1e-8 none of them gets (LOBPCG 1e-7), and LOBPCG breaks down with blocks
# of several modes, which converge at very different rates.
PRECONDITIONED_OPTIONS = {
    "eps_tol": 1e-8,
    "eps_max_it": 3000,
    "st_pc_type": "cholesky",
    "st_pc_factor_mat_solver_type": "mumps",
}
LOBPCG_OPTIONS = {"eps_tol": 1e-7, "eps_lobpcg_blocksize": 1, "st_ksp_type": "preonly"}

# Eigensolvers that take a preconditioner instead of a spectral transformation.
PRECONDITIONED = ("lobpcg", "rqcg", "gd", "jd")
# Eigensolvers that need a definite mass: those, which go down Rayleigh's quotient, and LAPACK's.
DEFINITE = (*PRECONDITIONED, "lapack")

# Options after which the eigensolver still wants no more of the mass than its products.
_HARMLESS = (
    *("eps_nev", "eps_ncv", "eps_mpd", "eps_tol", "eps_max_it", "eps_purify", "eps_krylovschur", "eps_conv"),
    *("eps_monitor", "eps_view", "eps_error", "st_ksp", "st_pc"),
)


def typed(singular: bool) -> str:
    """Return the kind of eigensolver that is in force, for a mass that may be singular.

    Raises
    ------
    InputError
        If it takes none that is.
    """
    options = PETSc.Options().getAll()
    kind, transformation = options.get("eps_type", "krylovschur"), options.get("st_type", "sinvert")
    said = None
    if kind in DEFINITE:
        said, instead = f"-eps_type {kind}", "krylovschur"
    elif transformation != "sinvert":
        said, instead = f"-st_type {transformation}", "sinvert"
    if singular and said is not None:
        raise InputError(
            f"{said}: needs a definite mass matrix, the mixed formulation's is singular; use {instead}, the default"
        )
    return str(kind)


def offered(kind: str, others: Mapping[str, object]) -> Mapping[str, object]:
    """Return what to offer an eigensolver of some kind; ``others`` suit those with a spectral transformation."""
    if kind not in PRECONDITIONED:
        return {**OPTIONS, **others}
    found = PRECONDITIONED_OPTIONS | (LOBPCG_OPTIONS if kind == "lobpcg" else {})
    if PETSc.Options().getAll().get("st_pc_type", "cholesky") in ("lu", "cholesky"):
        return found
    return {name: value for name, value in found.items() if not name.startswith("st_pc_")}


def only_multiplies() -> bool:
    """Return whether the eigensolver takes the mass only to multiply with, as the default with a shift of zero does."""
    typed = (name for name in PETSc.Options().getAll() if name.startswith(("eps_", "st_")))
    return all(name.startswith(_HARMLESS) for name in typed)


def solve(eps: SLEPc.EPS) -> None:
    """Solve; what an error leaves half-done is given up, not destroyed, at which newer SLEPc would fail once more."""
    try:
        with defaults(room(eps.getComm(), "st_")):
            eps.solve()
    except Exception:
        eps.incRef()
        raise
