"""Pictures of a comparison: isorod's solution and that of finite elements beside each other, seen alike."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure import sampled
from comparisons.measure.records import Record, family
from comparisons.measure.sampled import GAUSS, Sample
from comparisons.measure.study import Run
from isorod.arrays import Array, Index
from isorod.command import solving
from isorod.output import picture, solids, vtk
from isorod.output.results import write_beside
from isorod.output.words import FIELDS, STRESS_ERROR, stress_error
from meshes.mesh import lexicographic

# Width and height of a panel, pixels.
PANEL = (800, 560)

# Of meshes of ready scenes (`meshes.rods.build`).
LEVEL = "2"

# Modes that are shown, as many as rows.
SHAPES = 3

# An axis other than z is upright only if the rods then look larger by this factor.
LYING = 1.3

_EQUILIBRIUM = (
    "Deformed, coloured by von Mises stress on one scale, left isorod by default, right dolfinx on its finest mesh. "
    "What is above the scale, at held edges, has the colour of its end."
)
_MODES = (
    "The first mode shapes, left isorod by default, right dolfinx on its finest mesh, coloured by the size of the "
    "displacement; grey lines are the rods at rest. Where frequencies lie within 2 % of each other, any combination is "
    "nearly a shape: isorod's that is nearest to that of dolfinx is drawn."
)

# Nodes at which shapes are brought into line.
_PLACES = 400

# The largest displacement of a mode is drawn as this fraction of the rods' size.
EXAGGERATION = 0.12


def of_scene(study: Run, scene: Any) -> tuple[Any, Sample]:
    """Solve a ready scene, and it with dolfinx, and draw both; return isorod's solution and the other's fields."""
    settings = scene.settings()
    solution, seconds = solving.solve(scene, settings)
    ours = solving.record(scene, solution, seconds, settings) | solving.estimate(solution, True)
    theirs, sample = sampled.of_finite_elements(scene.name, "--level", LEVEL)
    write(study, solution, [ours, theirs], sample)
    return solution, sample


def write(study: Run, solution: Any, records: Sequence[Record], sample: Sample) -> None:
    """Draw deformed rods coloured by von Mises stress, or the first mode shapes, and record the files.

    Parameters
    ----------
    study
        Where they go.
    solution
        Isorod's.
    records
        Its record and the finite elements', whose fields ``sample`` are.
    """
    picture.check((1.0, 0.0, 0.0), PANEL)
    modal = sample.modes is not None
    rows = _modes(solution, sample, records[0]) if modal else [_equilibrium(solution, sample)]
    peak = max(float(np.max(mesh.point_data["colour"])) for row in rows for mesh in row)
    # Stresses at held edges have no limit: what nearly all of the rods have fills the scale, of the side with fewer
    # nodes at such edges, where isorod's elements are short.
    ticks = picture.scaled(0.0, 1.0 if modal else min(peak, *map(_most, rows[0])))
    lines = [_at_rest(body) for body in solution.model.bodies] if modal else []
    names = f"isorod ({family(records[0])})", "dolfinx"
    labels = [f"{name}, {one['dofs']:,} unknowns" for name, one in zip(names, records, strict=True)]
    if not modal:
        labels[0] += f"\n{stress_error(records[0].get(STRESS_ERROR))}"
    file = f"{study.study}-picture.png"
    write_beside(study.folder / file, partial(_draw, rows, lines, _captions(rows, labels, records), ticks, modal))
    caption = _MODES if modal else _EQUILIBRIUM
    alt = "mode shapes of both sides" if modal else "von Mises stress of both sides on the deformed rods"
    study.record("picture", {"file": file, "alt": alt, "caption": caption})


def _at_rest(body: Any) -> Array:
    """Return a rod's centre line, of a hollow one that of its hole, shape ``(m, 3)``."""
    breaks = body.space.rod.axis.breaks
    u = np.linspace(breaks[0], breaks[-1], 50 * body.space.axis.elements)
    angle, hole = np.linspace(0.0, 2.0 * np.pi, 33)[:-1], body.space.rod.rings[0]
    return np.asarray(body.space.rod.grid(hole * np.stack([np.cos(angle), np.sin(angle)], axis=1), u)[0].mean(axis=1))


def _most(mesh: Any) -> float:
    return float(np.quantile(mesh.point_data["colour"], 0.995))


