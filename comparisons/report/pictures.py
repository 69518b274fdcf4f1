"""Pictures of fields, rendered without a display."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure.study import Run
from isorod.modal import Modes
from isorod.output import vtk
from isorod.output.picture import add_flat, look, stage, without_display
from isorod.output.results import write_beside


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
