"""Matrices for other programs: read back they give the same frequencies, and the maps lead back to the rod."""

import contextlib
import csv
import io
import json
import re

import numpy as np
import pytest
from conftest import ON_RANKS, straight
from scipy.io import mmread
from scipy.sparse import load_npz
from scipy.sparse.linalg import eigsh, spsolve

import isorod as offered
from isorod import InputError, LinearElastic, Muscle, NeoHookean, Space, dynamics, matrices, modal, statics
from isorod.command import cli
from isorod.model import Body, Contact, Model, Plane, SectionLoad, Support
from isorod.output import matrix_files
from isorod.scenes.blade import Blade

# Nothing of isorod: what SLEPc's example 7 does with its options -f1 and -f2.
EXAMPLE_7 = """
import sys
from mpi4py import MPI
import slepc4py
slepc4py.init(["ex7", "-eps_gen_hermitian", "-eps_nev", "10", "-eps_target", "0", "-st_type", "sinvert",
               "-st_ksp_type", "preonly", "-st_pc_type", "cholesky", "-eps_tol", "1e-12"])
from petsc4py import PETSc
from slepc4py import SLEPc
both = []
for name in sys.argv[1:]:
    viewer = PETSc.Viewer().createBinary(name, "r")
    matrix = PETSc.Mat().create()
    matrix.setFromOptions()
    both.append(matrix.load(viewer))
solver = SLEPc.EPS().create()
solver.setOperators(*both)
solver.setFromOptions()
solver.solve()
assert not any(name.startswith("isorod") for name in sys.modules)
print(both[0].getBlockSize(), *(repr(solver.getEigenvalue(k).real) for k in range(10)))
"""


def frequencies(eigenvalues):
    return np.sqrt(eigenvalues) / (2.0 * np.pi)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The blade's matrices, and its frequencies as the command prints them."""
    folder = tmp_path_factory.mktemp("matrices") / "blade"
    with contextlib.redirect_stdout(io.StringIO()) as told:
        assert cli.main(["matrices", "blade", "--output", str(folder)]) == 0
        assert cli.main("run blade --json --no-estimate".split()) == 0
    assert told.getvalue().startswith("756 unknowns (792 degrees of freedom), about the state of rest; stiffness of ")
    return folder, np.array(json.loads(told.getvalue().splitlines()[-1])["frequencies"])


def test_scipy_finds_the_frequencies_from_files_of_both_kinds(written):
    folder, expected = written
    for ending, read in (("mtx", mmread), ("npz", load_npz)):
        stiffness, mass = (read(folder / f"{name}.{ending}").tocsc() for name in ("stiffness", "mass"))
        found = eigsh(stiffness, 10, mass, sigma=0.0, return_eigenvectors=False)
        assert frequencies(np.sort(found)) == pytest.approx(expected, rel=1e-10)


def test_slepc_alone_finds_the_frequencies_as_in_its_example(written, python):
    folder, expected = written
    done = python(EXAMPLE_7, str(folder / "stiffness.bin"), str(folder / "mass.bin"))
    assert done.returncode == 0, done.stderr
    block, *found = done.stdout.split()
    assert block == "3"
    assert frequencies(np.array(found, dtype=float)) == pytest.approx(expected, rel=1e-10)


def test_files_of_all_kinds_hold_the_same_to_the_last_digit(written):
    from petsc4py import PETSc

    folder, _ = written
    names = {file.name for file in folder.iterdir()}
    assert {"README.json", "nodes.csv", "unknowns.csv"} < names
    for name in ("stiffness", "mass", "expansion"):
        first = load_npz(folder / f"{name}.npz")
        assert (first != mmread(folder / f"{name}.mtx").tocsr()).nnz == 0
        viewer = PETSc.Viewer().createBinary(str(folder / f"{name}.bin"), "r")
        start, column, values = PETSc.Mat().load(viewer).getValuesCSR()
        assert np.array_equal(start, first.indptr) and np.array_equal(column, first.indices)
        assert np.array_equal(values, first.data)
    for name in ("offset", "force"):
        first = np.load(folder / f"{name}.npy")
        assert np.array_equal(first, mmread(folder / f"{name}.mtx").ravel())
        second = PETSc.Vec().load(PETSc.Viewer().createBinary(str(folder / f"{name}.bin"), "r"))
        assert np.array_equal(first, second.array_r)
    with open(folder / "stiffness.mtx") as file:
        assert file.readline() == "%%MatrixMarket matrix coordinate real symmetric\n"


