"""When functions are compiled, where that is kept, and what is said of it."""

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from numba import types

from isorod import compiling

ROOT = Path(__file__).parent.parent
HOUSE = ROOT / "src" / "isorod"

# The smallest compiled function, called; then whether numba compiled anything.
SMALL = """
import numpy as np
from isorod.compiled import cofactors
g = np.empty((3, 3))
print(cofactors(2.0 * np.eye(3), g), g[0, 0])
"""

# A function that calls others: a solve with the factors of a diagonal matrix, one by the inverse of a block of them.
CALLS = """
import numpy as np
from isorod.petsc import band_kernel as kernel
print(kernel._multiply.kept, kernel.forward.kept)
_ = kernel._multiply.compiled
x = np.array([6.0, 4.0, 2.0])
band, cut, inverse = np.array([[2.0, 0.0], [2.0, 0.0], [4.0, 0.0]]), np.array([0, 2, 3]), np.array([[[0.25]]])
kernel.forward(band, cut, cut[1:], np.array([1]), inverse, x)
print(x.tolist())
"""

# Counts what numba compiles, its own functions too, in a run of the command.
COUNTED = """
import sys
from numba.core import event
class Count(event.Listener):
    names = []
    def on_start(self, found):
        function = found.data["dispatcher"].py_func
        self.names.append(f"{function.__module__}.{function.__qualname__}")
    def on_end(self, found): pass
event.register("numba:compile", Count())
from isorod.command.cli import main
for line in sys.argv[1:]:
    assert main(line.split()) == 0
print("compiled", len(Count.names), Count.names)
"""
SHORT = (
    "run spring --coils 1",
    "run spring --coils 1 --nu 0.5 --formulation mixed --elements-per-turn 8",
    "run blade --modes 2 --elements 4",
    "run blade --modes 2 --section-degree 3 --elements 2",
    "run biceps --end-time 2e-4 --outputs 1",
    "run biceps --end-time 4e-4 --outputs 1 --integrator implicit --time-step 2e-4",
)


