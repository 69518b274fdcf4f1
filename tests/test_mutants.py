"""The mutation test itself: what is changed, what a change is tried against, and what its verdict rests on."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tests.mutants import covered, report, trees, trial
from tests.mutants.population import Changes, Mutant, files
from tests.mutants.reach import Reach

CODE = '''"""Text."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    NUMBER = 1 | 2

__all__ = ["area"] + []


@njit("f8(f8)", fastmath=1 > 0)
def area(radius: int | None = 2) -> float | None:
    """Text of 1 + 1."""
    if radius:
        raise ValueError(f"{radius + 1} is wrong")
    return radius * say("text")
'''


def changes(root, path):
    one = Changes(root, path)
    return [mutant for mutant in map(one.mutant, range(len(one))) if mutant]


def test_text_types_decorators_and_lists_of_names_are_left_alone(tmp_path):
    (tmp_path / "a.py").write_text(CODE)
    found = {(mutant.line, mutant.after) for mutant in changes(tmp_path, "a.py")}
    assert found == {(12, "def area(radius: int | None = 3) -> float | None:"), (16, 'return radius / say("text")')}


def test_a_mutant_is_the_file_with_one_line_changed(tmp_path):
    (tmp_path / "a.py").write_text("def f(a, b):\n    c = a < b\n    return g(a, b)\n")
    for mutant in changes(tmp_path, "a.py"):
        lines = ["def f(a, b):", "    c = a < b", "    return g(a, b)"]
        assert lines[mutant.line - 1].strip() == mutant.before
        lines[mutant.line - 1] = f"    {mutant.after}"
        assert mutant.code.splitlines() == lines
    assert [mutant.after for mutant in changes(tmp_path, "a.py")] == [
        *("c = None", "c = a <= b"),
        *("return g(None, b)", "return g(a, None)", "return g(b)", "return g(a, )"),
    ]


def test_pages_and_studies_are_not_mutated(tmp_path):
    wanted = ["comparisons/fem/biceps/run.py", "comparisons/measure/mac.py", "comparisons/report/precision.py"]
    wanted += ["comparisons/work.py", "src/isorod/laws/muscle.py", "src/isorod/rod.py"]
    others = ["comparisons/report/page.py", "comparisons/plots.py", "comparisons/stability/rods.py", "meshes/rod.py"]
    for name in wanted + others:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert files(tmp_path) == wanted


KERNEL = '''"""Compiled."""

SCALE = 2.0
TABLE = [1]


@njit
def inner(x):
    return SCALE * x


@njit
def outer(x):
    return inner(x) + 1.0


WORD = "a"
'''
USER = '''"""Not compiled."""

from isorod.face import outer


def apply(x):
    return outer(x)


def other(x=0):
    return x
'''
CHOOSER = """def first():
    from isorod.adding import add

    return add


def other():
    from isorod.stranger import outer as add

    return add


def named():
    return import_module("two_kernel")
"""
TESTS = '''"""Tests."""

from isorod import Offered, kernel


@pytest.fixture
def table():
    return kernel.TABLE


def test_it(table):
    pass


def test_other(TABLE):
    return TABLE.outer


def test_offered():
    assert Offered


