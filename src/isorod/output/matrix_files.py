"""Matrices as files for other programs: in the formats of Matrix Market, PETSc and NumPy, with a description.

A folder is written with all of its files, or not at all.
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

# Digits that reproduce a double exactly.
_DIGITS = 17


def check_folder(path: str) -> None:
    """Raise `InputError` if a folder of that name cannot be made, or is not empty; makes nothing."""
    results.check_folder(path)
    with suppress(FileNotFoundError, NotADirectoryError):
        if any(Path(path).iterdir()):
            raise InputError(f"folder {path}: it has files in it; name a new one, or one that is empty")


def write(matrices: Matrices, folder: str, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write matrices and vectors to a new folder, each in three formats, with maps of the unknowns; all or nothing.

    Parameters
    ----------
    matrices
        The matrices.
    folder
        Name of the folder; it must not exist, or be empty.
    about
        Further entries of ``README.json``: scene, options, versions.

    Returns
    -------
    The content of ``README.json``.

    Raises
    ------
    InputError
        If something cannot be written; nothing is then left.
    """
    check_folder(folder)
    place = Path(folder).absolute()
    results.make_folder(str(place.parent))
    readme = _readme(matrices, about)
    try:
        results.write_beside(place, lambda beside: _write(matrices, beside, readme))
    except PETSc.Error:
        raise InputError(f"folder {folder}: PETSc cannot write all of it; make room there, or name another") from None
    return readme


def _readme(matrices: Matrices, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``README.json``."""
    mass = "none: a body has no density" if matrices.mass is None else "lumped" if matrices.lumped else "consistent"
    response = "the linear answer to supports and loads" if matrices.state is None else "a step of Newton's on"
    files = {
        "stiffness": f"K, force/length; {'symmetric' if matrices.symmetric else 'not symmetric (friction)'}",
        "mass": f"M, mass, {mass}; symmetric, modes are K x = omega^2 M x",
        "expansion": "E, from the unknowns to all degrees of freedom of all nodes (x, y, z of a node follow each "
        "other): displacement = E x + offset; a mode's shape = E x",
        "offset": "displacement where x = 0, of all degrees of freedom: "
        + ("what supports prescribe" if matrices.state is None else "the solution"),
        "force": f"f with K x = f: {response}",
    }
    if matrices.gyroscopic is not None:
        files["gyroscopic"] = "G, Coriolis forces G v in the frame that turns; antisymmetric"
        files["mass"] = files["mass"].replace("K x", "K x + i omega G x")
    if matrices.mass is None:
        del files["mass"]
    return {
        **about,
        "about": "the state of rest" if matrices.state is None else "the solution",
        "unknowns": matrices.force.size,
        "degrees_of_freedom": matrices.model.dofs,
        "symmetric": matrices.symmetric,
        "mass": mass,
        "entries": {name: getattr(matrices, name).nnz for name in _KINDS if getattr(matrices, name) is not None},
        "units": "those that the scene is given in: lengths, forces and masses of one consistent system",
        "bodies": [
            {"nodes": body.space.nodes, "first_degree_of_freedom": 3 * int(first), "element": str(body.space)}
            for body, first in zip(matrices.model.bodies, matrices.model.first_node[:-1], strict=True)
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


def _write(matrices: Matrices, folder: Path, readme: Mapping[str, Any]) -> None:
    """Make the folder with all files; raises `OSError`, or PETSc's error."""
    folder.mkdir()
    (folder / "README.json").write_text(json.dumps(readme, indent=2, default=str) + "\n")
    # PETSc's multigrid uses the block size, where the components of each node are adjacent.
    block = 3 if matrices.model.whole_nodes and matrices.force.size == matrices.model.unknowns else 1
    for name in (*_KINDS, "expansion"):
        matrix = getattr(matrices, name)
        if matrix is not None:
            symmetric = name == "mass" or (name == "stiffness" and matrices.symmetric)
            _market(folder / f"{name}.mtx", matrix, "symmetric" if symmetric else "general")
            with open(folder / f"{name}.npz", "wb") as file:
                save_npz(file, matrix)
            rows = matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data
            _petsc(folder / f"{name}.bin", PETSc.Mat().createAIJ(matrix.shape, block, csr=rows, comm=PETSc.COMM_SELF))
    for name, vector in {"offset": matrices.offset, "force": matrices.force}.items():
        _market(folder / f"{name}.mtx", vector[:, None], "general")
        with open(folder / f"{name}.npy", "wb") as file:
            np.save(file, vector)
        _petsc(folder / f"{name}.bin", PETSc.Vec().createWithArray(vector, comm=PETSc.COMM_SELF))
    nodes = (
        [b, k, *place, int(control)]
        for b, body in enumerate(matrices.model.bodies)
        for k, (place, control) in enumerate(
            zip(body.space.positions.tolist(), body.space.is_control_point.tolist(), strict=True)
        )
    )
    _table(folder / "nodes.csv", ["body", "node", "x", "y", "z", "carrier"], nodes)
    places = zip(*(one.tolist() for one in matrices.places), strict=True)
    unknowns = (
        [k, "", "", "pressure"] if body < 0 else [k, body, node, "xyz"[component]]
        for k, (body, node, component) in enumerate(places)
    )
    _table(folder / "unknowns.csv", ["unknown", "body", "node", "component"], unknowns)


def _market(path: Path, matrix: csr_array | Array, symmetry: str) -> None:
    with open(path, "wb") as file:
        mmwrite(file, matrix, field="real", precision=_DIGITS, symmetry=symmetry)


def _petsc(path: Path, value: PETSc.Object) -> None:
    viewer = PETSc.Viewer().createBinary(str(path), "w", PETSc.COMM_SELF)
    try:
        value.view(viewer)
    finally:
        viewer.destroy()
        value.destroy()


def _table(path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
