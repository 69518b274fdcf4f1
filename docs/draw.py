"""The pictures of the gallery, each drawn from its example: python docs/draw.py [NAME ...]."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from isorod import Body, LinearElastic, Model, Space, files
from isorod.command import run, solving
from isorod.output import curves

FOLDER = Path(__file__).parent / "gallery"
EXAMPLES = Path(files.__file__).parent / "examples"
SIZE, UPRIGHT = (800, 450), (450, 600)
# Colours of a picture: what is beyond is not seen, and kept small.
COLOURS = 128

# Of each example how it is looked at; a mode is the last one.
VIEWS: dict[str, dict[str, Any]] = {
    "starter": {"view": (1.0, -0.2, 0.25), "scale": 10.0, "size": UPRIGHT},
    "arc": {"view": (-0.3, -1.0, 0.5), "scale": 20.0},
    "coil": {},
    "spring": {},
    "bar": {"view": (1.0, -0.2, 0.25), "scale": 20.0, "size": UPRIGHT},
    "taper": {"view": (1.0, -0.6, 0.45), "scale": 200.0, "size": UPRIGHT},
    "cable": {"view": (1.0, -0.3, 0.6), "colour": "displacement", "scale": 5.0, "size": UPRIGHT},
    "press": {"view": (0.0, 0.0, 1.0)},
    "crossing": {"view": (1.0, -1.6, 0.35)},
    "cord": {"view": (1.0, -0.3, 0.35), "colour": "displacement", "size": UPRIGHT},
    "muscle": {"view": (0.2, -1.0, 0.3), "size": UPRIGHT},
    "wing": {"view": (1.0, -1.0, 0.35), "size": UPRIGHT},
    "trefoil": {"view": (0.3, -0.6, 1.0)},
    "weld": {"view": (1.0, -0.2, 0.25), "scale": 200.0, "size": UPRIGHT},
    "tendon": {"view": (-0.2, -1.0, 0.25), "size": UPRIGHT},
    "screw": {"view": (1.0, -0.2, 0.25), "scale": 50.0, "size": UPRIGHT},
    "buckling": {"view": (0.3, -1.0, 0.2), "size": UPRIGHT},
    "stent": {"view": (1.0, -1.4, 0.6)},
    "shaker": {"size": (800, 560)},
    "valve": {"view": (1.0, -1.2, 0.35), "size": UPRIGHT},
    "flower": {"view": (1.0, -1.4, 1.2)},
    "ring": {"view": (1.0, -1.4, 1.2)},
}


def draw(name: str, folder: Path) -> Path:
    """Solve an example with nothing chosen, draw it and return the file, which is in the folder."""
    scene = files.find(str(EXAMPLES / f"{name}.toml"))
    scene = replace(scene, case=scene.cases[-1]) if scene.cases else scene
    if scene.analysis == "geometry":
        picture = _shape(scene.rods(), **VIEWS[name])
    elif scene.analysis == "harmonic":
        return _transfer(scene, folder / f"{name}.png", **VIEWS[name])
    else:
        solution, _ = solving.solve(scene, scene.settings())
        shown = {"modal": -1, "buckling": 0}.get(scene.analysis)
        shown = solution if shown is None else solution[shown]
        picture = shown.plot(**{"size": SIZE} | VIEWS[name])
    file = folder / f"{name}.png"
    picture.convert("RGB").quantize(COLOURS, dither=0).save(file, optimize=True)
    return file


def _transfer(scene: Any, file: Path, size: tuple[int, int]) -> Path:
    """Draw amplitude and phase over frequency, as `isorod plot` does."""
    solution, _ = solving.solve(scene, scene.settings())
    response = scene.measure(solution)["response"]
    curves.draw(solution.curves() | run.swinging(scene, response), scene.title, size, file, {})
    return file


def _shape(rods: list[Any], view: tuple[float, float, float]) -> Any:
    """Return a picture of rods at rest with their control points."""
    import numpy as np
    import pyvista
    from PIL import Image

    from isorod.output import picture, vtk

    picture.check(view, SIZE)
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE), border=False)
    plotter.set_background("white")
    shown = []
    for rod in rods:
        body = Body(Space(rod), LinearElastic(E=1.0, nu=0.0))
        Model([body])
        mesh = vtk.grid(body, {}, around=96, slices=24)
        plotter.add_mesh(mesh.extract_surface(algorithm="dataset_surface"), color="#8fb4d9", smooth_shading=True)
        points = rod.control_points.reshape(-1, 3)
        plotter.add_mesh(pyvista.PolyData(points), color="#c0392b", point_size=9, render_points_as_spheres=True)
        shown += [mesh.points, points]
    picture.look(plotter.camera, np.concatenate(shown), view, SIZE, room=0)
    image = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image


if __name__ == "__main__":
    for one in sys.argv[1:] or VIEWS:
        print(draw(one, FOLDER))