test_listed = refused((lambda: Offered, "no"))
'''


@pytest.fixture
def reach(tmp_path):
    place = tmp_path / "src/isorod"
    place.mkdir(parents=True)
    (place / "kernel.py").write_text(KERNEL)
    (place / "user.py").write_text(USER)
    (place / "face.py").write_text("from isorod.kernel import outer\n")
    (place / "__init__.pyi").write_text("from isorod.kernel import WORD as Offered\n")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/test_kernel.py").write_text(TESTS)
    (place / "stranger.py").write_text("def outer(x):\n    return x\n")
    (place / "adding.py").write_text("@njit\ndef add(x):\n    return x\n")
    (place / "writer.py").write_text('_NAMES = {"isorod.adding": "add"}\n\n\ndef text():\n    return _NAMES\n')
    seen = {"src/isorod/user.py": {7: {"applies"}, 11: {"others"}}, "src/isorod/stranger.py": {2: {"strange"}}}
    seen["src/isorod/writer.py"] = {5: {"writes"}}
    (place / "two_kernel.py").write_text("@njit\ndef add(x):\n    return x\n")
    (place / "chooser.py").write_text(CHOOSER)
    seen["src/isorod/chooser.py"] = {4: {"chooses the first"}, 10: {"chooses the other"}, 14: {"chooses by name"}}
    tests = "test_it[1] test_it[2] test_other test_offered test_listed[no]".split()
    seconds = {f"tests/test_kernel.py::{test}": 1.0 for test in tests}
    return Reach(tmp_path, covered.Covered(seconds, {}, {}, seen, []))


@pytest.mark.parametrize(
    ("path", "line", "tests"),
    [
        ("user.py", 7, {"applies"}),
        ("user.py", 10, {"others"}),  # a default value: those that run the function
        ("kernel.py", 14, {"applies"}),  # compiled: those that run what calls it
        ("kernel.py", 9, {"applies"}),  # through another compiled one
        ("kernel.py", 3, {"applies"}),  # a constant: through the compiled functions that hold it
        ("kernel.py", 4, {"tests/test_kernel.py::test_it[1]", "tests/test_kernel.py::test_it[2]"}),  # through a fixture
        (
            "kernel.py",
            17,
            {f"tests/test_kernel.py::{test}" for test in ("test_offered", "test_listed[no]")},
        ),  # by the package
        ("stranger.py", 2, {"strange"}),
        # compiled: by code written at run time, and by a function that imports it by a name that another uses too
        ("adding.py", 3, {"writes", "chooses the first"}),
        ("two_kernel.py", 3, {"chooses by name"}),  # a module named by a text
    ],
)
def test_tests_are_those_that_run_the_line_or_what_uses_it(reach, path, line, tests):
    assert reach.tests(f"src/isorod/{path}", line) == tests


def test_the_cache_of_those_who_inline_a_file_is_deleted_and_no_other(reach, tmp_path):
    place = tmp_path / "src/isorod/__pycache__"
    place.mkdir()
    for name in ("kernel.inner-8.py311.nbi", "user.apply-6.py311.1.nbc", "stranger.outer-1.py311.nbi"):
        (place / name).touch()
    assert trees.forget_compiled(tmp_path, "src/isorod/kernel.py") == ["isorod.kernel", "isorod.user"]
    assert [file.name for file in place.iterdir()] == ["stranger.outer-1.py311.nbi"]


def test_tests_run_quickest_first_within_the_budget():
    seconds = {"slow": 3.0, "quick": 0.1, "one": 0.2, "two": 0.2, "late": 50.0}
    fixtures = dict.fromkeys(seconds, ()) | {"one": ("solved",), "two": ("solved",)}
    known = covered.Covered(seconds, fixtures, {"solved": 1.0}, {}, [])
    order = [test for test, _ in trial.order(known, set(seconds), 10.0, "")]
    assert order == ["quick", "one", "two", "slow"]
    assert [test for test, _ in trial.order(known, set(seconds), 60.0, "late")] == ["late", *order]
    assert [test for test, _ in trial.order(known, {"one", "two"}, 1.3, "two")] == ["two"]


def test_a_slow_fixture_of_all_tests_makes_no_group_of_them():
    seconds = {"slow": 9.0, "quick": 0.1, "one": 5.0}
    fixtures = dict.fromkeys(seconds, ("compiled",)) | {"one": ("compiled", "solved")}
    known = covered.Covered(seconds, fixtures, {"compiled": 1.0, "solved": 1.0}, {}, [])
    assert [test for test, _ in trial.order(known, set(seconds), 12.0, "")] == ["quick", "one"]


IT = "def f(x):\n    while x > 0:\n        x -= 1\n    return x\n"
ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    ("after", "how"), [("x -= 2", "survived"), ("x -= 3", "caught"), ("x += 1", "timeout"), ("x -= y", "caught")]
)
def test_a_verdict_is_that_of_the_tests(tmp_path, monkeypatch, after, how):
    monkeypatch.setattr(trial, "ALLOWANCE", 3.0)
    tree, file, it = tmp_path / "tree", "tests/test_it.py", "src/isorod/it.py"
    shutil.copytree(ROOT / "tests/mutants", tree / "tests/mutants")
    (tree / it).parent.mkdir(parents=True)
    (tree / it).with_name("__init__.py").touch()
    (tree / it).write_text(IT)
    (tree / file).write_text("from isorod.it import f\n\n\ndef test_it():\n    assert f(2) == 0\n")
    test = f"{file}::test_it"
    known = covered.Covered({test: 0.0}, {test: ()}, {}, {it: {3: {test}}}, [])
    mutant = Mutant(it, 3, "any", "x -= 1", after, IT.replace("x -= 1", after))
    outcome = trial.run(mutant, tmp_path / "worker", tree, Reach(tree, known), 10.0, "")
    assert (outcome.how, outcome.by, outcome.tests) == (how, "" if how == "survived" else test, 1)
    unseen = trial.run(replace(mutant, line=4), tmp_path / "worker", tree, Reach(tree, known), 10.0, "")
    assert (unseen.how, unseen.tests) == ("unreached", 0)


def test_the_score_counts_what_was_noticed():
    place = {"path": "src/isorod/it.py", "line": 3, "operator": "number", "before": "1", "after": "2", "seconds": 1.0}
    hows = ["caught", "timeout", "survived", "unreached", "caught"]
    records = [place | {"how": how, "by": "", "tests": 1, "left_out": 0} for how in hows]
    text = report.summary(records, {"population": 9, "seed": 1, "budget": 60.0}, [])
    assert (
        "3 of 5 (60 %) caught, 1 of them by a test that did not end; 1 of the others are in lines that no test" in text
    )
    assert text.count("    - 1\n    + 2") == 2
