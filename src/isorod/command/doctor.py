"""What is installed here, what is missing, and how to get it: the command ``isorod doctor``.

Required modules (NumPy, SciPy, numba, mpi4py, petsc4py) are imported, because only an import proves that they work;
optional ones are looked up and never imported, so that this runs in a second and cannot be brought down by them.
"""

import os
import platform
import re
import shutil
import site
import sys
import sysconfig
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import isorod

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
DIRECT_SOLVERS = {"mumps": "MUMPS", "superlu_dist": "SuperLU_DIST"}

# What brings PETSc, SLEPc, MPI, dolfinx and gmsh in a venv, for Python 3.12 or later.
_WHEELS = "pip install 'isorod[wheels]' or "
_PIP = "pip install 'isorod[compare]' (docker/install does)"

# In the path of a shared library, real names of files.
_BLAS = {"MKL": r"/libmkl_", "BLIS": r"/libblis\b|/blis-", "ATLAS": "atlas", "reference": r"/lib(ref)?blas(64)?\.so"}


class Check(NamedTuple):
    """One line of the report: ``ok`` is what decides the exit code where ``required``."""

    name: str
    value: str
    ok: bool
    hint: str = ""
    required: bool = True


def _get(debian: str, conda: str, wheels: str = "") -> str:
    return f"Debian: apt install {debian}; elsewhere: {wheels}conda install -c conda-forge {conda}"


def _python() -> Check:
    ok = sys.version_info >= (3, 11)
    return Check("Python", f"{platform.python_version()} ({sys.executable})", ok, "" if ok else "isorod needs 3.11")


def _imported(name: str, module: str, get: str) -> tuple[Any, Check]:
    """Return a module, None if it does not import, and its line: its version, or what is wrong."""
    try:
        found = import_module(module)
    except Exception as error:  # a broken install raises anything
        if isinstance(error, ModuleNotFoundError) and module.startswith(error.name or module):
            return None, Check(name, "missing", False, get)
        why = " ".join(f"{type(error).__name__}: {error}".split())[:160]
        return None, Check(name, f"does not import: {why}", False, get)
    place = site.getusersitepackages()
    hides = str(getattr(found, "__file__", "")).startswith(place)
    hint = f"taken from {place}; set PYTHONNOUSERSITE=1 to use the environment's" if hides else ""
    return found, Check(name, getattr(found, "__version__", "?"), True, hint)


def _petsc() -> list[Check]:
    """petsc4py and what its PETSc was built with."""
    petsc, check = _imported("petsc4py", "petsc4py.PETSc", _get("python3-petsc4py-real", "petsc4py", _WHEELS))
    if petsc is None:
        return [check]
    version = ".".join(map(str, petsc.Sys.getVersion()))
    place = import_module("petsc4py").get_config().get("PETSC_DIR") or "no PETSC_DIR"
    scalar = petsc.ScalarType.__name__
    real = not scalar.startswith("complex")
    complaint = f"isorod needs a real PETSc; {_get('python3-petsc4py-real', 'petsc=*=*real*')}"
    solvers = [label for name, label in DIRECT_SOLVERS.items() if petsc.Sys.hasExternalPackage(name)]
    alone = "no MUMPS: direct solves run on one rank only; take Debian's or conda-forge's PETSc"
    mumps = "MUMPS" in solvers
    return [
        check._replace(value=f"PETSc {version} ({place})"),
        Check("PETSc scalar, index", f"{scalar}, {petsc.IntType.__name__}", real, "" if real else complaint),
        Check("direct solvers", ", ".join(solvers) or "PETSc's own only", mumps, "" if mumps else alone, False),
    ]


def _mpi() -> Check:
    """Check mpi4py, whose MPI it is, and that mpirun is there."""
    get = _get("openmpi-bin python3-mpi4py", "openmpi mpi4py", _WHEELS)
    mpi, check = _imported("MPI", "mpi4py.MPI", get)
    if mpi is None:
        return check
    vendor, version = mpi.get_vendor()
    # Beside the interpreter is the one that came with Python's packages.
    run = shutil.which("mpirun", path=os.path.dirname(sys.executable)) or shutil.which("mpirun")
    hint = "" if run else f"no mpirun: one rank only; {get}"
    return Check("MPI", f"{vendor} {'.'.join(map(str, version))}" + (f" ({run})" if run else ""), True, hint)


def blas(paths: Iterable[str]) -> list[str]:
    """Return the names of the BLAS libraries among the files mapped into a process, sorted.

    ``paths`` are real ones of shared libraries, as in ``/proc/self/maps``.
    """
    # Debian's OpenBLAS lies in libblas.so too.
    named = {name for path in paths if "openblas" not in path for name, one in _BLAS.items() if re.search(one, path)}
    return sorted(named | {"OpenBLAS" for path in paths if "openblas" in path})


def mapped_libraries(maps: Path = Path("/proc/self/maps")) -> list[str]:
    """Return the shared libraries in this process by a file such as ``/proc/self/maps``; none where there is none."""
    try:
        lines = maps.read_text(errors="replace").splitlines()
    except OSError:
        return []
    fields = (line.split(maxsplit=5) for line in lines)
    return sorted({os.path.realpath(f[5]) for f in fields if len(f) == 6 and ".so" in f[5]})


