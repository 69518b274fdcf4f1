"""Pictures of solutions: all of the rods, in the colours of their scale, without a display."""

import sys

import numpy as np
import pytest
from conftest import straight

from isorod import modal, statics
from isorod.errors import InputError
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.output import picture
from isorod.output.state import State
from isorod.space import Space

pytest.importorskip("pyvista")

WIDTH, HEIGHT = 300, 240
# What the scale of colours leaves, and the line of words.
LEFT, TOP = WIDTH - 150, 24


def bar(height=6.0, **keywords):
    space = Space(straight(4, radius=0.5, height=height), elements=4)
    return Model([Body(space, NeoHookean(2.0, 0.3), **keywords)], [Support.end(space, "start")])


def moved(model, displacement):
    carriers = model.bodies[0].space.is_control_point[:, None]
    return State(model, (carriers * np.broadcast_to(displacement, (carriers.size, 3))).ravel())


def extent(picture):
    """Return the first and last rows and columns, left of the scale and below the words, that are not white."""
    dark = (np.asarray(picture)[TOP:, :LEFT] < 250).any(axis=2)
    rows, columns = TOP + np.flatnonzero(dark.any(axis=1)), np.flatnonzero(dark.any(axis=0))
    return rows[0], rows[-1], columns[0], columns[-1]


@pytest.fixture(scope="module")
def bent():
    model = bar()
    end = Support.end(model.bodies[0].space, "end", displacement=(1.5, 0.0, -0.5))
    return statics.solve(Model(model.bodies, [*model.supports, end]))


@pytest.mark.parametrize("view", [(1.0, -1.4, 0.55), (0.0, 0.0, 1.0), (0.0, -3.0, 0.0), (-1.0, 0.0, -20.0)])
@pytest.mark.parametrize("colour", [None, "displacement"])
def test_the_whole_rod_is_seen_and_fills_the_picture(colour, view, bent):
    image = bent.plot(colour, view=view, size=(WIDTH, HEIGHT))
    assert image.size == (WIDTH, HEIGHT)
    top, bottom, left, right = extent(image)
    assert min(top, left) > 2 and bottom < HEIGHT - 3
    assert bottom - top > 0.55 * HEIGHT or right - left > 0.55 * LEFT
    # A notebook asks for this.
    assert image._repr_png_().startswith(b"\x89PNG")


def test_scale_moves_the_rod_but_not_its_colours(bent):
    """A rod moved aside by twice its displacement, its outline at rest beside it."""
    aside = moved(bar(), (1.5, 0.0, 0.0))
    once, twice, none = (
        aside.plot("displacement", scale=scale, view=(0.0, -1.0, 0.0), size=(WIDTH, HEIGHT)) for scale in (1, 2, 0)
    )
    widths = [np.subtract(*extent(picture)[:1:-1]) for picture in (none, once, twice)]
    # Of a height of 6 the rod is 1 wide, and moved by 1.5 and 3.
    heights = [extent(picture)[1] - extent(picture)[0] for picture in (none, once, twice)]
    shares = 6.0 * np.array(widths) / np.array(heights)
    assert shares == pytest.approx([1.0, 2.5, 4.0], abs=0.2)