def test_the_folder_says_what_is_in_it(written):
    folder, _ = written
    said = json.loads((folder / "README.json").read_text())
    stiffness, mass = (load_npz(folder / f"{name}.npz") for name in ("stiffness", "mass"))
    assert (said["scene"], said["analysis"], said["about"]) == ("blade", "modal", "the state of rest")
    assert (said["unknowns"], said["degrees_of_freedom"], said["symmetric"]) == (756, 792, True)
    assert said["entries"] == {"stiffness": stiffness.nnz, "mass": mass.nnz}
    stems = {file.name.split(".")[0] for file in folder.iterdir()} - {"README"}
    assert {name.split(".")[0] for name in said["files"]} == stems

    expansion = load_npz(folder / "expansion.npz")
    with open(folder / "unknowns.csv") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["unknown"]) for row in rows] == list(range(756))
    dofs = [3 * int(row["node"]) + "xyz".index(row["component"]) for row in rows]
    assert np.array_equal(expansion[dofs].toarray(), np.eye(756))
    with open(folder / "nodes.csv") as file:
        nodes = list(csv.DictReader(file))
    space = Blade().model().bodies[0].space
    assert np.array_equal([[float(row[axis]) for axis in "xyz"] for row in nodes], space.positions)
    assert [row["carrier"] == "1" for row in nodes] == space.is_control_point.tolist()


def bar(law=None, supports=None, density=3.0, **more):
    """A bar along z of length 3, held at one end where nothing else is said."""
    space = Space(straight(4, height=3.0), elements=3, degree=3, order=2, section_points=4)
    held = [Support.end(space, "start")] if supports is None else supports(space)
    loads = [SectionLoad.end(space, "end", (0.5, 0.0, -1.0))]
    return Model([Body(space, law or LinearElastic(100.0, 0.3), density, **more)], held, loads=loads)


def turned(space):
    """Both ends held, one turned about x, its centre free in its plane."""
    start = Support.end(space, "start", displacement=(0.0, 0.1, 0.0))
    return [start, Support.end(space, "end", "z", turn=(0.1, 0.0, 0.0), tied="xy")]


@pytest.mark.parametrize("supports", [None, turned])
def test_at_rest_they_have_the_linear_answer(supports):
    model = bar(supports=supports)
    found = matrices(model)
    moved = found.expansion @ spsolve(found.stiffness.tocsc(), found.force) + found.offset
    solved = statics.solve(model, petsc={"snes_rtol": 1e-12}).displacement
    assert np.abs(solved).max() > 0.01
    assert moved == pytest.approx(solved, abs=1e-9 * np.abs(solved).max())
    assert found.symmetric and found.state is None


def test_unknowns_that_a_support_ties_share_a_column():
    model = bar(supports=turned)
    found = matrices(model)
    _, node, component = found.places
    assert model.unknowns < (model.free >= 0).sum()
    tied = np.flatnonzero(found.expansion.sum(axis=0) > 1)
    assert len(tied) == 2 and component[tied].tolist() == [0, 1]
    for unknown in range(model.unknowns):
        dofs = np.flatnonzero(model.free == unknown)
        assert 3 * node[unknown] + component[unknown] == dofs[0]
        assert np.array_equal(found.expansion[:, [unknown]].nonzero()[0], dofs)


