"""The outer surfaces that pictures are drawn of: nothing from within, and lines where elements end."""

import numpy as np
import pytest
from conftest import straight

from isorod import arc, circle
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body
from isorod.output import skin, vtk
from isorod.space import Space

pytest.importorskip("pyvista")

RADIUS, HEIGHT, ELEMENTS = 0.5, 6.0, 3


def meshes(rod, law, **space):
    """Return a rod at rest in small linear cells, and in those of curved ones."""
    body = Body(Space(rod, elements=ELEMENTS, degree=3, **space), law)
    fields = {"displacement": np.zeros((body.space.nodes, 3))}
    return {
        "linear": vtk.grid(body, fields, around=64),
        "curved": vtk.small_cells(vtk.grid(body, fields, curved=True)),
    }


@pytest.mark.parametrize("cells", ["linear", "curved"])
def test_a_rod_has_the_area_of_its_outside(cells):
    """Of a cylinder, with both its ends; what is between elements, and between the cells of one, is left out."""
    mesh = meshes(straight(4, radius=RADIUS, height=HEIGHT), NeoHookean(1.0, 0.3), section_degree=2)[cells]
    found = skin.skin(mesh)
    exact = 2.0 * np.pi * RADIUS * (HEIGHT + RADIUS)
    assert found.faces.area == pytest.approx(exact, rel=3e-3)
    assert found.whole.area == pytest.approx(exact, rel=3e-3)
    # Closed, when pieces share points.
    assert found.whole.n_open_edges == 0


@pytest.mark.parametrize("cells", ["linear", "curved"])
def test_a_tube_of_two_layers_has_an_inside(cells):
    rod = straight(4, radius=RADIUS, height=HEIGHT).with_rings([0.5, 0.8, 1.0])
    laws = [LinearElastic(1.0, 0.3), LinearElastic(2.0, 0.3)]
    found = skin.skin(meshes(rod, laws, section_degree=2)[cells])
    hole = 0.5 * RADIUS
    exact = 2.0 * np.pi * ((RADIUS + hole) * HEIGHT + RADIUS**2 - hole**2)
    assert found.faces.area == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("cells", ["linear", "curved"])
def test_lines_are_where_elements_end(cells):
    """Of a straight rod at equal heights, all of them on its surface."""
    mesh = meshes(straight(4, radius=RADIUS, height=HEIGHT), NeoHookean(1.0, 0.3), section_degree=2)[cells]
    edges = skin.skin(mesh).edges
    drawn = edges.points[np.unique(edges.lines.reshape(-1, 3)[:, 1:])]
    assert np.unique(drawn[:, 2].round(5)) == pytest.approx(HEIGHT * np.arange(ELEMENTS + 1) / ELEMENTS, abs=1e-5)
    assert np.linalg.norm(drawn[:, :2], axis=1) == pytest.approx(np.full(len(drawn), RADIUS), rel=1e-6)


def test_a_thin_rod_loses_nothing():
    """A wire 20,000 times as long as wide."""
    rod = arc(1.0, 90).sweep(circle(4, 4e-5))
    body = Body(Space(rod, elements=2, degree=3, section_degree=2), NeoHookean(1.0, 0.3))
    found = skin.skin(vtk.grid(body, {"displacement": np.zeros((body.space.nodes, 3))}, slices=40))
    assert found.faces.area == pytest.approx(2.0 * np.pi * 4e-5 * 0.5 * np.pi, rel=1e-2)


def test_a_skin_moves_with_its_fields():
    mesh = meshes(straight(4, radius=RADIUS, height=HEIGHT), NeoHookean(1.0, 0.3), section_degree=2)["linear"]
    mesh.point_data["way"] = np.tile([0.0, 2.0, 0.0], (mesh.n_points, 1))
    still = skin.skin(mesh)
    for before, after in zip(still, still.moved(0.5, "way"), strict=True):
        assert after.points - before.points == pytest.approx(np.tile([0.0, 1.0, 0.0], (before.n_points, 1)), abs=1e-12)