def _captions(rows: Sequence[Any], labels: Sequence[str], records: Sequence[Record]) -> list[list[str]]:
    if len(rows) == 1 and "frequencies" not in records[0]:
        return [list(labels)]
    captions = []
    for k in range(len(rows)):
        values = [one["frequencies"][one.get("rigid", 0) + k] for one in records]
        captions.append([f"{label}\nmode {k + 1}: {value:.5g}" for label, value in zip(labels, values, strict=True)])
    return captions


def _equilibrium(solution: Any, sample: Sample) -> tuple[Any, Any]:
    assert sample.displacement is not None and sample.von_mises is not None
    fields = [solution.fields(k) for k in range(len(solution.model.bodies))]
    ours = _joined(solution, fields, solution.solids, "von_mises", solution.factor)
    if sample.reference is not None:
        return ours, _tetrahedra(sample, sample.displacement, sample.von_mises.reshape(sample.cells.shape))
    corners = GAUSS - 0.5
    # Of each brick, the linear function through its Gauss points, at its nodes.
    where = (lexicographic(sample.order, 3) - 0.5)[:, None, :]
    shape = np.prod(0.5 + 6.0 * corners * where, axis=2)
    stress = sample.von_mises.reshape(-1, len(GAUSS)) @ shape.T
    theirs = _bricks(sample, sample.displacement, np.maximum(stress, 0.0))
    return ours, theirs


def _modes(solution: Any, sample: Sample, record: Record) -> list[tuple[Any, Any]]:
    assert sample.modes is not None
    size = float(np.linalg.norm(np.ptp(sample.points, axis=0)))
    rows = []
    some = np.unique(np.linspace(0, len(sample.points) - 1, _PLACES).astype(np.int64))
    places = replace(sample.places, **{name: getattr(sample.places, name)[some] for name in ("rod", "xi", "u")})
    known, frequencies = sampled.fields(solution, places)["modes"], solution.frequencies[solution.rigid :]
    for k, theirs in enumerate(sample.modes[:SHAPES]):
        near = np.abs(frequencies / frequencies[k] - 1.0) < sampled.CLOSE
        factors = np.zeros(len(solution))
        factors[solution.rigid :][near] = sampled.combination(known[near], theirs[some])
        nodal = [solution.model.nodal(factors @ solution.vectors, b) for b in range(len(solution.model.bodies))]
        moved = [np.tensordot(factors, one, 1) for one in solution.solids]
        ours = _joined(solution, [{"displacement": one} for one in nodal], moved, "displacement", 1.0)
        lengths = np.linalg.norm(theirs, axis=1)
        other = (_bricks if sample.reference is None else _tetrahedra)(sample, theirs, lengths[sample.cells])
        for mesh in (ours, other):
            largest = float(np.max(np.linalg.norm(mesh.point_data["motion"], axis=1)))
            mesh.point_data["colour"] = np.linalg.norm(mesh.point_data["motion"], axis=1) / largest
            mesh.point_data["motion"] *= EXAGGERATION * size / largest
        rows.append((ours, other))
    return rows


def _joined(
    solution: Any, fields: Sequence[dict[str, Array]], moved: Sequence[Array], colour: str, factor: float
) -> Any:
    """Return all bodies at rest as one mesh with their ``motion`` and ``colour``; ``moved`` is that of solids."""
    import pyvista

    meshes = [
        vtk.grid(body, own, rings=3, around=48, slices=12, factor=factor)
        for body, own in zip(solution.model.bodies, fields, strict=True)
    ]
    for solid, own in zip(solution.model.solids, moved, strict=True):
        meshes.append(solids.grid(solid, {"displacement": own}, factor))
    for mesh in meshes:
        mesh.point_data["motion"] = mesh.point_data["displacement"]
        if colour == "von_mises":
            mesh.point_data["colour"] = mesh.point_data["von_mises"]
        else:
            mesh.point_data["colour"] = np.linalg.norm(mesh.point_data["motion"], axis=1)
    return meshes[0] if len(meshes) == 1 else pyvista.merge(meshes, merge_points=False)


def _bricks(sample: Sample, motion: Array, colour: Array) -> Any:
    """Return bricks as small ones, each with points of its own; ``colour`` is by brick and node."""
    import pyvista

    p = sample.order
    own = np.arange(sample.cells.size).reshape(sample.cells.shape)
    small: Index = np.concatenate([own[:, corners] for corners in _corners(p)])
    mesh = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: small}, sample.points[sample.cells.ravel()])
    mesh.point_data["motion"] = motion[sample.cells.ravel()]
    mesh.point_data["colour"] = colour.ravel()
    return mesh


