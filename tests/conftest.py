"""What several test files share: small rods, PETSc options for one test, and runs in fresh processes."""

import contextlib
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module

import pytest
from hypothesis import settings
from scipy.sparse import csr_matrix

from isorod.geometry import center_line
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle

os.environ.setdefault("OMP_NUM_THREADS", "1")
# Ranks that wait let others run: beside other tests there are more of them than processors.
os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
# Open MPI refuses to start as root otherwise, which is what containers run as.
os.environ.setdefault("OMPI_ALLOW_RUN_AS_ROOT", "1")
os.environ.setdefault("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")

settings.register_profile("isorod", deadline=None, derandomize=True, max_examples=60, database=None)
settings.load_profile("isorod")

# What ranks that wait call to run the `isorod` command with their arguments.
ON_RANKS = "isorod.command.cli.main(sys.argv[1:])"
COMMAND = [sys.executable, "-c", "import sys; from isorod.command.cli import main; sys.exit(main())"]


def in_ci(report):
    """Make a report of what was skipped for want of a package or program one of failure where CI runs: it has them all.

    Else whole files vanish in silence with a package that an image forgot.
    """
    wanted = isinstance(report.longrepr, tuple) and re.search("could not import|is not installed", report.longrepr[2])
    if report.skipped and wanted and os.environ.get("CI"):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid}: {report.longrepr[2]}; CI must have it"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Judge files that are skipped as a whole."""
    return in_ci((yield))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Judge tests that are skipped."""
    return in_ci((yield))


def straight(
    n: int = 4, degree: int = 2, breaks: tuple[float, ...] = (0.0, 1.0), radius: float = 1.0, height: float = 1.0
) -> Rod:
    """Return a circular cylinder along z on the given breaks, of which z is a linear function of u."""
    return center_line.straight(height, breaks, degree).sweep(circle(n, radius))


@pytest.fixture
def room() -> Callable[[int], contextlib.AbstractContextManager[None]]:
    """Let no file grow beyond so many bytes, as on a disk that is full."""

    @contextlib.contextmanager
    def limit(size: int) -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Compile before the first test what is not kept: what runs print is then as it is for people, day by day."""
    from isorod import compiling

    for kernel in compiling.load_all():
        if not kernel.kept:
            _ = kernel.compiled


@pytest.fixture(scope="session")
def cylinder() -> Callable[..., Rod]:
    """`straight` as a fixture."""
    return straight


@pytest.fixture
def silent() -> Iterator[None]:
    """Make a warning an error."""
    with warnings.catch_warnings(action="error"):
        yield


@pytest.fixture
def petsc_options() -> Iterator[Callable[..., None]]:
    """Set PETSc options, as if typed by the user, for the length of one test."""
    from petsc4py import PETSc

    options, names = PETSc.Options(), []

    def put(**values: object) -> None:
        for name, value in values.items():
            options[name] = value
            names.append(name)

    yield put
    for name in names:
        options.delValue(name)


def _run(command: list[str], **keywords: object) -> subprocess.CompletedProcess[str]:
    # The environment as Python knows it: Open MPI, once started here, adds variables that would confuse another mpirun.
    keywords = {"env": dict(os.environ)} | keywords
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, **keywords)  # type: ignore


@contextlib.contextmanager
def petsc_forgets() -> Iterator[None]:
    """Take away which options PETSc was given."""

    def names() -> set[str]:
        running = sys.modules.get("petsc4py.PETSc")
        return set(running.Options().getAll()) if running else set()

    before = names()
    try:
        yield
    finally:
        for name in names() - before:
            sys.modules["petsc4py.PETSc"].Options().delValue(name)


