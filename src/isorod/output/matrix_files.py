"""Matrices as files that other programs read: Matrix Market, PETSc's own and NumPy's, and one that says what is what.

A folder is there with all of its files, or not at all.
"""

import csv
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
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

# What PETSc's files of a matrix and of a vector begin with.
_MATRIX, _VECTOR = 1211216, 1211214

# Matrices of the unknowns.
_KINDS = ("stiffness", "mass", "gyroscopic")

# Digits after which a double is itself again.
_DIGITS = 17

# Writes a file of a name.
Write = Callable[[Path], object]


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
    said = _said(found, about)
    try:
        beside = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}-"))
        try:
            for name, save in _files(found, said).items():
                results.write_beside(beside / name, save)
            results.open_to_all(beside, 0o777)
            os.replace(beside, place)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as problem:
        raise results.refusal(f"folder {folder}: cannot be written", problem) from None
    return said


def _said(found: Matrices, about: Mapping[str, Any]) -> dict[str, Any]:
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
            "and whether it is a carrier: a translation moves each of these, and no other",
            "unknowns.csv": "of each unknown, in order from 0, its body, node and component; of several that a support "
            "ties together the first; a pressure has none",
        },
        "formats": {
            ".mtx": "Matrix Market; of a symmetric matrix the lower triangle",
            ".bin": f"PETSc binary, MatLoad and VecLoad, integers of {8 * np.dtype(PETSc.IntType).itemsize} bits",
            ".npz": "scipy.sparse.load_npz; .npy of vectors: numpy.load",
        },
    }


def _files(found: Matrices, said: Mapping[str, Any]) -> dict[str, Write]:
    """Return what writes each file, by its name."""
    files: dict[str, Write] = {}
    sparse = {name: getattr(found, name) for name in (*_KINDS, "expansion")}
    block = 3 if found.model.whole_nodes and found.force.size == found.model.unknowns else 1
    for name, matrix in sparse.items():
        if matrix is None:
            continue
        symmetric = name == "mass" or (name == "stiffness" and found.symmetric)
        files[f"{name}.mtx"] = _market(matrix, "symmetric" if symmetric else "general")
        files[f"{name}.bin"] = _petsc_matrix(matrix)
        # That the components of a node stand together is what PETSc's multigrid wants to know.
        files[f"{name}.bin.info"] = _text(f"-matload_block_size {block}\n")
        files[f"{name}.npz"] = _compressed(matrix)
    for name, vector in {"offset": found.offset, "force": found.force}.items():
        files[f"{name}.mtx"] = _market(vector[:, None], "general")
        files[f"{name}.bin"] = _petsc_vector(vector)
        files[f"{name}.npy"] = _array(vector)
    files["nodes.csv"] = _nodes(found)
    files["unknowns.csv"] = _unknowns(found)
    files["README.json"] = _text(json.dumps(said, indent=2, default=str) + "\n")
    return files


def _market(matrix: csr_array | Array, symmetry: str) -> Write:
    def save(path: Path) -> None:
        with open(path, "wb") as file:
            mmwrite(file, matrix, field="real", precision=_DIGITS, symmetry=symmetry)

    return save


def _petsc_matrix(matrix: csr_array) -> Write:
    """Return what writes a matrix as ``MatView`` does: header, lengths of the rows, columns, entries, big-endian."""

    def save(path: Path) -> None:
        with open(path, "wb") as file:
            _integers([_MATRIX, *matrix.shape, matrix.nnz]).tofile(file)
            _integers(np.diff(matrix.indptr)).tofile(file)
            _integers(matrix.indices).tofile(file)
            matrix.data.astype(">f8").tofile(file)

    return save


def _petsc_vector(vector: Array) -> Write:
    def save(path: Path) -> None:
        with open(path, "wb") as file:
            _integers([_VECTOR, vector.size]).tofile(file)
            vector.astype(">f8").tofile(file)

    return save


def _integers(values: Any) -> np.ndarray:
    return np.asarray(values).astype(np.dtype(PETSc.IntType).newbyteorder(">"))


def _compressed(matrix: csr_array) -> Write:
    def save(path: Path) -> None:
        with open(path, "wb") as file:
            save_npz(file, matrix)

    return save


def _array(vector: Array) -> Write:
    def save(path: Path) -> None:
        with open(path, "wb") as file:
            np.save(file, vector)

    return save


def _text(text: str) -> Write:
    return lambda path: path.write_text(text)


def _nodes(found: Matrices) -> Write:
    def save(path: Path) -> None:
        with open(path, "w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["body", "node", "x", "y", "z", "carrier"])
            for b, body in enumerate(found.model.bodies):
                rows = zip(body.space.positions.tolist(), body.space.is_carrier.tolist(), strict=True)
                table.writerows([b, k, *place, int(carrier)] for k, (place, carrier) in enumerate(rows))

    return save


def _unknowns(found: Matrices) -> Write:
    def save(path: Path) -> None:
        with open(path, "w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["unknown", "body", "node", "component"])
            for k, (body, node, component) in enumerate(zip(*(one.tolist() for one in found.places), strict=True)):
                table.writerow([k, "", "", "pressure"] if body < 0 else [k, body, node, "xyz"[component]])

    return save