def _tetrahedra(sample: Sample, motion: Array, colour: Array) -> Any:
    """Return the surface of tetrahedra of degree 2 as small triangles; ``colour`` is by cell and node."""
    import pyvista

    reference = sample.reference
    assert reference is not None
    sides = []
    for left_out in np.eye(4, 3, -1):
        # The side opposite to a corner; its corners, then the middles between them.
        weights = np.column_stack([1.0 - reference.sum(axis=1), reference])
        opposite = int(np.argmax(left_out)) + 1 if left_out.any() else 0
        on = np.flatnonzero(weights[:, opposite] == 0.0)
        ends = on[weights[on].max(axis=1) == 1.0]
        between = [
            on[np.linalg.norm(reference[on] - 0.5 * (reference[a] + reference[b]), axis=1).argmin()]
            for a, b in zip(ends, np.roll(ends, -1), strict=True)
        ]
        sides.append([*ends, *between])
    corners = np.sort(np.concatenate([sample.cells[:, side[:3]] for side in sides]), axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    side, cell = np.divmod(first[count == 1], len(sample.cells))
    local = np.array(sides)[side]
    nodes, shown = sample.cells[cell[:, None], local], colour[cell[:, None], local]
    small = np.array([(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)])
    triangles = (6 * np.arange(len(nodes))[:, None, None] + small).reshape(-1, 3)
    mesh = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: triangles}, sample.points[nodes.ravel()])
    mesh.point_data["motion"] = motion[nodes.ravel()]
    mesh.point_data["colour"] = shown.ravel()
    return mesh


def _corners(p: int) -> list[list[int]]:
    """Return the corners of the small bricks of one of degree ``p``, whose nodes go along its first axis first."""
    number = np.arange((p + 1) ** 3).reshape(p + 1, p + 1, p + 1)
    quad = ((0, 0), (0, 1), (1, 1), (1, 0))
    return [
        [int(number[c + k, b + j, a + i]) for k in (0, 1) for j, i in quad]
        for a in range(p)
        for b in range(p)
        for c in range(p)
    ]


def _draw(
    rows: Sequence[Any],
    lines: Sequence[Array],
    captions: Sequence[Sequence[str]],
    ticks: Array,
    modal: bool,
    path: Path,
) -> None:
    import pyvista

    moved = [mesh.points + mesh.point_data["motion"] for row in rows for mesh in row]
    everything = np.concatenate([*moved, *lines])
    view, up = _direction(everything)
    title = "displacement\n(largest is 1)" if modal else FIELDS["von_mises"]
    with picture.stage((2 * PANEL[0], len(rows) * PANEL[1]), shape=(len(rows), 2)) as plotter:
        for k, row in enumerate(rows):
            for column, mesh in enumerate(row):
                plotter.subplot(k, column)
                bar = picture.bar(title, PANEL, len(ticks)) if column else None
                picture.add_flat(plotter, mesh, "colour", (ticks[0], ticks[-1]), bar, "motion")
                for line in lines:
                    plotter.add_mesh(pyvista.lines_from_points(line), color="grey", line_width=2, lighting=False)
                caption = captions[k][column] if modal else f"{captions[k][column]}\ndisplacements × 1"
                plotter.add_text(caption, position="upper_left", font_size=11, color="black")
                if column:
                    picture.add_axes(plotter, PANEL)
                picture.look(plotter.camera, everything, view, PANEL, up, words=caption)
        plotter.screenshot(str(path))


def _direction(points: Array) -> tuple[Array, Array]:
    """Return the direction of view that fills a panel most, and the upright axis: z, unless another is far better."""

    def height(view: Array, up: Array) -> float:
        towards = view / np.linalg.norm(view)
        right = np.cross(up, towards)
        right /= np.linalg.norm(right)
        wide, high = (float(np.ptp(points @ axis)) for axis in (right, np.cross(towards, right)))
        return max(high, wide * PANEL[1] / PANEL[0]) * (1.0 if up[2] else LYING)

    upright = np.array([0.0, 0.0, 1.0])
    seen = [
        (np.roll(picture.view_of(np.roll(points, -turn, axis=1)), turn), np.roll(upright, turn)) for turn in range(3)
    ]
    return min(seen, key=lambda one: height(*one))