def test_colours_are_those_of_the_scale():
    """The bar's middle, half-way up a field that grows with the height, has the middle colour of the scale."""
    from matplotlib import colormaps

    model = bar()
    positions = model.bodies[0].space.positions
    state = State(model, (positions * [0.0, 0.0, 1.0] * 0.1).ravel())
    picture = np.asarray(state.plot("displacement", view=(0.0, -1.0, 0.0), size=(WIDTH, HEIGHT)))
    top, bottom, left, right = extent(picture)
    for share in (0.3, 0.6):
        pixel = picture[int(bottom - share * (bottom - top)), (left + right) // 2 + 4]
        assert pixel == pytest.approx(255.0 * np.array(colormaps["viridis"](share)[:3]), abs=25.0)


def test_the_scale_ends_at_round_numbers():
    assert picture.scaled(1.77, 53.0).tolist() == [0.0, 20.0, 40.0, 60.0]
    # What rounding makes of a number is no range.
    assert picture.scaled(100.0, 100.0 + 1e-9).tolist() == [0.0, 25.0, 50.0, 75.0, 100.0]
    assert picture.scaled(-3e-4, 1e-4)[[0, -1]] == pytest.approx([-3e-4, 1e-4])


@pytest.mark.parametrize("longest", [(0, 0, 1), (1, 0, 0), picture.VIEW, (-1.0, -1.4, 0.55), (1.0, -1.4, 0.0)])
def test_long_rods_are_not_foreshortened(longest):
    """Wherever a rod points to: of its length at least 0.93 is seen, and what is as long in all directions as ever."""
    along = np.array(longest) / np.linalg.norm(longest)
    points = np.linspace(-1.0, 1.0, 50)[:, None] * along
    view = picture.view_of(points)
    assert np.linalg.norm(np.cross(view, along)) > 0.93
    ball = np.concatenate([np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(picture.view_of(ball), np.array(picture.VIEW) / np.linalg.norm(picture.VIEW))


def test_a_field_without_differences_is_drawn_too():
    top, bottom, *_ = extent(moved(bar(), 0.0).plot(size=(WIDTH, HEIGHT)))
    assert bottom - top > 0.6 * HEIGHT


def slimness(picture):
    """Return width over height of what is drawn."""
    top, bottom, left, right = extent(picture)
    return (right - left) / (bottom - top)


def test_a_mode_is_drawn_so_that_it_is_seen():
    """Whatever the size of its vector: the tip of a rod of 6 times 1 goes by 12 % of its length."""
    for density in (1e-6, 1e6):
        model = bar(density=density)
        nodes = np.arange(model.bodies[0].space.layer_nodes, model.bodies[0].space.nodes)
        mode = modal.solve(Model(model.bodies, [*model.supports, Support(nodes, "y")]), 1)[0]
        assert slimness(mode.plot(view=(0.0, -1.0, 0.0), size=(WIDTH, HEIGHT))) == pytest.approx(1.72 / 6.0, abs=0.03)
    with pytest.raises(InputError, match=r"plot: got colour 'von Mises', need 'displacement'$"):
        mode.plot("von Mises")


def test_a_mode_about_a_state_is_drawn_about_it(bent):
    body = bent.model.bodies[0]
    model = Model([Body(body.space, body.material, density=1.0)], bent.model.supports)
    mode = modal.solve(model, 1, state=statics.solve(model))[0]
    still = mode.plot(view=(0.0, -1.0, 0.0), size=(WIDTH, HEIGHT), scale=0.0)
    # The end of the rod, 1 wide, is 1.5 aside and 0.5 lower.
    assert slimness(still) == pytest.approx(2.5 / 5.5, rel=0.1)


BAD = {
    "colour": ({"colour": "red"}, "plot: got colour 'red', need 'von Mises' or 'displacement'"),
    "scale": ({"scale": "big"}, "scale: got 'big', need a number"),
    "view": ({"view": (0, 0, 0)}, r"plot: got view \(0, 0, 0\), need a direction such as \(1, -1, 0.5\)"),
    "words": ({"view": "xz"}, "plot: got view 'xz', need a direction"),
    "size": ({"size": 300}, "plot: got size 300, need width and height in pixels"),
    "width": ({"size": (30, 300)}, "plot: width in pixels: got 30, need an integer from 200"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_refused_in_one_line(case, bent):
    given, said = BAD[case]
    with pytest.raises(InputError, match=f"^{said}") as refusal:
        bent.plot(**given)
    assert "\n" not in str(refusal.value)


def test_without_pyvista_the_error_says_how_to_get_it(bent, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(InputError, match="pip install pyvista"):
        bent.plot()
