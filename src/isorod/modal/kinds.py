"""Classification of modes: bending, torsion or stretching of a rod, or likeness to the deflection by a load.

The kinetic energy of a rod is decomposed: that of its sections' mean displacement along their normal (axial) and across
it (bending), and of their mean rotation about the normal (torsion, `isorod.model.mean`).  Modes of one frequency, as of
bending of a round rod, span a space: of its vectors the one is taken that has most of the kind asked for.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, whole_number
from isorod.output.rotations import direction
from isorod.output.section_forces import centroids, frames

if TYPE_CHECKING:
    from isorod.modal.modes import Modes
    from isorod.model.body import Body

Kind = Literal["bending", "torsion", "axial"]

# Relative distance up to which eigenvalues count as one: rounding, and the split of a round rod's by discretisation.
_SAME = 1e-3

# A mode is of a kind if more than half of the rod's energy is, and the rod has this fraction of the model's.
_MOST, _MOVES = 0.5, 0.02

# Elements that are evaluated at a time: memory stays small.
_CHUNK = 8


class Like(NamedTuple):
    """The frequency of a mode, and the fraction of the rod's kinetic energy of the kind asked for, or the MAC."""

    frequency: float
    fraction: float


def of_rod(modes: "Modes", body: int, kind: Kind, towards: Array | None = None, number: int = 1) -> Like:
    """Return the ``number``-th mode, from 1, mostly of a kind; of bending ``towards`` a direction, or any.

    Raises
    ------
    InputError
        If no such mode is among those computed, or the modes are those of a spinning body.
    """
    whole_number("number", number, 1, 1_000_000)
    if towards is not None and kind != "bending":
        raise InputError(f"direction: it goes with bending, and not with {kind}")
    axis = None if towards is None else direction("direction", towards)
    _refuse_spin(modes)
    own, whole = _energies(modes, modes.model.bodies[body], body, kind, axis)
    likes, largest = [], 0.0
    for some in _clusters(modes):
        part, all_of_it = own[np.ix_(some, some)], whole[np.ix_(some, some)]
        values, vectors = np.linalg.eigh(part - _MOST * all_of_it)
        for value, x in zip(values[::-1], vectors.T[::-1], strict=True):
            fraction = float(x @ part @ x / (x @ all_of_it @ x)) if x @ all_of_it @ x > _MOVES else 0.0
            largest = max(largest, fraction)
            if value > 0.0 and fraction > _MOST:
                likes.append(Like(_frequency(modes.eigenvalues[some], x), fraction))
    if len(likes) < number:
        raise InputError(
            f"number: got {number}, but of {len(modes) - modes.rigid} modes {len(likes)} are mostly {kind} of this rod "
            f"(largest share {100.0 * largest:.0f} % of its kinetic energy); ask for more modes"
            + (", or another direction" if towards is not None else "")
        )
    return likes[number - 1]


def of_load(modes: "Modes", load: int) -> Like:
    """Return the mode most like the deflection of the model at rest by a load: the one with the largest MAC.

    The deflection ``K^-1 f`` is ``sum phi_k (phi_k f) / lambda_k``; the MAC is taken with the sum over modes.

    Raises
    ------
    InputError
        If the load moves none of the modes, or they are those of a spinning body.
    """
    _refuse_spin(modes)
    asked, model = modes.model.loads[load], modes.model
    body = model.bodies[asked.body]
    force = np.ravel(asked.nodal(body.space))
    shapes = np.array([model.nodal(vector, asked.body).ravel() for vector in modes.vectors])
    parts = np.zeros(len(modes))
    flexible = slice(modes.rigid, None)
    parts[flexible] = (shapes[flexible] @ force / modes.eigenvalues[flexible]) ** 2
    clusters = list(_clusters(modes))
    sums = [parts[some].sum() for some in clusters]
    if not parts.sum() > 0.0:
        raise InputError("load: none of the modes moves where it acts, along it; ask for more modes")
    some = clusters[int(np.argmax(sums))]
    weights = np.sqrt(parts[some])
    return Like(_frequency(modes.eigenvalues[some], weights / np.linalg.norm(weights)), max(sums) / parts.sum())


def _refuse_spin(modes: "Modes") -> None:
    if modes.quarter is not None:
        raise InputError("frequency: modes of what spins whirl, and are of no one kind; read them from frequencies")


def _frequency(eigenvalues: Array, x: Array) -> float:
    value = float(x**2 @ eigenvalues)
    return float(np.copysign(np.sqrt(abs(value)), value) / (2.0 * np.pi))


def _clusters(modes: "Modes") -> Iterator[Array]:
    """Yield the numbers of modes grouped by frequency, rigid ones left out."""
    numbers, values = np.arange(modes.rigid, len(modes)), modes.eigenvalues[modes.rigid :]
    apart = np.diff(values) > _SAME * np.abs(values[1:])
    yield from (one for one in np.split(numbers, np.flatnonzero(apart) + 1) if one.size)


def _energies(modes: "Modes", body: "Body", number: int, kind: Kind, towards: Array | None) -> tuple[Array, Array]:
    """Return ``phi_k S phi_l`` of the kind asked for, and of the mass of the rod, shape ``(modes, modes)`` each."""
    space = body.space
    nodal = [modes.model.nodal(vector, number) for vector in modes.vectors]
    at = np.zeros_like(nodal[0]) if modes.state is None else modes.model.nodal(modes.state, number)
    own, whole = np.zeros((2, len(nodal), len(nodal)))
    for begin in range(0, space.axis.elements, _CHUNK):
        table = space.tabulate(begin, min(begin + _CHUNK, space.axis.elements))
        u, points = table.u.ravel(), table.weights.shape[-1]
        mass = (table.weights * body.densities_at(table)).reshape(u.size, points)
        rest, jacobian = space.rod.grid(table.xi, u)
        moved, F = space.displacement(at, table.xi, u)
        normal = frames(F @ jacobian, table.weights[0, 0])[:, 0]
        places = rest + moved
        shapes = np.stack([space.displacement(one, table.xi, u)[0] for one in nodal])
        whole += np.einsum("tq,ktqa,ltqa->kl", mass, shapes, shapes, optimize=True)
        total = mass.sum(axis=1)
        if kind == "torsion":
            arms = np.cross(normal[:, None], places - centroids(places, mass)[:, None])
            polar = np.einsum("tq,tqa,tqa->t", mass, arms, arms)
            turned = np.einsum("tq,tqa,ktqa->kt", mass, arms, shapes) / np.sqrt(polar)
            own += turned @ turned.T
            continue
        means = np.einsum("tq,ktqa->kta", mass, shapes) / np.sqrt(total)[:, None]
        along = np.einsum("kta,ta->kt", means, normal)
        if kind == "axial":
            part = along[..., None]
        elif towards is None:
            part = means - along[..., None] * normal
        else:
            across = towards - (normal @ towards)[:, None] * normal
            part = np.einsum("kta,ta->kt", means, across)[..., None]
        own += np.einsum("kta,lta->kl", part, part)
    return own, whole
