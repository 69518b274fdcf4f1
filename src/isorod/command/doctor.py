"""What is installed here, what is missing, and how to get it: the command ``isorod doctor``.

Required modules are imported, because only an import proves that they work; optional ones are looked up and never
imported, so that this runs in a second and cannot be brought down by them.
"""

import os
import platform
import re
import shutil
import sys
import sysconfig
from contextlib import suppress
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import isorod

_PIP = "pip install 'isorod[compare]' (docker/install does)"


class Check(NamedTuple):
    """One line of the report: ``ok`` is what decides the exit code where ``required``."""

    name: str
    value: str
    ok: bool = True
    hint: str = ""
    required: bool = False


def _get(debian: str, conda: str, wheels: bool = False) -> str:
    """Return how to get packages; with ``wheels`` also those that PyPI has for Python 3.12 and later."""
    pip = "pip install 'isorod[wheels]' or " if wheels else ""
    return f"Debian: apt install {debian}; elsewhere: {pip}conda install -c conda-forge {conda}"


# How to get the modules that have to be there; Debian's own numba may be too old.
_REQUIRED = {
    "numpy": _get("python3-numpy", "numpy"),
    "scipy": _get("python3-scipy", "scipy"),
    "numba": "pip install numba (docker/install does)",
    "mpi4py.MPI": _get("openmpi-bin python3-mpi4py", "openmpi mpi4py", wheels=True),
    "petsc4py.PETSc": _get("python3-petsc4py-real", "petsc4py", wheels=True),
}

# What the others are for and how to get them; Debian's gmsh and slepc4py are no distributions that have a version.
_OPTIONAL = {
    "slepc4py": f"for modal analysis and buckling; {_get('python3-slepc4py-real', 'slepc4py', wheels=True)}",
    "dolfinx": f"for comparisons; {_get('python3-dolfinx-real', 'fenics-dolfinx', wheels=True)}",
    "gmsh": f"for meshes; {_get('python3-gmsh', 'python-gmsh', wheels=True)}",
    "pyvista": f"for pictures; {_PIP}",
    "vtk": f"for pictures; {_PIP}",
    "matplotlib": f"for plots; {_PIP}",
    "rich": f"for progress; {_PIP}",
    "trame": "for isorod view; pip install 'isorod[view]' (docker/install does)",
}


def _python() -> Check:
    ok = sys.version_info >= (3, 11)
    hint = "" if ok else "isorod needs 3.11"
    return Check("Python", f"{platform.python_version()} ({sys.executable})", ok, hint, required=True)


def _imported(module: str, get: str) -> tuple[Any, Check]:
    """Return a module, None if it does not import, and its line: its version, or what is wrong."""
    name = module.partition(".")[0]
    try:
        module_object = import_module(module)
    except Exception as error:  # a broken install raises anything
        missing = isinstance(error, ModuleNotFoundError) and module.startswith(error.name or module)
        why = " ".join(f"does not import: {type(error).__name__}: {error}".split())[:180]
        return None, Check(name, "missing" if missing else why, False, get, required=True)
    return module_object, Check(name, getattr(module_object, "__version__", "?"), required=True)


def _mpi(module: Any, check: Check) -> Check:
    """Return whose MPI it is, and whether mpirun is there."""
    vendor, version = module.get_vendor()
    # Beside the interpreter is what came with Python's packages.
    run = shutil.which("mpirun", path=os.path.dirname(sys.executable)) or shutil.which("mpirun")
    hint = "" if run else f"no mpirun: one rank only; {_REQUIRED['mpi4py.MPI']}"
    value = f"{vendor} {'.'.join(map(str, version))}" + (f" ({run})" if run else "")
    return check._replace(name="MPI", value=value, hint=hint)


def _petsc(petsc: Any, check: Check) -> list[Check]:
    """Return what PETSc was built with."""
    version = ".".join(map(str, petsc.Sys.getVersion()))
    place = import_module("petsc4py").get_config().get("PETSC_DIR") or "no PETSC_DIR"
    scalar = petsc.ScalarType.__name__
    real = not scalar.startswith("complex")
    complaint = "" if real else f"isorod needs a real PETSc; {_get('python3-petsc4py-real', 'petsc=*=*real*')}"
    mumps = petsc.Sys.hasExternalPackage("mumps")
    alone = "" if mumps else "no MUMPS: direct solves run on one rank only; take Debian's or conda-forge's PETSc"
    return [
        check._replace(value=f"PETSc {version} ({place})"),
        Check("PETSc scalar, index", f"{scalar}, {petsc.IntType.__name__}", real, complaint, required=True),
        Check("direct solvers", "MUMPS" if mumps else "PETSc's own only", mumps, alone),
    ]