class Command:
    """A command in this process, of the module that has its ``main``; its words may be paths and numbers."""

    def __init__(self, capsys: pytest.CaptureFixture[str], name: str, module: str) -> None:
        self._capsys, self._name, self._module = capsys, name, module

    def prints(self, *words: object) -> str:
        """Return what it prints."""
        code, out, err = self._run(words)
        assert code == 0, err
        return out

    def record(self, *words: object) -> dict:
        """Return its record, in a line of JSON."""
        return json.loads(self.prints(*words, "--json"))

    def refuses(self, *words: object) -> str:
        """Return the only line that it says where it refuses its words."""
        code, out, err = self._run(words)
        assert (code, out) == (2, ""), out
        assert re.fullmatch(rf"{self._name}: .+\n", err), err
        return err.removeprefix(f"{self._name}: ").rstrip("\n")

    def _run(self, words: tuple) -> tuple[int, str, str]:
        self._capsys.readouterr()
        with petsc_forgets():
            code = import_module(self._module).main([str(word) for word in words])
        return code, *self._capsys.readouterr()


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """Run the `isorod` command in this process."""
    return Command(capsys, "isorod", "isorod.command.cli")


@pytest.fixture
def fem(capsys: pytest.CaptureFixture[str]) -> Command:
    """Run ``python -m comparisons.fem`` in this process."""
    return Command(capsys, "comparisons.fem", "comparisons.fem.__main__")


@pytest.fixture(scope="session")
def isorod() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the `isorod` command in a fresh process."""
    return lambda *arguments, **keywords: _run([*COMMAND, *arguments], **keywords)


@pytest.fixture(scope="session")
def python() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a script in a fresh interpreter."""
    return lambda script, *arguments, **keywords: _run([sys.executable, "-c", script, *arguments], **keywords)


@pytest.fixture(scope="session")
def modules(python) -> Callable[..., set[str]]:
    """Run the command with some words, or a script, in a fresh process; return the modules it has loaded in the end."""

    def loaded(*words: str, script: str | None = None, **keywords: object) -> set[str]:
        script = script or f"from isorod.command import cli\nassert cli.main({list(words)!r}) == 0"
        done = python(f"import sys\nsys.argv[:] = ['isorod']\n{script}\nprint(*sorted(sys.modules))", **keywords)
        assert done.returncode == 0, done.stderr
        return {*done.stdout.splitlines()[-1].split()}

    return loaded


def packages(modules: set[str]) -> set[str]:
    """Return the packages that modules are of."""
    return {name.partition(".")[0] for name in modules}


@pytest.fixture(scope="session")
def launcher() -> list[str]:
    """Return the words that start ranks, but for their number."""
    # MPI may come with Python's packages: what is beside the interpreter is of the same implementation.
    program = shutil.which("mpirun", path=os.path.dirname(sys.executable)) or shutil.which("mpirun")
    if program is None:
        pytest.skip("mpirun is not installed")
    # Other implementations put more ranks than cores on a machine without being told.
    more = ["--oversubscribe"] if "Open MPI" in _run([program, "--version"]).stdout else []
    return [program, *more, "-n"]


@pytest.fixture(scope="session")
def mpirun(launcher) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a Python script, or the `isorod` command where there is none, on several ranks."""

    def run(ranks: int, *arguments: str, script: str | None = None) -> subprocess.CompletedProcess[str]:
        # First: what the wheels' PETSc asks for before it is imported.
        words = COMMAND if script is None else [sys.executable, "-c", f"import isorod\n{script}"]
        return _run([*launcher, str(ranks), *words, *arguments])

    return run


@pytest.fixture(scope="session")
def on_ranks(launcher, tmp_path_factory) -> Iterator[Callable[..., str]]:
    """Call a function on several ranks, ``on_ranks(2, "test_matrix.add_up()")``; return what they print."""
    from waiting_ranks import Ranks

    waiting: dict[int, Ranks] = {}

    def end(counts: set[int]) -> None:
        for count in counts & set(waiting):
            waiting.pop(count).end()

    def run(ranks: int, call: str, *arguments: str) -> str:
        # Most tests ask for two, which wait on; of others only those asked last: each holds the memory of a process.
        end({count for count, one in waiting.items() if not one.alive or count not in (2, ranks)})
        if ranks not in waiting:
            waiting[ranks] = Ranks(launcher, ranks, tmp_path_factory.mktemp("ranks"))
        return waiting[ranks](call, *arguments)

    yield run
    end({*waiting})


def as_array(matrix):
    """Return a PETSc matrix of one rank as a dense array of its own."""
    first, column, values = matrix.getValuesCSR()
    return csr_matrix((values, column, first), shape=matrix.getSize()).toarray()
