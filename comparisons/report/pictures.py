"""Pictures of fields, rendered without a display."""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure import published, timing
from comparisons.measure.study import Run
from isorod import scenes, statics
from isorod.modal import Modes
from isorod.output import vtk
from isorod.output.picture import add_flat, bar, look, stage, without_display
from isorod.output.results import write_beside
from isorod.output.words import FIELDS

SIZE = (1600, 640)

# Beside the scale of the published figure.
_NUMBERS = 6


def spring(study: Run) -> None:
    """Render Fig. 8: von Mises stress on the deformed spring, the paper's element and finite elements on one scale."""
    without_display()
    import pyvista

    scene = scenes.find("spring")(preset="paper", E=published.SPRING_E, nu=published.SPRING_NU)
    model = scene.model()
    solution = statics.solve(model)
    ours = vtk.grid(model.bodies[0], {"displacement": model.nodal(solution.displacement)})
    bricks = ["--degree", "2", "--around", "8", "--layers", "72"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fields.npz"
        record = timing.run("comparisons.fem", ["spring", *bricks, "--fields", str(file)])
        with np.load(file) as arrays:
            theirs = pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: arrays["cells"]}, arrays["points"])
            theirs.point_data["displacement"] = arrays["displacement"]
            theirs.point_data["von_mises"] = arrays["von_mises"]
    panels = (
        (ours, f"isorod ({model.bodies[0].space.basis.family}), {model.dofs:,} unknowns"),
        (theirs, f"Q2 bricks (dolfinx), {record['dofs']:,} unknowns"),
    )
    path = study.folder / "spring-von-mises.png"
    write_beside(path, partial(_beside, panels, published.SPRING_STRESS_SCALE))
    peaks = [float(np.max(mesh.point_data["von_mises"])) for mesh, _ in panels]
    labels = [label for _, label in panels]
    study.record("picture", {"file": path.name, "largest_von_mises": peaks, "labels": labels})


def modes(study: Run, found: Modes, exaggeration: float = 0.12) -> None:
    """Render Fig. 12: mode shapes over the body at rest, coloured by the size of the displacement.

    The largest displacement is drawn as ``exaggeration`` times the body's size.
    """
    without_display()
    body = found.model.bodies[0]
    shapes = {f"mode {k + 1}": found.model.nodal(vector) for k, vector in enumerate(found.vectors)}
    # Displacements do not jump: merged points leave no faces inside.
    mesh = vtk.grid(body, shapes, rings=3, around=48, slices=3).clean(tolerance=1e-6)
    names = [f"{k + 1}\n{frequency:.4g} Hz" for k, frequency in enumerate(found.frequencies)]
    path = study.folder / "blade-modes.png"
    write_beside(path, partial(_modes, mesh, names, exaggeration))
    study.record("picture", {"file": path.name})


def _modes(mesh: Any, names: list[str], exaggeration: float, path: Path) -> None:
    columns = -(-len(names) // 2)
    rest = mesh.extract_surface(algorithm="dataset_surface").extract_feature_edges(30.0)
    with stage((1700, 1000), shape=(2, columns)) as plotter:
        for k, name in enumerate(names):
            plotter.subplot(*divmod(k, columns))
            moved = mesh.copy()
            shape = moved.point_data[f"mode {k + 1}"]
            length = np.linalg.norm(shape, axis=1)
            moved.point_data["size"] = length / length.max()
            moved.point_data["displacement"] = exaggeration * mesh.length / length.max() * shape
            plotter.add_mesh(rest, color="grey", line_width=1)
            add_flat(plotter, moved, "size", (0.0, 1.0), None)
            plotter.add_text(name, position="upper_left", font_size=14, color="black")
            look(plotter.camera, moved.points, None, (1700 // columns, 500), room=0, words=name)
        plotter.screenshot(str(path))


def _beside(panels: Any, scale: tuple[float, float], path: Path) -> None:
    """Draw panels side by side."""
    described = bar(FIELDS["von_mises"], (SIZE[0] // len(panels), SIZE[1]), _NUMBERS)
    with stage(SIZE, shape=(1, len(panels))) as plotter:
        for k, (mesh, label) in enumerate(panels):
            plotter.subplot(0, k)
            add_flat(plotter, mesh, "von_mises", scale, described if k == len(panels) - 1 else None)
            plotter.add_text(label, position="upper_left", font_size=14, color="black")
            plotter.camera_position = "xz"
            plotter.camera.elevation = 25
            plotter.camera.azimuth = 20
            plotter.reset_camera()
            # Room for the scalar bar, the same in every panel.
            plotter.camera.focal_point = (1.2, 0.0, plotter.camera.focal_point[2])
            plotter.camera.zoom(1.3)
        plotter.screenshot(str(path))
