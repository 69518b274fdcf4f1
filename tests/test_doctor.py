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
    ("paths", "expected"),
    [
        (
            [
                "/usr/lib/x86_64-linux-gnu/openblas-serial/libblas.so.3",
                "/usr/lib/x86_64-linux-gnu/openblas-serial/libopenblas-r0.3.21.so",
            ],
            ["OpenBLAS"],
        ),
        (["/usr/lib/x86_64-linux-gnu/openblas-pthread/libopenblasp-r0.3.29.so"], ["OpenBLAS"]),
        (["/usr/lib/x86_64-linux-gnu/blas/libblas.so.3.11.0"], ["reference"]),
        (["/opt/env/lib/librefblas.so.3"], ["reference"]),
        (["/opt/env/lib/libopenblasp-r0.3.30.so", "/opt/env/lib/libmkl_rt.so.2"], ["MKL", "OpenBLAS"]),
        (
            [
                "/venv/numpy.libs/libscipy_openblas64_-56d6093b.so",
                "/usr/lib/x86_64-linux-gnu/blas/libblas.so.3.11.0",
            ],
            ["OpenBLAS", "reference"],
        ),
        (["/usr/lib/x86_64-linux-gnu/libscalapack-openmpi.so.2.2.1", "/lib/libc.so.6"], []),
    ],
)
def test_blas_is_named_from_the_libraries_in_the_process(paths, expected):
    assert doctor.blas(paths) == expected


def test_mapped_libraries_are_read_once_each_and_without_plain_files(tmp_path):
    maps = tmp_path / "maps"
    maps.write_text(
        "7f00-7f01 r--p 00000000 08:01 42 /nowhere/of a name with blanks/libx.so.1\n"
        "7f01-7f02 r-xp 00001000 08:01 42 /nowhere/of a name with blanks/libx.so.1\n"
        "7f02-7f03 rw-p 00000000 00:00 0\n"
        "7f03-7f04 r--p 00000000 08:01 43 /usr/share/locale/file\n"
        "7ffe-7fff rw-p 00000000 00:00 0 [stack]\n"
    )
    assert doctor.mapped_libraries(maps) == ["/nowhere/of a name with blanks/libx.so.1"]
    assert doctor.mapped_libraries(tmp_path / "none") == []


@pytest.mark.parametrize(("there", "said"), [("/opt/gcc", "/opt/gcc"), (None, "missing")])
def test_the_compiler_that_dolfinx_needs_is_named(there, said, monkeypatch):
    monkeypatch.setattr(doctor.shutil, "which", lambda name, path=None: there if name == "gcc" else None)
    (check,) = [check for check in doctor.report() if check.name == "C compiler"]
    assert (check.value, check.ok, "apt-get" in check.hint or "conda" in check.hint) == (said, bool(there), not there)


def test_a_compiler_without_python_headers_is_not_enough(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor.sysconfig, "get_path", lambda name: str(tmp_path))
    check = doctor._compiler()
    assert not check.ok and not check.required and "no Python.h" in check.hint


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


@pytest.mark.parametrize(("version", "ok"), [((3, 10, 9), False), ((3, 11, 0), True), ((3, 14, 1), True)])
def test_an_older_python_is_refused(version, ok, monkeypatch):
    monkeypatch.setattr(doctor.sys, "version_info", version)
    found = doctor._python()
    assert (found.ok, found.required) == (ok, True)
    assert found.hint == ("" if ok else "isorod needs 3.11")


def run():
    stream = io.StringIO()
    code = doctor.main(stream)
    return code, stream.getvalue()


def test_table_is_aligned_and_says_that_it_can_run():
    code, text = run()
    *rows, last = text.splitlines()
    assert code == 0
    assert last.startswith("isorod can run here")
    width = 2 + max(len(check.name) for check in doctor.report())
    assert all(row[width : width + 2] == "  " and row[width + 2] != " " for row in rows)


@pytest.mark.parametrize(
    ("version", "ok"),
    [
        ((2, 7, 18), False),
        ((3, 9, 19), False),
        ((3, 10, 99), False),
        ((3, 11, 0), True),
        ((3, 13, 1), True),
        ((4, 0), True),
    ],
)
def test_an_older_python_does_not_pass(monkeypatch, version, ok):
    monkeypatch.setattr(doctor, "sys", types.SimpleNamespace(version_info=version, executable="python", stdout=None))
    check = doctor._python()
    assert check.required and check.ok is ok
    assert check.hint == ("" if ok else "isorod needs 3.11")
    code, text = run()
    assert code == (0 if ok else 1)
    row = next(line for line in text.splitlines() if line[2:].startswith("Python"))
    assert row.startswith("  " if ok else "X ")


def test_the_python_that_is_asked_for_is_the_package_s():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11"


def test_a_missing_requirement_fails_and_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    code, text = run()
    row = next(line for line in text.splitlines() if line[2:].startswith("numba"))
    assert code == 1
    assert row.startswith("X ")
    assert "missing" in row
    assert "pip install numba" in row
    assert text.splitlines()[-1] == "isorod cannot run here: see numba"


def test_a_requirement_that_does_not_import_is_one_line(monkeypatch, tmp_path):
    (tmp_path / "broken_module.py").write_text("raise RuntimeError('compiled against\\nanother NumPy')")
    monkeypatch.syspath_prepend(tmp_path)
    found, check = doctor._imported("broken", "broken_module", "get it")
    assert found is None
    assert not check.ok
    assert check.value == "does not import: RuntimeError: compiled against another NumPy"


def test_a_module_from_the_user_site_is_pointed_out(monkeypatch, tmp_path):
    (tmp_path / "hiding_module.py").write_text("__version__ = '9'")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(doctor.site, "getusersitepackages", lambda: str(tmp_path))
    _, check = doctor._imported("hiding", "hiding_module", "get it")
    assert check.ok
    assert check.value == "9"
    assert "PYTHONNOUSERSITE" in check.hint


def test_a_missing_option_does_not_fail(monkeypatch):
    real = doctor.find_spec
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == "gmsh" else real(name))
    code, text = run()
    row = next(line for line in text.splitlines() if line[2:].startswith("gmsh"))
    assert code == 0
    assert row.startswith("! ")
    assert "python3-gmsh" in row
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
    assert said in text
    assert "PETSc 3.99.0" in text


def test_the_reference_blas_is_warned_of(monkeypatch):
    monkeypatch.setattr(doctor, "mapped_libraries", lambda: ["/usr/lib/x86_64-linux-gnu/blas/libblas.so.3.11.0"])
    code, text = run()
    assert code == 0
    assert "libopenblas0-serial" in text


@pytest.mark.parametrize(("threads", "ok"), [("1", True), ("2", False), (None, False)])
def test_threads_are_judged(monkeypatch, threads, ok):
    for name in doctor.THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
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
