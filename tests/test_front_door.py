"""``import isorod``: what a script needs, by name, loaded when asked for, and known to type checkers."""

import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import isorod

ROOT = Path(__file__).parent.parent

SPRING = """
import isorod

wire = isorod.helix(radius=10, pitch=4, turns=2).sweep(isorod.circle(8, 0.8))
space = isorod.Space(wire, order=2, degree=4, elements=16)
ends = isorod.Support.end(space, "start"), isorod.Support.end(space, "end", displacement=(0, 0, 2))
model = isorod.Model([isorod.Body(space, isorod.NeoHookean(E=2e5, nu=0.3))], ends)
solution = isorod.statics.solve(model, petsc={"snes_rtol": 1e-10})
print(solution.at(wire, "end")[2], round(solution.section_forces(wire, "end").force[2], 4))
print(round(solution.reactions[1, 2], 4))
"""


def test_a_script_with_one_import(python):
    done = python(SPRING)
    assert done.stderr == ""
    moved, force, reaction = done.stdout.split()
    assert (float(moved), force) == (2.0, reaction)


def test_the_import_loads_nothing_else(python):
    """No module of isorod nor package of others; the wheels' finder looks for a package, and loads none."""
    script = """
import sys
before = set(sys.modules)
import isorod
isorod.__version__, dir(isorod)
print([name for name in set(sys.modules) - before if name.partition(".")[0] not in sys.stdlib_module_names])
"""
    done = python(script)
    assert done.stdout == "['isorod']\n", done.stderr


@pytest.mark.parametrize(
    ("names", "heavy"),
    [
        ("isorod.helix(1, 1, 1).sweep(isorod.circle(4, 0.1)); isorod.errors", "petsc4py numba"),
        ("isorod.Model, isorod.Support, isorod.Space", "petsc4py isorod.statics isorod.modal isorod.contact pyvista"),
        ("isorod.show", "petsc4py pyvista PIL matplotlib scipy.spatial"),
        ("isorod.statics.solve", "slepc4py pyvista PIL isorod.output.section_forces isorod.output.picture"),
    ],
)
def test_a_name_loads_no_more_than_its_own(names, heavy, python):
    done = python(f"import sys, isorod; {names}; print([one for one in {heavy.split()!r} if one in sys.modules])")
    assert done.stdout == "[]\n", done.stderr


def test_names_are_what_they_stand_for():
    assert len(isorod.__all__) == len(set(isorod.__all__)) > 30
    for name in isorod.__all__:
        found = getattr(isorod, name)
        if inspect.ismodule(found):
            assert found is import_module(f"isorod.{name}")
        else:
            assert name.endswith(found.__name__)
            assert found.__doc__
    assert set(isorod.__all__) <= set(dir(isorod))


def test_an_unknown_name_is_an_attribute_error_with_the_nearest():
    with pytest.raises(AttributeError, match=r"^module 'isorod' has no attribute 'Suport'$") as caught:
        isorod.Suport  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("Suport", isorod)
    assert not hasattr(isorod, "from_points")


USER = """
import numpy as np

import isorod
from isorod import Equilibrium, History, Model, Modes, statics

wire: isorod.Rod = isorod.helix(radius=10, pitch=4, turns=2).sweep(isorod.circle(8, 0.8))
space = isorod.Space(wire, order=2)
body = isorod.Body(space, isorod.NeoHookean(E=2e5, nu=0.3))
model = Model([body], [isorod.Support.end(space, "start")], loads=[isorod.SectionLoad((0.0, 0.0, 1.0))])
solution: Equilibrium = statics.solve(model, petsc={"snes_rtol": 1e-10, "snes_monitor": None})
tip = float(solution.at(wire, "end")[2])
forces = solution.section_forces(wire, np.linspace(0.0, 8.0, 9))
torsion = forces.M[:, 0] + forces.N
stress = solution.stress(0, [1.0, 2.0], (1.0, 0.0), kind="von Mises")
modes: Modes = isorod.modal.solve(model, 3)
shape = modes[0].centre_line(body, 20)
history: History = isorod.dynamics.solve(model, 1.0)
times = [instant.time for instant in history]
solution.plot("displacement", scale=2.0).save("picture.png")
isorod.show([wire], view=(1.0, 0.0, 0.0)).save("rod.png")
history.animate("motion.gif", colour="displacement")
modes[0].animate("mode.gif")
"""


MISTAKEN = """
import isorod

isorod.Space(3)
isorod.Suport
isorod.statics.solve(None)
"""


@pytest.mark.slow
def test_scripts_of_users_are_checked_strictly(tmp_path):
    """As of a package that is installed: nothing is said of isorod itself, what is right passes, mistakes are seen."""
    pytest.importorskip("mypy")
    (tmp_path / "right.py").write_text(USER)
    (tmp_path / "wrong.py").write_text(MISTAKEN)
    # Reading NumPy's types for the first time takes most of the time.
    cache = ["--cache-dir", str(ROOT / ".mypy_cache" / "users")]
    command = [sys.executable, "-m", "mypy", "--strict", *cache, "right.py", "wrong.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    said = [(line.partition(": ")[0], line.rpartition(" ")[2]) for line in done.stdout.splitlines()[:-1]]
    assert said == [("wrong.py:4", "[arg-type]"), ("wrong.py:5", "[attr-defined]"), ("wrong.py:6", "[arg-type]")], done
