"""Pictures of the biceps, from the files that the study's runs leave: Figs. 14-16 of Lu & Zhou (2011)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure.study import Run
from isorod.model import Model
from isorod.output import vtk
from isorod.output.picture import COLOURS, add_flat, bar, stage, without_display
from isorod.output.results import write_beside
from isorod.scenes.biceps import Biceps

# Files of fields: motion and equilibrium of the element, and of the finite elements.
MOTION, FEM_MOTION, FEM_REST = "biceps-motion.npz", "biceps-fem-motion.npz", "biceps-fem-equilibrium.npz"

# Times of the pictures [s], and the scale of the stress [N/cm^2].
TIMES = (0.005, 0.010, 0.015)
SCALE = (0.0, 150.0)

# Direction from the bellies to the eye, y being up.
_EYE = np.array([0.25, 0.12, 1.0])
_MIDDLE = (0.0, 10.6, 0.0)
_HALF_HEIGHT = 11.8
_CIRCLE = 2.0 * np.pi * np.arange(49) / 48


@dataclass(frozen=True)
class _Ours:
    """The element's states as meshes with ``displacement`` and ``von_mises``."""

    scene: Biceps
    model: Model
    times: Any
    displacement: Any
    equilibrium: Any

    def mesh(self, displacement: Any, activation: float = 1.0) -> Any:
        """Return both branches, one after the other; ``activation`` is a fraction of the final one."""
        grids = []
        for b, body in enumerate(self.model.bodies):
            fields = {"displacement": self.model.nodal(displacement, b)}
            grids.append(vtk.grid(body, fields, rings=1, around=40, slices=4, factor=activation))
        return grids[0].merge(grids[1], merge_points=False)

    def at(self, time: float) -> Any:
        """Return the mesh at an output."""
        k = int(np.argmin(np.abs(self.times - time)))
        fraction = min(1.0, self.times[k] / self.scene.ramp) if self.scene.ramp > 0.0 else 1.0
        return self.mesh(self.displacement[k].astype(float), fraction)

    def borders(self) -> Any:
        """Return the circles between elements, as lines, of the initial shape."""
        ring = np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE)], axis=1)
        lines = [body.space.rod.grid(ring, body.space.axis.breaks)[0] for body in self.model.bodies]
        return _lines(np.concatenate(lines))

    def net(self) -> Any:
        """Return the control points of the initial shape."""
        return np.concatenate([body.space.rod.control_points.reshape(-1, 3) for body in self.model.bodies])


@dataclass(frozen=True)
class _Theirs:
    """The finite elements' states."""

    arrays: dict[str, Any]

    @staticmethod
    def read(path: Path) -> "_Theirs":
        """Read a file of `comparisons.fem.biceps`."""
        with np.load(path) as arrays:
            return _Theirs({name: arrays[name] for name in arrays})

    @property
    def times(self) -> Any:
        """Times of the states [s]."""
        return self.arrays["times"]

    def at(self, time: float) -> Any:
        """Return the mesh at the sample next to a time."""
        import pyvista

        k = int(np.argmin(np.abs(self.times - time)))
        mesh = pyvista.UnstructuredGrid(
            {pyvista.CellType.HEXAHEDRON: self.arrays["small_cells"]}, self.arrays["small_points"]
        )
        mesh.point_data["displacement"] = self.arrays["displacement"][k]
        mesh.point_data["von_mises"] = self.arrays["von_mises"][k]
        return mesh

    def borders(self) -> Any:
        """Return the edges of the bricks, as lines, of the initial shape."""
        points = self.arrays["small_points"].reshape(len(self.arrays["cells"]), -1, 3)
        ticks = round(points.shape[1] ** (1 / 3))
        box = points.reshape(-1, ticks, ticks, ticks, 3)
        lines = []
        for a in (0, -1):
            for b in (0, -1):
                lines += [box[:, :, a, b], box[:, a, :, b], box[:, a, b, :]]
        return _lines(np.concatenate(lines))