def reference_blas(maps: str) -> bool:
    """Return whether the reference BLAS is among the libraries in a process, as ``/proc/self/maps`` lists them."""
    # Debian's OpenBLAS lies in openblas-*/libblas.so too.
    paths = {line.split(maxsplit=5)[-1] for line in maps.splitlines() if "openblas" not in line}
    return any(re.search(r"/lib(ref)?blas(64)?\.so", os.path.realpath(path)) for path in paths)


def _blas() -> Check:
    """Check that the BLAS at work is not the reference implementation."""
    maps = ""
    # Elsewhere there is no such file, and SciPy has a line of its own.
    with suppress(Exception):
        import_module("scipy.linalg.cython_blas")
        maps = Path("/proc/self/maps").read_text(errors="replace")
    slow = reference_blas(maps)
    hint = f"it makes MUMPS about 4 times slower; {_get('libopenblas0-serial', 'libblas=*=*openblas')}" if slow else ""
    return Check("BLAS", "reference" if slow else "optimised" if maps else "unknown", not slow, hint)


def _threads() -> Check:
    value = os.environ.get("OMP_NUM_THREADS")
    hint = "" if value == "1" else "set OMP_NUM_THREADS=1 for timings and for mpirun (make does)"
    return Check("threads", value or f"not set ({os.cpu_count()} cores)", value == "1", hint)


def _compiled() -> Check:
    """Return where compiled code is kept, whether that can be written to, and how much of it is there."""
    try:
        from isorod import compiling, keeping

        kernels = compiling.load_all()
    except Exception:  # what is missing has a line of its own
        return Check("compiled code", "unknown")
    count, lasting = sum(kernel.kept for kernel in kernels), keeping.lasting()
    value = f"{count} of {len(kernels)} functions, in {keeping.room() if lasting else 'no folder that lasts'}"
    if count == len(kernels):
        return Check("compiled code", value)
    return Check("compiled code", value, lasting, "'isorod compile' compiles all" if lasting else compiling.HINT)


def _optional(module: str, hint: str) -> Check:
    """Look a module up without importing it."""
    with suppress(Exception):
        if find_spec(module) is not None:
            with suppress(metadata.PackageNotFoundError):
                return Check(module, metadata.version("fenics-dolfinx" if module == "dolfinx" else module))
            return Check(module, "present")
    return Check(module, "missing", False, hint)


def _compiler() -> Check:
    """Check what dolfinx compiles its forms with."""
    compiler = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    headers = (Path(sysconfig.get_path("include")) / "Python.h").is_file()
    ok = compiler is not None and headers
    hint = "" if ok else f"with Python.h, for dolfinx; {_get('gcc libc6-dev python3-dev', 'c-compiler')}"
    return Check("C compiler", compiler or "missing", ok, hint)


def report() -> list[Check]:
    """Return the lines of everything isorod uses, in the order they are printed."""
    modules = [_imported(module, get) for module, get in _REQUIRED.items()]
    *plain, (mpi, mpi_check), (petsc, petsc_check) = modules
    return [
        Check("isorod", f"{isorod.__version__} ({Path(isorod.__file__).parent})", required=True),
        _python(),
        *(check for _, check in plain),
        _mpi(mpi, mpi_check) if mpi else mpi_check,
        *(_petsc(petsc, petsc_check) if petsc else [petsc_check]),
        *(_blas(), _threads(), _compiled()),
        *(_optional(module, hint) for module, hint in _OPTIONAL.items()),
        _compiler(),
    ]


def main(stream: TextIO | None = None) -> int:
    """Print the report as an aligned table, on standard output if no stream is given.

    Return 0 if everything required is here, 1 otherwise.
    """
    checks = report()
    width = max(len(check.name) for check in checks)
    for name, value, ok, hint, required in checks:
        mark = "  " if ok and not hint else "! " if ok or not required else "X "
        print(f"{mark}{name:<{width}}  {value}" + (f"  <- {hint}" if hint else ""), file=stream)
    broken = ", ".join(check.name for check in checks if check.required and not check.ok)
    missing = ", ".join(check.name for check in checks if not check.required and not check.ok)
    if broken:
        print(f"isorod cannot run here: see {broken}", file=stream)
    else:
        print("isorod can run here" + (f"; worth a look: {missing}" if missing else ""), file=stream)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
