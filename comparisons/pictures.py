"""Pictures of fields, rendered without a display."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from comparisons import published, timing
from comparisons.study import Run
from isorod import export, scenes, statics
from isorod.results import write_beside

SIZE = (1600, 720)


def spring(study: Run) -> None:
    """Render Fig. 8: von Mises stress on the deformed spring, cylindrical element and finite elements on one scale."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    import pyvista

    scene = scenes.find("spring")(E=published.SPRING_E, nu=published.SPRING_NU, elements_per_turn=8, degree=3)
    model = scene.model()
    solution = statics.solve(model)
    ours = export.grid(model.bodies[0], {"displacement": model.nodal(solution.displacement)})
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


def _side_by_side(panels: Any, scale: tuple[float, float], path: Path) -> None:
    import pyvista

    plotter = pyvista.Plotter(shape=(1, len(panels)), off_screen=True, window_size=SIZE, border=False)
    plotter.set_background("white")
    for column, (mesh, label) in enumerate(panels):
        plotter.subplot(0, column)
        surface = mesh.warp_by_vector("displacement").extract_surface(algorithm="dataset_surface")
        plotter.add_mesh(
            surface,
            scalars="von_mises",
            clim=scale,
            cmap="turbo",
            smooth_shading=True,
            split_sharp_edges=True,
            show_scalar_bar=column == len(panels) - 1,
            scalar_bar_args={
                "title": "von Mises",
                "vertical": True,
                "position_x": 0.89,
                "position_y": 0.15,
                "height": 0.7,
                "color": "black",
                "n_labels": 6,
                "fmt": "%.0f",
            },
        )
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