def run(study: Run, scene: Biceps) -> None:
    """Draw the pictures from the files in the study's folder, and record their name.

    ``scene`` is the one whose motion was kept.
    """
    without_display()
    with np.load(study.folder / MOTION) as arrays:
        ours = _Ours(scene, scene.model(), arrays["times"], arrays["displacement"], arrays["equilibrium"])
    moving, still = (_Theirs.read(study.folder / name) for name in (FEM_MOTION, FEM_REST))
    picture = study.folder / "biceps-von-mises.png"
    write_beside(picture, lambda where: _picture(ours, moving, still, where))
    dofs = [ours.model.dofs, 3 * len(still.arrays["points"])]
    study.record("picture", {"file": picture.name, "dofs": dofs, "scale": SCALE})


def _picture(ours: _Ours, moving: _Theirs, still: _Theirs, path: Path) -> None:
    columns = 2 + len(TIMES)
    dofs = ours.model.dofs, 3 * len(still.arrays["points"])
    rest = ours.mesh(ours.equilibrium), still.at(0.0)
    sides: tuple[_Ours | _Theirs, ...] = (ours, moving)
    # The last column is for the scale.
    with stage((1640, 1180), shape=(2, columns + 1), col_weights=[1.0] * columns + [0.45]) as plotter:
        for row, (side, name) in enumerate(zip(sides, _names(ours.model), strict=True)):
            plotter.subplot(row, 0)
            # Undeformed, as its displacement is not asked for.
            skin = side.at(0.0).extract_surface(algorithm="dataset_surface")
            plotter.add_mesh(skin, color="#e9d8c8", smooth_shading=True)
            plotter.add_mesh(side.borders(), color="#333333", line_width=1)
            if row == 0:
                plotter.add_points(ours.net(), color="#b02020", point_size=5, render_points_as_spheres=True)
            plotter.add_text(f"{name}\n{dofs[row]:,} unknowns", position="upper_left", font_size=10, color="black")
            _look(plotter)
            for column in range(1, columns):
                plotter.subplot(row, column)
                last = column == columns - 1
                mesh = rest[row] if last else side.at(TIMES[column - 1])
                add_flat(plotter, mesh, "von_mises", SCALE, None)
                text = "equilibrium" if last else f"{1e3 * TIMES[column - 1]:g} ms"
                plotter.add_text(text, position="upper_left", font_size=11, color="black")
                _look(plotter)
            plotter.subplot(row, columns)
        _scale(plotter, bar("von Mises stress\n(N/cm²)", (int(0.45 / (columns + 0.45) * 1640), 590), 4))
        plotter.screenshot(str(path))


def _names(model: Model) -> tuple[str, str]:
    return f"isorod ({model.bodies[0].space.basis.family})", "Q2 bricks (dolfinx)"


def _scale(plotter: Any, described: dict[str, Any]) -> None:
    """Draw the scale alone into a panel."""
    import pyvista

    nothing = pyvista.PolyData(np.zeros((2, 3)))
    nothing["von_mises"] = np.array(SCALE)
    actor = plotter.add_mesh(nothing, scalars="von_mises", clim=SCALE, cmap=COLOURS, opacity=0.0, show_scalar_bar=False)
    plotter.add_scalar_bar(mapper=actor.mapper, **described)


def _look(plotter: Any) -> None:
    """Look at both branches, their tendons upright, from the same direction in every panel."""
    plotter.camera_position = [tuple(np.array(_MIDDLE) + 60.0 * _EYE), _MIDDLE, (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = _HALF_HEIGHT


def _lines(points: Any) -> Any:
    """Return polylines through points ``(lines, points, 3)``."""
    import pyvista

    count, each = points.shape[:2]
    cells = np.concatenate([np.full((count, 1), each), np.arange(count * each).reshape(count, each)], axis=1)
    return pyvista.PolyData(points.reshape(-1, 3), lines=cells.ravel())
