import io
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import numba
import numpy
import pytest
import scipy
from petsc4py import PETSc

from isorod.command import doctor


@pytest.mark.parametrize(
    ("paths", "slow"),
    [
        (["/usr/lib/x86_64-linux-gnu/openblas-serial/libblas.so.3"], False),
        (["/usr/lib/x86_64-linux-gnu/openblas-pthread/libopenblasp-r0.3.29.so", "/nowhere/blas text"], False),
        (["/usr/lib/x86_64-linux-gnu/blas/libblas.so.3.11.0"], True),
        (["/opt/a name with blanks/librefblas.so.3"], True),
        (["/venv/numpy.libs/libscipy_openblas64_-56d6093b.so", "/usr/lib/blas/libblas64.so.3"], True),
        (["/usr/lib/x86_64-linux-gnu/libscalapack-openmpi.so.2.2.1", "/lib/libc.so.6"], False),
        ([], False),
    ],
)
def test_the_reference_blas_is_known_by_the_libraries_in_the_process(paths, slow):
    lines = [f"7f00-7f01 r--p 00000000 08:01 42 {path}" for path in paths]
    assert doctor.reference_blas("\n".join(["7f02-7f03 rw-p 00000000 00:00 0", *lines])) is slow


@pytest.mark.parametrize(("there", "headers"), [(True, True), (True, False), (False, True)])
def test_the_compiler_that_dolfinx_needs_is_named(there, headers, monkeypatch, tmp_path):
    monkeypatch.setattr(doctor.shutil, "which", lambda name: "/opt/gcc" if there and name == "gcc" else None)
    monkeypatch.setattr(doctor.sysconfig, "get_path", lambda name: str(tmp_path))
    if headers:
        (tmp_path / "Python.h").touch()
    check = doctor._compiler()
    assert (check.value, check.ok) == ("/opt/gcc" if there else "missing", there and headers)
    assert ("Python.h" in check.hint) is not check.ok and not check.required


def test_report_has_all_that_isorod_uses_and_what_it_cannot_do_without():
    checks = {check.name: check for check in doctor.report()}
    required = ["isorod", "Python", "numpy", "scipy", "numba", "MPI", "petsc4py", "PETSc scalar, index"]
    assert [name for name, check in checks.items() if check.required] == required
    assert {"slepc4py", "dolfinx", "gmsh", "pyvista", "matplotlib", "BLAS", "threads"} < checks.keys()
    # These tests run in an interpreter that has them.
    for module in (numpy, scipy, numba):
        assert checks[module.__name__].value == module.__version__
    scalar, index = PETSc.ScalarType.__name__, PETSc.IntType.__name__
    assert checks["PETSc scalar, index"].value == f"{scalar}, {index}"


def run():
    stream = io.StringIO()
    code = doctor.main(stream)
    return code, stream.getvalue()


def row(text, name):
    return next(line for line in text.splitlines() if line[2:].startswith(name))


def test_table_is_aligned_and_says_that_it_can_run():
    code, text = run()
    *rows, last = text.splitlines()
    assert code == 0
    assert last.startswith("isorod can run here")
    width = 2 + max(len(check.name) for check in doctor.report())
    assert all(line[width : width + 2] == "  " and line[width + 2] != " " for line in rows)


@pytest.mark.parametrize(("version", "ok"), [((3, 10, 99), False), ((3, 11, 0), True), ((4, 0), True)])
def test_an_older_python_does_not_pass(monkeypatch, version, ok):
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11"
    monkeypatch.setattr(doctor, "sys", types.SimpleNamespace(version_info=version, executable="python", stdout=None))
    code, text = run()
    assert code == (0 if ok else 1)
    assert row(text, "Python").startswith("  " if ok else "X ")
    assert ("isorod needs 3.11" in text) is not ok


def test_a_missing_requirement_fails_and_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    code, text = run()
    line = row(text, "numba")
    assert code == 1 and line.startswith("X ") and "missing" in line and "pip install numba" in line
    assert text.splitlines()[-1] == "isorod cannot run here: see numba"


def test_a_requirement_that_does_not_import_is_one_line(monkeypatch, tmp_path):
    (tmp_path / "broken_module.py").write_text("raise RuntimeError('compiled against\\nanother NumPy')")
    monkeypatch.syspath_prepend(tmp_path)
    found, check = doctor._imported("broken_module", "get it")
    assert found is None and not check.ok
    assert check.value == "does not import: RuntimeError: compiled against another NumPy"


def test_a_missing_option_does_not_fail(monkeypatch):
    real = doctor.find_spec
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == "gmsh" else real(name))
    code, text = run()
    line = row(text, "gmsh")
    assert code == 0 and line.startswith("! ") and "python3-gmsh" in line
    assert "gmsh" in text.splitlines()[-1]


def petsc(scalar, packages):
    """A PETSc that was built otherwise."""
    fake = types.ModuleType("petsc4py.PETSc")
    fake.ScalarType, fake.IntType = type(scalar, (), {}), type("int32", (), {})
    fake.Sys = types.SimpleNamespace(getVersion=lambda: (3, 99, 0), hasExternalPackage=packages.__contains__)
    return fake


@pytest.mark.parametrize(
    ("scalar", "packages", "code", "said"),
    [
        ("complex128", {"mumps"}, 1, "isorod needs a real PETSc"),
        ("float64", {"superlu_dist"}, 0, "no MUMPS"),
    ],
)
def test_what_petsc_was_built_with_is_judged(monkeypatch, scalar, packages, code, said):
    monkeypatch.setitem(sys.modules, "petsc4py.PETSc", petsc(scalar, packages))
    result, text = run()
    assert result == code
    assert f"{scalar}, int32" in row(text, "PETSc scalar, index")
    assert ("MUMPS" if "mumps" in packages else "PETSc's own only") in row(text, "direct solvers")
    assert said in text
    assert "PETSc 3.99.0" in text


def test_the_reference_blas_is_warned_of(monkeypatch):
    monkeypatch.setattr(doctor, "reference_blas", lambda maps: True)
    code, text = run()
    assert code == 0
    assert "libopenblas0-serial" in text


@pytest.mark.parametrize(("threads", "ok"), [("1", True), ("2", False), (None, False)])
def test_threads_are_judged(monkeypatch, threads, ok):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if threads is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
    check = doctor._threads()
    assert check.ok is ok
    assert bool(check.hint) is not ok


def test_nothing_heavy_is_imported():
    heavy = ["dolfinx", "gmsh", "pyvista", "vtk", "matplotlib", "slepc4py.SLEPc"]
    code = (
        "import io, sys; from isorod.command import doctor; assert doctor.main(io.StringIO()) == 0;"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path("/"))
    assert found.stdout.strip() == "[]"
