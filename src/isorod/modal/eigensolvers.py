"""SLEPc's eigensolvers: the default options of each, and what it needs of the mass."""

from collections.abc import Mapping

from petsc4py import PETSc
from slepc4py import SLEPc

from isorod.errors import InputError
from isorod.options import defaults
from isorod.petsc.direct import room

# Defaults; the user's options override them.
OPTIONS = {"eps_tol": 1e-10, "st_type": "sinvert", "st_ksp_type": "preonly"}

# Measured on the blade: none of them reaches a tolerance below 1e-8 (LOBPCG 1e-7), and LOBPCG breaks down with blocks
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
# Eigensolvers that need a definite mass: those, which minimise Rayleigh's quotient, and LAPACK's.
DEFINITE = (*PRECONDITIONED, "lapack")

# Options with which the eigensolver still needs only products with the mass.
_HARMLESS = (
    *("eps_nev", "eps_ncv", "eps_mpd", "eps_tol", "eps_max_it", "eps_purify", "eps_krylovschur", "eps_conv"),
    *("eps_monitor", "eps_view", "eps_error", "st_ksp", "st_pc"),
)


def typed(singular: bool) -> str:
    """Return the type of eigensolver in force, for a mass that may be singular.

    Raises
    ------
    InputError
        If the mass is singular and the eigensolver needs a definite one.
    """
    options = PETSc.Options().getAll()
    kind, transformation = options.get("eps_type", "krylovschur"), options.get("st_type", "sinvert")
    option = None
    if kind in DEFINITE:
        option, instead = f"-eps_type {kind}", "krylovschur"
    elif transformation != "sinvert":
        option, instead = f"-st_type {transformation}", "sinvert"
    if singular and option is not None:
        raise InputError(
            f"{option}: needs a definite mass matrix, the mixed formulation's is singular; use {instead}, the default"
        )
    return str(kind)


def offered(kind: str, others: Mapping[str, object]) -> Mapping[str, object]:
    """Return default options of a type of eigensolver; ``others`` suit those with a spectral transformation."""
    if kind not in PRECONDITIONED:
        return {**OPTIONS, **others}
    options = PRECONDITIONED_OPTIONS | (LOBPCG_OPTIONS if kind == "lobpcg" else {})
    if PETSc.Options().getAll().get("st_pc_type", "cholesky") in ("lu", "cholesky"):
        return options
    return {name: value for name, value in options.items() if not name.startswith("st_pc_")}


def only_multiplies() -> bool:
    """Return whether the eigensolver needs only products with the mass, as the default with a shift of zero does."""
    typed = (name for name in PETSc.Options().getAll() if name.startswith(("eps_", "st_")))
    return all(name.startswith(_HARMLESS) for name in typed)


def solve(eps: SLEPc.EPS) -> None:
    """Solve; after an error the object is leaked, since newer SLEPc fails again on destroying it."""
    try:
        with defaults(room(eps.getComm(), "st_")):
            eps.solve()
    except Exception:
        eps.incRef()
        raise