def test_a_free_body_has_its_mass_and_no_stiffness_against_translation():
    model = bar(supports=lambda space: [])
    for lumped in (False, True):
        found = matrices(model, lumped=lumped)
        way = np.tile([1.0, 0.0, 0.0], model.dofs // 3) * np.repeat(model.is_control_point, 3)
        assert np.array_equal(found.expansion @ way, way)
        assert way @ (found.mass @ way) == pytest.approx(3.0 * model.bodies[0].space.rod.volume(), rel=1e-12)
        assert np.abs(found.stiffness @ way).max() < 1e-12 * found.stiffness.max()
    assert matrices(bar(density=0.0)).mass is None


@pytest.mark.parametrize("lumped", [False, True])
def test_modes_have_the_matrices_they_are_of(lumped):
    model = bar(NeoHookean(100.0, 0.3))
    state = statics.solve(model, petsc={"snes_rtol": 1e-12})
    for about in (None, state):
        modes = modal.solve(model, 4, lumped, state=about, at_rest=about is None, petsc={"eps_tol": 1e-13})
        found = modes.matrices()
        assert found.lumped is lumped
        values = eigsh(found.stiffness, 4, found.mass, sigma=0.0, return_eigenvectors=False)
        assert frequencies(np.sort(values)) == pytest.approx(modes.frequencies, rel=1e-10)
        shapes = found.expansion.T @ modes.vectors.T
        assert np.abs(found.expansion @ shapes - modes.vectors.T).max() == 0.0
        assert shapes.T @ (found.mass @ shapes) == pytest.approx(np.eye(4), abs=1e-9)
    # Loads soften or stiffen it.
    rest = modal.solve(model, 4, lumped, at_rest=True).frequencies
    assert np.abs(modes.frequencies / rest - 1.0).max() > 1e-3


def test_about_a_solution_it_is_the_tangent_and_in_balance():
    model = bar(NeoHookean(100.0, 0.3), turned)
    solution = statics.solve(model, petsc={"snes_rtol": 1e-12})
    found, rest = solution.matrices(), matrices(model)
    assert np.array_equal(found.offset, solution.displacement) and found.state is solution
    assert np.abs(found.force).max() < 1e-9 * np.abs(rest.force).max()
    # A step from beside it leads back to it.
    beside = np.linspace(-1e-6, 1e-6, found.force.size)
    state = statics.Equilibrium(**{**vars(solution), "displacement": solution.displacement + found.expansion @ beside})
    force = matrices(model, state).force
    assert spsolve(found.stiffness.tocsc(), force) == pytest.approx(-beside, abs=1e-9)


def test_an_output_of_a_motion_has_its_tangent():
    """That which implicit steps come to rest about: what is out of balance there is mass times acceleration."""
    motion = dynamics.solve(bar(NeoHookean(100.0, 0.3)), 0.4, time_step=2e-3, outputs=200, integrator="implicit")
    found, rest = matrices(motion.model, motion[160]), matrices(motion.model)
    assert np.array_equal(found.offset, motion.displacement[160])
    velocity = [found.expansion.T @ motion.velocity[k] for k in (159, 161)]
    pushed = found.mass @ (velocity[1] - velocity[0]) / (motion.times[161] - motion.times[159])
    size = np.abs(rest.force).max()
    assert np.abs(found.force).max() > 0.1 * size
    assert found.force == pytest.approx(pushed, abs=3e-3 * size)


MUSCLE = Muscle(100.0, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))


def test_muscles_that_grow_active_have_none_yet():
    motion = dynamics.solve(bar(MUSCLE), 1e-3, time_step=5e-4, outputs=2, ramp=2e-3, integrator="implicit")
    with pytest.raises(InputError, match=r"muscles are active to 0\.5 of what they will be"):
        matrices(motion.model, motion[-1])


def test_pressures_are_unknowns_without_mass():
    model = bar(NeoHookean(100.0, 0.5), formulation="mixed")
    solution = statics.solve(model, petsc={"snes_rtol": 1e-12})
    found = solution.matrices()
    pressures = solution.pressures[0].size
    assert found.force.size == model.unknowns + pressures
    body, node, component = found.places
    alone = np.flatnonzero(body < 0)
    assert alone.size == pressures and (node[alone] < 0).all() and (component[alone] < 0).all()
    assert abs(found.mass[alone]).nnz == 0 and abs(found.expansion[:, alone]).nnz == 0
    assert np.abs(found.force).max() < 1e-9
    # As that of the same body with a law that needs no pressure.
    columns = np.flatnonzero(body >= 0)
    assert (found.mass[columns][:, columns] != matrices(bar()).mass).nnz == 0


def test_with_contact_there_are_those_at_rest_alone():
    space = Space.paper(straight(8, height=3.0), elements=3, degree=2, order=1)
    floor = Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), 10.0)
    model = Model([Body(space, NeoHookean(100.0, 0.3))], [Support.end(space, "start")], contacts=[floor])
    assert matrices(model).symmetric
    with pytest.raises(InputError, match=r"with contact: .*use those at rest"):
        statics.solve(model).matrices()


def test_a_state_of_another_model_is_refused():
    solution = statics.solve(bar())
    with pytest.raises(InputError, match="the state is of another model"):
        matrices(bar(), solution)
    assert offered.matrices is matrices


SMALL = ["--coils", "1", "--section-points", "4", "--elements-per-turn", "8"]


