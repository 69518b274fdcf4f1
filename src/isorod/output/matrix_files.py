"""Matrices as files that other programs read: Matrix Market, PETSc's own and NumPy's, and one that says what is what.

A folder is there with all of its files, or not at all.
"""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy.io import mmwrite
from scipy.sparse import csr_array, save_npz

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output import results
from isorod.output.matrices import Matrices

# Matrices of the unknowns.
_KINDS = ("stiffness", "mass", "gyroscopic")

# Digits after which a double is itself again.
_DIGITS = 17


def check_folder(path: str) -> None:
    """Raise `InputError` if a new folder of that name cannot be made, or has files in it; makes nothing."""
    results.check_folder(path)
    with suppress(FileNotFoundError, NotADirectoryError):
        if any(Path(path).iterdir()):
            raise InputError(f"folder {path}: it has files in it; name a new one, or one that is empty")


def write(found: Matrices, folder: str, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write matrices and vectors to a new folder, each in three formats, with maps of the unknowns; all or nothing.

    Parameters
    ----------
    found
        The matrices.
    folder
        Its name; it must not be there, or be empty.
    about
        What ``README.json`` says besides: scene, options, versions.

    Returns
    -------
    What ``README.json`` says.

    Raises
    ------
    InputError
        If something cannot be written; nothing is then left.
    """
    check_folder(folder)
    place = Path(folder).absolute()
    results.make_folder(str(place.parent))
    readme = _readme(found, about)
    try:
        results.write_beside(place, lambda beside: _write(found, beside, readme))
    except PETSc.Error:
        raise InputError(f"folder {folder}: PETSc cannot write all of it; make room there, or name another") from None
    return readme


def _readme(found: Matrices, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``README.json`` says."""
    mass = "none: a body has no density" if found.mass is None else "lumped" if found.lumped else "consistent"
    one_step = "the linear answer to supports and loads" if found.state is None else "a step of Newton's on"
    files = {
        "stiffness": f"K, force/length; {'symmetric' if found.symmetric else 'not symmetric (friction)'}",
        "mass": f"M, mass, {mass}; symmetric, modes are K x = omega^2 M x",
        "expansion": "E, from the unknowns to all degrees of freedom of all nodes (x, y, z of a node follow each "
        "other): displacement = E x + offset; a mode's shape = E x",
        "offset": "displacement where x = 0, of all degrees of freedom: "
        + ("what supports prescribe" if found.state is None else "the solution"),
        "force": f"f with K x = f: {one_step}",
    }
    if found.gyroscopic is not None:
        files["gyroscopic"] = "G, Coriolis forces G v in the frame that turns; antisymmetric"
        files["mass"] = files["mass"].replace("K x", "K x + i omega G x")
    if found.mass is None:
        del files["mass"]
    return {
        **about,
        "about": "the state of rest" if found.state is None else "the solution",
        "unknowns": found.force.size,
        "degrees_of_freedom": found.model.dofs,
        "symmetric": found.symmetric,
        "mass": mass,
        "entries": {name: getattr(found, name).nnz for name in _KINDS if getattr(found, name) is not None},
        "units": "those that the scene is given in: lengths, forces and masses of one consistent system",
        "bodies": [
            {"nodes": body.space.nodes, "first_degree_of_freedom": 3 * int(first), "element": str(body.space)}
            for body, first in zip(found.model.bodies, found.model.first_node[:-1], strict=True)
        ],
        "files": files
        | {
            "nodes.csv": "of each node its body, its number there, the coefficients x, y, z of the rod's own shape, "
            "and whether it is a control point of the partition of unity: a translation moves these, and no others",
            "unknowns.csv": "of each unknown, in order from 0, its body, node and component; of several that a support "
            "ties together the first; a pressure has none",
        },
        "formats": {
            ".mtx": "Matrix Market; of a symmetric matrix the lower triangle",
            ".bin": f"PETSc binary, MatLoad and VecLoad, integers of {8 * np.dtype(PETSc.IntType).itemsize} bits",
            ".npz": "scipy.sparse.load_npz; .npy of vectors: numpy.load",
        },
    }


def _write(found: Matrices, folder: Path, readme: Mapping[str, Any]) -> None:
    """Make the folder with all files; raises `OSError`, or PETSc's error."""
    folder.mkdir()
    (folder / "README.json").write_text(json.dumps(readme, indent=2, default=str) + "\n")
    # That the components of a node stand together is what PETSc's multigrid wants to know.
    block = 3 if found.model.whole_nodes and found.force.size == found.model.unknowns else 1
    for name in (*_KINDS, "expansion"):
        matrix = getattr(found, name)
        if matrix is not None:
            symmetric = name == "mass" or (name == "stiffness" and found.symmetric)
            _market(folder / f"{name}.mtx", matrix, "symmetric" if symmetric else "general")
            with open(folder / f"{name}.npz", "wb") as file:
                save_npz(file, matrix)
            rows = matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data
            _petsc(folder / f"{name}.bin", PETSc.Mat().createAIJ(matrix.shape, block, csr=rows, comm=PETSc.COMM_SELF))
    for name, vector in {"offset": found.offset, "force": found.force}.items():
        _market(folder / f"{name}.mtx", vector[:, None], "general")
        with open(folder / f"{name}.npy", "wb") as file:
            np.save(file, vector)
        _petsc(folder / f"{name}.bin", PETSc.Vec().createWithArray(vector, comm=PETSc.COMM_SELF))
    nodes = (
        [b, k, *place, int(carrier)]
        for b, body in enumerate(found.model.bodies)
        for k, (place, carrier) in enumerate(
            zip(body.space.positions.tolist(), body.space.is_control_point.tolist(), strict=True)
        )
    )
    _table(folder / "nodes.csv", ["body", "node", "x", "y", "z", "carrier"], nodes)
    places = zip(*(one.tolist() for one in found.places), strict=True)
    unknowns = (
        [k, "", "", "pressure"] if body < 0 else [k, body, node, "xyz"[component]]
        for k, (body, node, component) in enumerate(places)
    )
    _table(folder / "unknowns.csv", ["unknown", "body", "node", "component"], unknowns)


def _market(path: Path, matrix: csr_array | Array, symmetry: str) -> None:
    with open(path, "wb") as file:
        mmwrite(file, matrix, field="real", precision=_DIGITS, symmetry=symmetry)


def _petsc(path: Path, what: PETSc.Object) -> None:
    viewer = PETSc.Viewer().createBinary(str(path), "w", PETSc.COMM_SELF)
    try:
        what.view(viewer)
    finally:
        viewer.destroy()
        what.destroy()


def _table(path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