def environment(**more: str) -> dict[str, str]:
    """Return this process's without a folder for compiled code."""
    return {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | more


@pytest.fixture
def tree():
    """A copy of the package that is in nobody's way and that any user may read."""
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(HOUSE, folder / "isorod", ignore=shutil.ignore_patterns("__pycache__"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def barred(tree: Path) -> dict[str, str]:
    """Return an environment in which nothing can be kept, for the administrator neither: files stand where folders
    would.
    """
    for folder in [tree / "isorod", *(path for path in (tree / "isorod").rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()
    return environment(PYTHONPATH=str(tree), HOME="/dev/null", XDG_CACHE_HOME="/dev/null", PYTHONDONTWRITEBYTECODE="1")


def test_all_functions_are_compiled_on_demand():
    """numba's own decorator would compile at import, and raise where nothing can be kept."""
    for file in HOUSE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("numba"):
                assert not {one.name for one in node.names} & {"njit", "jit"}, file


def test_after_compile_runs_compile_nothing(isorod, python):
    """Of the command's first run nothing is asked: the functions may have been there."""
    done = isorod("compile")
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"isorod: \d+ functions compiled in \d+ s, \d+ cached before; kept in .+\n", done.stdout)
    done = python(COUNTED, "compile", *SHORT)
    assert done.stdout.startswith("isorod: 0 functions compiled")
    assert done.stdout.splitlines()[-1] == "compiled 0 []", done.stdout[-500:] + done.stderr
    assert "compiling" not in done.stderr


def test_a_run_that_compiles_says_so_once(python, tmp_path):
    first = python(SMALL, env=environment(NUMBA_CACHE_DIR=str(tmp_path)))
    assert first.stdout == "8.0 4.0\n"
    assert re.fullmatch(rf"isorod: compiling \(once, .*; kept in {tmp_path}\)\n", first.stderr)
    assert [path.suffix for path in sorted(tmp_path.rglob("*.cofactors*.nb?"))] == [".nbc", ".nbi"]
    second = python(SMALL, env=environment(NUMBA_CACHE_DIR=str(tmp_path)))
    assert (second.stdout, second.stderr) == (first.stdout, "")
    # Files that are cut short, or cannot be read, are made anew.
    (file,) = tmp_path.rglob("*.cofactors*.nbi")
    file.write_bytes(file.read_bytes()[:20])
    for damaged in (True, False):
        done = python(SMALL, env=environment(NUMBA_CACHE_DIR=str(tmp_path)))
        assert (done.returncode, done.stdout) == (0, "8.0 4.0\n"), done.stderr
        assert "Traceback" not in done.stderr
        if damaged:
            file.unlink()
            file.mkdir()


# Begins, and compiles, when it is told.
TOLD = "import sys\nfrom isorod.compiled import cofactors\nprint('ready', flush=True)\nsys.stdin.readline()" + SMALL


def test_of_processes_that_need_the_same_function_one_compiles(tmp_path):
    several = [
        subprocess.Popen(
            [sys.executable, "-c", TOLD],
            env=environment(NUMBA_CACHE_DIR=str(tmp_path)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    for one in several:
        assert one.stdout is not None and one.stdout.readline() == "ready\n"
    for one in several:
        assert one.stdin is not None
        one.stdin.write("go\n")
        one.stdin.flush()
    told = [one.communicate(timeout=60) for one in several]
    assert [out for out, _ in told] == ["8.0 4.0\n"] * 3
    assert sum("compiling" in problems for _, problems in told) == 1


# What a run has another process compile, where that is not begun.
SHARED = """
import subprocess
from isorod import compiling, statics
class Begun:
    def __init__(self, command, **files): print(*command[1:])
    def terminate(self): print("ended")
subprocess.Popen = Begun
compiling.share()
"""


def test_a_first_run_shares_what_there_is_to_compile(python, tmp_path):
    """The last module first; on ranks the first alone shares, and nothing is shared where all is kept."""
    empty = environment(NUMBA_CACHE_DIR=str(tmp_path))
    begun, ended = python(SHARED, env=empty).stdout.splitlines()
    option, command, *modules = begun.split()
    assert (option, command, ended) == ("-m", "isorod.command.compile", "ended")
    assert modules.index("isorod.assembly.field_kernel") < modules.index("isorod.compiled")
    assert len(modules) == len(set(modules)) > 10
    assert python(SHARED, env=empty | {"OMPI_COMM_WORLD_RANK": "1"}).stdout == ""
    alone = "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])\n"
    assert python(alone + SHARED, env=empty).stdout == ""


def test_a_run_looks_for_something_to_share_when_it_first_compiles(python, tmp_path):
    run = (
        "import os\nfrom isorod import compiling\nfrom isorod.command.cli import main\n"
        "compiling.share = lambda: os._exit(7)\nmain(['run', 'blade'])"
    )
    kept = environment(NUMBA_CACHE_DIR=str(tmp_path))
    assert python(run, env=kept).returncode == 7
    small = "from isorod import compiling\ncompiling.NOTICE.shares = True\ncompiling.share = lambda: print('shared')\n"
    for said in ("shared\n", ""):
        assert python(small + SMALL, env=kept).stdout == said + "8.0 4.0\n"


def test_the_other_process_keeps_what_modules_have(tmp_path):
    command = [sys.executable, "-m", "isorod.command.compile", "isorod.compiled"]
    done = subprocess.run(command, env=environment(NUMBA_CACHE_DIR=str(tmp_path)), capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
    assert [path.suffix for path in sorted(tmp_path.rglob("*.cofactors*.nb?"))] == [".nbc", ".nbi"]


def test_only_the_first_rank_says_so(python, tmp_path):
    done = python(SMALL, env=environment(NUMBA_CACHE_DIR=str(tmp_path), OMPI_COMM_WORLD_RANK="1"))
    assert (done.stdout, done.stderr) == ("8.0 4.0\n", "")


def test_where_nothing_can_be_kept_it_runs_all_the_same(tree, python):
    without = barred(tree)
    done = python(SMALL, env=without)
    assert (done.returncode, done.stdout) == (0, "8.0 4.0\n"), done.stderr
    assert re.fullmatch(r"isorod: compiling \(.*each time: .*set NUMBA_CACHE_DIR.*\)\n", done.stderr)
    refused = python("from isorod.command.cli import main\nprint(main(['compile']))\nmain(['doctor'])", env=without)
    assert refused.stdout.startswith("2\n")
    assert re.fullmatch(r"isorod: compile: .*set NUMBA_CACHE_DIR.*\n", refused.stderr)
    row = next(line for line in refused.stdout.splitlines() if "compiled code" in line)
    assert re.search(r"^! compiled code +0 of \d+ functions, in no folder .*set NUMBA_CACHE_DIR", row)


def other_user() -> dict[str, object]:
    """Return how a process is started that may not write what this one writes."""
    if os.getuid() != 0:
        return {}
    other: dict[str, object] = {"user": 65534, "group": 65534, "extra_groups": []}
    try:
        subprocess.run([sys.executable, "-c", ""], check=True, **other)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("other users may not enter the folder of this interpreter")
    return other


def test_what_an_administrator_has_compiled_others_read(tree):
    """Beside the source, where they cannot write."""
    command = [sys.executable, "-c", SMALL]
    alone = environment(PYTHONPATH=str(tree), HOME="/dev/null", XDG_CACHE_HOME="/dev/null")
    keywords = {"capture_output": True, "text": True, "timeout": 60, "cwd": tree}
    assert "kept in" in subprocess.run(command, env=alone, **keywords).stderr
    folders = [path for path in tree.rglob("*") if path.is_dir()]
    for folder in folders:
        folder.chmod(0o555)
    done = subprocess.run(command, env=alone, **keywords, **other_user())
    for folder in folders:
        folder.chmod(0o755)
    assert (done.stdout, done.stderr) == ("8.0 4.0\n", "")


def test_another_user_keeps_it_in_the_folder_of_their_own(tree):
    """Where the package's cannot be written to and has nothing."""
    own = Path(tempfile.mkdtemp())
    own.chmod(0o777)
    folders = [tree / "isorod", *(path for path in (tree / "isorod").rglob("*") if path.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    done = subprocess.run(
        [sys.executable, "-c", SMALL],
        env=environment(PYTHONPATH=str(tree), HOME=str(own), XDG_CACHE_HOME=str(own)),
        **{"capture_output": True, "text": True, "timeout": 60, "cwd": tree},
        **other_user(),
    )
    for folder in folders:
        folder.chmod(0o755)
    kept = list(own.rglob("*.cofactors*.nbc"))
    shutil.rmtree(own)
    assert done.stdout == "8.0 4.0\n" and f"kept in {own}" in done.stderr
    assert len(kept) == 1


def test_the_doctor_counts_what_is_there(python, tmp_path):
    kept = environment(NUMBA_CACHE_DIR=str(tmp_path))
    python(SMALL, env=kept)
    # Of laws that this process has made from their energies it knows nothing. Importing compiles and reads nothing.
    script = "from isorod import compiling; every = compiling.load_all(); print(len(every))\n"
    script += "print(sum('compiled' in vars(one) for one in every))\n"
    done = python(script + "from isorod.command.cli import main; main(['doctor'])", env=kept)
    count, compiled, *lines = done.stdout.splitlines()
    assert compiled == "0"
    row = next(line for line in lines if "compiled code" in line)
    assert re.search(rf"compiled code +1 of {count} functions, in {tmp_path} .*isorod compile", row)


@pytest.mark.slow
def test_a_first_run_compiles_little(python, tmp_path):
    """It took 38 s for 158 functions, most of them numba's own for single lines of NumPy."""
    done = python(COUNTED, "run spring", env=environment(NUMBA_CACHE_DIR=str(tmp_path)))
    (names,) = re.findall(r"^compiled \d+ \[(.*)\]", done.stdout, re.MULTILINE)
    assert 10 < names.count("isorod.") < 60
    assert names.count("numba.") < 15


MOTION = """
import numpy as np
from conftest import straight
from isorod import dynamics
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.space import Space

space = Space(straight(n=8, height=4.0), elements=4, degree=3, order=1)
model = Model([Body(space, NeoHookean(1.0, 0.3), 1.0)], [Support.end(space, "start")])
velocity = np.outer(space.positions[:, 2], [0.01, 0.02, 0.0]).ravel()
print(dynamics.solve(model, 5.0, outputs=1, velocity=velocity).displacement.tobytes().hex())
"""


@pytest.mark.slow
def test_who_compiles_has_the_last_bits_of_who_reads(tmp_path):
    around = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path),
        "PYTHONPATH": os.pathsep.join([*sys.path, str(ROOT / "tests")]),
    }
    compiled, read = (
        subprocess.run([sys.executable, "-c", MOTION], env=around, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert "compiling" in compiled.stderr and "compiling" not in read.stderr
    assert compiled.stdout == read.stdout


def _imported(tree: ast.AST) -> dict[str, object]:
    """Return what a file takes from the package, anywhere in it."""
    found = {}
    for line in ast.walk(tree):
        if isinstance(line, ast.ImportFrom) and (line.module or "").startswith("isorod"):
            for one in line.names:
                module = importlib.import_module(line.module)
                if not hasattr(module, one.name):
                    importlib.import_module(f"{line.module}.{one.name}")
                found[one.asname or one.name] = getattr(module, one.name)
    return found


def _calls_of_python(tree: ast.AST) -> set[str]:
    """Return what is called in functions that are not compiled."""
    compiled = {
        one
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef) and any("njit(" in ast.unparse(d) for d in function.decorator_list)
        for one in ast.walk(function)
    }
    return {ast.unparse(one.func) for one in ast.walk(tree) if isinstance(one, ast.Call) and one not in compiled}


def test_what_python_calls_returns_no_named_tuple():
    """An interrupt that comes while Numba makes one ends the process with a segmentation fault."""
    found = set()
    for file in HOUSE.rglob("*.py"):
        tree = ast.parse(file.read_text())
        name = ".".join(["isorod", *file.relative_to(HOUSE).with_suffix("").parts])
        own = vars(importlib.import_module(name)) if "njit(" in file.read_text() else {}
        known = own | _imported(tree)
        for called in _calls_of_python(tree):
            head, _, tail = called.partition(".")
            one = known.get(head)
            kernel = getattr(one, tail, None) if tail else one
            if isinstance(kernel, compiling.Kernel) and kernel.declared is not None:
                found.add(kernel)
    assert len(found) > 40
    named = (types.NamedTuple, types.NamedUniTuple)
    assert [kernel.py_func.__qualname__ for kernel in found if isinstance(kernel.declared.return_type, named)] == []


def test_a_change_of_what_a_function_calls_is_noticed(tree, python):
    """Numba looks at the file alone that a function stands in."""
    where = (
        "from isorod import keeping\nfrom isorod.material import points\nprint(keeping.folder(points.__file__).name)"
    )
    folders = [python(where, env=environment(PYTHONPATH=str(tree))).stdout]
    # Of what it imports; of what has nothing to do with it; its own.
    for name in ("compiled.py", "petsc/rows.py", "material/points.py"):
        with open(tree / "isorod" / name, "a") as file:
            file.write("# changed\n")
        folders.append(python(where, env=environment(PYTHONPATH=str(tree))).stdout)
    assert len(folders[0]) == 17
    assert folders[1] not in (folders[0], folders[3]) and folders[1] == folders[2] != folders[3]


def test_code_yet_to_be_compiled_takes_in_what_is_kept(python, tmp_path):
    """What is kept is read as far as it runs, and wholly when others call it."""
    kept = environment(NUMBA_CACHE_DIR=str(tmp_path))
    assert python(CALLS, env=kept).stdout.splitlines()[-1] == "[3.0, 2.0, 0.5]"
    for file in tmp_path.rglob("*.forward-*"):
        file.unlink()
    done = python(CALLS, env=kept)
    assert done.stdout.splitlines() == ["True False", "[3.0, 2.0, 0.5]"], done.stderr
    assert python(CALLS, env=kept).stdout.splitlines()[0] == "True True"


def test_help_needs_no_numpy(python):
    script = "import sys\nfrom isorod.command.cli import main\nmain([])\nprint('numpy' in sys.modules)"
    assert python(script).stdout.splitlines()[-1] == "False"