def _blas() -> Check:
    """Check that the BLAS at work is not the reference one."""
    with suppress(Exception):  # reported by the check of SciPy
        import_module("scipy.linalg.cython_blas")
    found = blas(mapped_libraries())
    slow = "reference" in found
    get = _get("libopenblas0-serial", "libblas=*=*openblas")
    hint = f"the reference BLAS makes MUMPS about 4 times slower; {get}" if slow else ""
    return Check("BLAS", ", ".join(found) or "unknown", not slow, hint, required=False)


def _threads() -> Check:
    value = " ".join(f"{name}={os.environ[name]}" for name in THREAD_VARIABLES if name in os.environ)
    fair = os.environ.get("OMP_NUM_THREADS") == "1"
    hint = "" if fair else "set OMP_NUM_THREADS=1 for timings and for mpirun (make does)"
    return Check("threads", value or f"not set ({os.cpu_count()} cores)", fair, hint, required=False)


def _compiled() -> Check:
    """Say where compiled code is kept, whether that can be written to, and how much of it is there."""
    name = "compiled code"
    try:
        from isorod import compiling

        kernels = compiling.load_all()
    except Exception:  # what is missing has a line of its own
        return Check(name, "unknown", True, required=False)
    there = sum(kernel.kept for kernel in kernels)
    lasting = all(kernel.lasting for kernel in kernels)
    place = next((found for kernel in kernels if (found := compiling.place(kernel))), "nowhere")
    value = f"{there} of {len(kernels)} functions, in {place}" + ("" if lasting else " (read-only)")
    if there < len(kernels):
        return Check(name, value, lasting, "'isorod compile' compiles all ahead" if lasting else compiling.HINT, False)
    return Check(name, value, True, required=False)


def _optional(module: str, distributions: str, hint: str, used_for: str) -> Check:
    """Look a module up without importing it; it comes with one of the distributions."""
    spec = None
    with suppress(Exception):
        spec = find_spec(module)
    if spec is None:
        return Check(module, "missing", False, f"for {used_for}; {hint}", required=False)
    for distribution in distributions.split():
        with suppress(metadata.PackageNotFoundError):
            return Check(module, metadata.version(distribution), True, required=False)
    # Debian's gmsh and slepc4py are no distributions.
    return Check(module, "present", True, required=False)


def _compiler() -> Check:
    found = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    if found is None:
        return Check("C compiler", "missing", False, f"for dolfinx; {_get('gcc libc6-dev', 'c-compiler')}", False)
    headers = (Path(sysconfig.get_path("include")) / "Python.h").is_file()
    hint = "" if headers else f"no Python.h, for dolfinx; {_get('python3-dev', 'python')}"
    return Check("C compiler", found, headers, hint, required=False)


def report() -> list[Check]:
    """Return the lines of everything isorod uses, in the order they are printed."""
    # Debian's own numba may be too old for the kernels; pip's is the one that docker/constraints.txt holds.
    numba = "pip install numba (docker/install does)"
    slepc = _get("python3-slepc4py-real", "slepc4py", _WHEELS)
    dolfinx = _get("python3-dolfinx-real", "fenics-dolfinx", _WHEELS)
    return [
        Check("isorod", f"{isorod.__version__} ({Path(isorod.__file__).parent})", True),
        _python(),
        _imported("numpy", "numpy", _get("python3-numpy", "numpy"))[1],
        _imported("scipy", "scipy", _get("python3-scipy", "scipy"))[1],
        _imported("numba", "numba", numba)[1],
        _mpi(),
        *_petsc(),
        _blas(),
        _threads(),
        _compiled(),
        _optional("slepc4py", "slepc4py", slepc, "modal analysis"),
        _optional("dolfinx", "fenics-dolfinx dolfinx-solver-real", dolfinx, "comparisons"),
        _compiler(),
        _optional("gmsh", "gmsh", _get("python3-gmsh", "python-gmsh", _WHEELS), "meshes"),
        *(_optional(one, one, _PIP, "pictures") for one in ("pyvista", "vtk")),
        _optional("matplotlib", "matplotlib", _PIP, "plots"),
        _optional("rich", "rich", _PIP, "progress"),
    ]


def main(stream: TextIO | None = None) -> int:
    """Print the report as an aligned table, on standard output if no stream is given.

    Return 0 if everything required is here, 1 otherwise.
    """
    stream = sys.stdout if stream is None else stream
    checks = report()
    width = max(len(check.name) for check in checks)
    for name, value, ok, hint, required in checks:
        mark = "  " if ok and not hint else "! " if ok or not required else "X "
        print(f"{mark}{name:<{width}}  {value}" + (f"  <- {hint}" if hint else ""), file=stream)
    broken = [check.name for check in checks if check.required and not check.ok]
    missing = [check.name for check in checks if not check.required and not check.ok]
    if broken:
        print(f"isorod cannot run here: see {', '.join(broken)}", file=stream)
    else:
        print("isorod can run here" + (f"; worth a look: {', '.join(missing)}" if missing else ""), file=stream)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
