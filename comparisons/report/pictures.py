"""Pictures of fields, rendered without a display."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure import published, timing
from comparisons.measure.study import Run
from isorod import scenes, statics
from isorod.modal import Modes
from isorod.output import vtk
from isorod.output.results import write_beside

SIZE = (1600, 720)

# The scale of stresses, at the right of a panel.
BAR: dict[str, Any] = {
    "title": "von Mises",
    "vertical": True,
    "position_x": 0.89,
    "position_y": 0.15,
    "height": 0.7,
    "color": "black",
    "n_labels": 6,
    "fmt": "%.0f",
}


def spring(study: Run) -> None:
    """Render Fig. 8: von Mises stress on the deformed spring, cylindrical element and finite elements on one scale."""
    without_display()
    import pyvista

    scene = scenes.find("spring")(E=published.SPRING_E, nu=published.SPRING_NU, elements_per_turn=8, degree=3)
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
        (ours, f"cylindrical element, {model.dofs:,} unknowns"),
        (theirs, f"Q2 bricks (dolfinx), {record['dofs']:,} unknowns"),
    )
    path = study.folder / "spring-von-mises.png"
    write_beside(path, lambda where: _side_by_side(panels, published.SPRING_STRESS_SCALE, where))
    peaks = [float(np.max(mesh.point_data["von_mises"])) for mesh, _ in panels]
    study.record("picture", {"file": path.name, "largest_von_mises": peaks, "labels": [label for _, label in panels]})


def modes(study: Run, found: Modes, rows: int = 2, exaggeration: float = 0.12) -> None:
    """Render Fig. 12: mode shapes over the body at rest, coloured by the size of the displacement.

    The largest displacement is drawn as ``exaggeration`` times the body's size.
    """
    without_display()
    import pyvista

    body = found.model.bodies[0]
    shapes = {f"mode {k + 1}": found.model.nodal(vector) for k, vector in enumerate(found.vectors)}
    # Displacements do not jump: merged points leave no faces inside.
    mesh = vtk.grid(body, shapes, rings=3, around=48, slices=3).clean(tolerance=1e-6)
    columns = -(-len(shapes) // rows)
    plotter = pyvista.Plotter(shape=(rows, columns), off_screen=True, window_size=(1700, 1000), border=False)
    plotter.set_background("white")
    rest = mesh.extract_surface(algorithm="dataset_surface")
    for k, (name, frequency) in enumerate(zip(shapes, found.frequencies, strict=True)):
        plotter.subplot(*divmod(k, columns))
        size = np.linalg.norm(mesh.point_data[name], axis=1)
        mesh.point_data["size"] = size / size.max()
        moved = mesh.warp_by_vector(name, factor=exaggeration * mesh.length / size.max())
        plotter.add_mesh(rest.extract_feature_edges(30.0), color="black", line_width=1)
        plotter.add_mesh(
            moved.extract_surface(algorithm="dataset_surface"),
            scalars="size",
            cmap="viridis",
            clim=(0.0, 1.0),
            smooth_shading=True,
            split_sharp_edges=True,
            show_scalar_bar=False,
            ambient=0.35,
        )
        plotter.add_text(f"{k + 1}: {frequency:.4g} Hz", position="upper_left", font_size=12, color="black")
        plotter.camera_position = [(1.0, -1.4, 0.55), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
        plotter.reset_camera()
        plotter.camera.zoom(1.35)
    path = study.folder / "blade-modes.png"
    write_beside(path, lambda where: plotter.screenshot(str(where)))
    plotter.close()
    study.record("picture", {"file": path.name})


def without_display() -> None:
    """Let VTK draw off screen; must come before pyvista is imported."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def add_von_mises(plotter: Any, mesh: Any, scale: tuple[float, float], bar: dict[str, Any] | None) -> None:
    """Add the deformed surface of a mesh with ``displacement`` and ``von_mises``, coloured by the latter.

    ``bar`` describes its scale.
    """
    plotter.add_mesh(
        mesh.warp_by_vector("displacement").extract_surface(algorithm="dataset_surface"),
        scalars="von_mises",
        clim=scale,
        cmap="turbo",
        smooth_shading=True,
        split_sharp_edges=True,
        show_scalar_bar=bar is not None,
        scalar_bar_args=bar,
    )


def _side_by_side(panels: Any, scale: tuple[float, float], path: Path) -> None:
    import pyvista

    plotter = pyvista.Plotter(shape=(1, len(panels)), off_screen=True, window_size=SIZE, border=False)
    plotter.set_background("white")
    for column, (mesh, label) in enumerate(panels):
        plotter.subplot(0, column)
        add_von_mises(plotter, mesh, scale, BAR if column == len(panels) - 1 else None)
        plotter.add_text(label, position="upper_left", font_size=14, color="black")
        plotter.camera_position = "xz"
        plotter.camera.elevation = 25
        plotter.camera.azimuth = 20
        plotter.reset_camera()
        # Room for the scalar bar, the same in every panel.
        plotter.camera.focal_point = (1.2, 0.0, plotter.camera.focal_point[2])
        plotter.camera.zoom(1.15)
    plotter.screenshot(str(path))
    plotter.close()