def test_the_command_takes_the_solution_or_rest(tmp_path, capsys):
    assert cli.main(["matrices", "spring", *SMALL, "--output", str(tmp_path / "new" / "loaded")]) == 0
    assert "about the solution; stiffness of" in capsys.readouterr().out
    assert cli.main(["matrices", "spring", *SMALL, "--at-rest", "--output", str(tmp_path / "rest")]) == 0
    assert "mass none: a body has no density" in capsys.readouterr().out
    loaded, rest = (load_npz(tmp_path / name / "stiffness.npz") for name in ("new/loaded", "rest"))
    assert loaded.shape == rest.shape and 1e-4 < abs(loaded - rest).max() / abs(rest).max() < 0.5
    assert not (tmp_path / "rest" / "mass.npz").exists()
    assert np.abs(np.load(tmp_path / "rest" / "offset.npy")).max() == 2.0
    # A folder is there or not, none is added to.
    assert sorted(one.name for one in tmp_path.iterdir()) == ["new", "rest"]


def test_a_file_says_which_mass(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.toml").write_text(
        "[analysis.modal]\nlumped = true\n[rod.bar]\ncurve = {straight = 3.0}\nsection = {circle = 1.0}\n"
        "density = 2.0\nlaw = {LinearElastic = {E = 10.0, nu = 0.3}}\nspace = {elements = 2, degree = 2}\n"
    )
    for words, kind in (([], "lumped"), (["--mass", "consistent"], "consistent"), (["--elements", "3"], "lumped")):
        folder = tmp_path / "".join(["m", *words])
        assert cli.main(["matrices", "my.toml", *words, "--output", str(folder)]) == 0, capsys.readouterr().err
        assert json.loads((folder / "README.json").read_text())["mass"] == kind
    mass = load_npz(tmp_path / "m" / "mass.npz")
    assert mass.nnz == mass.shape[0] < load_npz(tmp_path / "m--elements3" / "mass.npz").nnz


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("ring --output new", "this scene is geometry only"),
        ("clasp --output new", "with contact: .*--at-rest"),
        ("spring", "required: --output"),
        ("spring --output full", "folder full: it has files in it; name a new one"),
        ("spring --output full/file", "results folder full/file: cannot write there"),
        ("spring --at-rest --output new -nonsense 3", "PETSc option -nonsense 3: nothing used it"),
        ("spring --coil 3 --output new", "did you mean --coils"),
        ("spring --mass heavy --output new", "--mass"),
        ("", "usage"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    code = cli.main(["matrices", *words.split()])
    out, err = capsys.readouterr()
    if words:
        assert (code, out) == (2, "") and re.fullmatch(rf"isorod: .*{said}.*\n", err), err
    else:
        assert code == 0 and said in out
    assert [str(one.relative_to(tmp_path)) for one in sorted(tmp_path.rglob("*"))] == ["full", "full/file"]


def test_a_full_disk_leaves_no_folder(tmp_path, room, monkeypatch):
    found = matrices(bar())
    for size in (0, 5000, 100_000):
        with room(size), pytest.raises(InputError, match=r"cannot be written|cannot write there"):
            matrix_files.write(found, str(tmp_path / "there"), {})
        assert not any(tmp_path.iterdir())
    # PETSc's errors are no others.
    monkeypatch.setattr(matrix_files, "_market", lambda *_: None)
    monkeypatch.setattr(matrix_files, "save_npz", lambda *_: None)
    with room(5000), pytest.raises(InputError, match=r"there: PETSc cannot write all of it; make room"):
        matrix_files.write(found, str(tmp_path / "there"), {})
    assert not any(tmp_path.iterdir())
    monkeypatch.undo()
    (tmp_path / "there").mkdir()
    matrix_files.write(found, str(tmp_path / "there"), {})
    assert (tmp_path / "there" / "README.json").exists()
    assert [one.name for one in tmp_path.iterdir()] == ["there"]


@pytest.mark.mpi
def test_ranks_write_the_same_files(written, tmp_path, on_ranks):
    folder, _ = written
    said = on_ranks(2, ON_RANKS, "matrices", "blade", "--output", str(tmp_path / "two"))
    assert said.count("756 unknowns") == 1
    for file in folder.iterdir():
        if file.name != "README.json":
            assert (tmp_path / "two" / file.name).read_bytes() == file.read_bytes(), file.name
