"""Sections from files, rounded rectangles, and control points that crowd."""

import numpy as np
import pytest
from refused import refused

from isorod import InputError, circle, naca, rounded_rectangle, straight
from isorod.geometry import outline
from isorod.geometry.disk import boundary_functions
from isorod.geometry.section import from_file, from_points

THETA = 2.0 * np.pi * np.arange(2000) / 2000


def curve(points):
    return boundary_functions(len(points), THETA) @ points


def area(points):
    after = np.roll(points, -1, axis=0)
    return 0.5 * np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0])


def gap(points, places):
    """Return the distances of places from a closed polyline."""
    edges = np.roll(points, -1, axis=0) - points
    share = np.einsum("qka,ka->qk", places[:, None] - points, edges) / np.sum(edges**2, axis=1)
    nearest = points + np.clip(share, 0.0, 1.0)[..., None] * edges
    return np.linalg.norm(nearest - places[:, None], axis=2).min(axis=1)


def sides(blunt, count=61):
    """Return the upper and the lower side of NACA 2412, both from the leading edge."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, count)))
    last = 0.1015 if blunt else 0.1036
    half = 0.6 * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - last * x))))
    mean = np.where(x < 0.4, 0.125 * (0.8 * x - x * x), 0.02 / 0.36 * (0.2 + 0.8 * x - x * x))
    return np.stack([x, mean + half], axis=1), np.stack([x, mean - half], axis=1)


def text(points):
    return "".join(f"  {x:.7f}  {y:.7f}\n" for x, y in points)


def selig(blunt=True):
    upper, lower = sides(blunt)
    return np.concatenate([upper[::-1], lower[1:]])


@pytest.mark.parametrize("blunt", [True, False])
@pytest.mark.parametrize("kind", ["selig", "clockwise", "lednicer", "bare"])
def test_both_orders_of_an_airfoil_are_one_outline(tmp_path, kind, blunt):
    upper, lower = sides(blunt)
    around = selig(blunt)
    content = {
        "selig": "NACA 2412\n" + text(around),
        "clockwise": "NACA 2412\n\n" + text(around[::-1]),
        "lednicer": f"NACA 2412 (Lednicer)\n {len(upper)}. {len(lower)}.\n\n{text(upper)}\n{text(lower)}",
        "bare": text(around),
    }[kind]
    path = tmp_path / "wing.DAT"
    path.write_text(content)
    found = outline.read(path)
    # Of a sharp trailing edge one point is kept.
    expected = around if blunt else around[:-1]
    assert len(found) == len(expected) and area(found) > 0.0
    start = int(np.argmin(np.linalg.norm(found - expected[0], axis=1)))
    assert np.roll(found, -start, axis=0) == pytest.approx(expected, abs=1e-6)
    assert found[0, 0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    "content",
    ["x,y\n1,0\n0,1\n-1,0\n0,-1\n1,0\n", "# a square\n1;0\n0;1 # top\n\n-1;0\n0;-1\n", "1 0\n0\t1\n-1 0\n0 -1\n"],
)
def test_points_of_a_csv_file(tmp_path, content):
    path = tmp_path / "square.csv"
    path.write_text(content)
    assert np.array_equal(outline.read(path), [[1, 0], [0, 1], [-1, 0], [0, -1]])


def test_the_outline_of_an_airfoil_is_met(tmp_path):
    path = tmp_path / "wing.dat"
    path.write_text("NACA 2412\n" + text(selig()))
    points = from_file(path, 24, scale=2.5)
    assert gap(curve(points), 2.5 * selig()).max() < 2.5 * 6e-3
    assert area(curve(points)) == pytest.approx(2.5**2 * area(selig()), rel=1e-3)
    assert straight(1.0).sweep(points).check() > 0.0
    # As good a fit as that of the formula.
    assert area(curve(points)) == pytest.approx(area(curve(naca("2412", 24, 2.5))), rel=5e-3)


def test_crowding_about_the_trailing_edge_meets_an_airfoil_better(tmp_path):
    path = tmp_path / "wing.dat"
    path.write_text("NACA 2412\n" + text(selig()))
    found = [from_file(path, 24, near=(1.0, 0.0), closer=closer) for closer in (1.0, 2.0)]
    plain, crowded = (gap(curve(one), selig()) for one in found)
    assert crowded.max() < 0.5 * plain.max()
    assert np.linalg.norm(crowded) < 0.6 * np.linalg.norm(plain)


def test_crowding_is_a_moebius_map():
    """A circle stays one, as arcs of a tenth have it; points stand four times as close here, as far apart opposite."""
    points = np.stack([np.cos(THETA), np.sin(THETA)], axis=1)
    crowded = from_points(points, 40, near=(0.0, 1.0), closer=4.0)
    assert np.hypot(*curve(crowded).T) == pytest.approx(np.ones(THETA.size), abs=3e-3)
    distances = np.linalg.norm(np.roll(crowded, -1, axis=0) - crowded, axis=1)
    middle = 0.5 * (np.roll(crowded, -1, axis=0) + crowded)
    assert distances[np.argmax(middle[:, 1])] == pytest.approx(2 * np.pi / 40 / 4, rel=0.1)
    assert distances[np.argmin(middle[:, 1])] == pytest.approx(2 * np.pi / 40 * 4, rel=0.1)
    assert from_points(points, 40, near=(0.0, 1.0), closer=1.0) == pytest.approx(from_points(points, 40), abs=1e-12)


@pytest.mark.parametrize("width, height, radius", [(2.0, 1.0, 0.25), (10.0, 1.0, 0.5), (1.0, 3.0, 0.1)])
def test_rounded_rectangle(width, height, radius):
    points = rounded_rectangle(48, width, height, radius)
    exact = width * height - (4.0 - np.pi) * radius**2
    assert area(curve(points)) == pytest.approx(exact, rel=2e-3)
    mirrored = points * [1.0, -1.0]
    assert np.abs(mirrored[:, None] - points).max(axis=2).min(axis=1).max() < 1e-9 * width
    assert np.ptp(curve(points), axis=0) == pytest.approx([width, height], rel=1e-2)
    assert straight(1.0).sweep(points).check() > 0.0


def test_rounded_rectangle_is_a_circle_where_its_corners_meet():
    assert rounded_rectangle(12, 2.0, 2.0, 1.0) == pytest.approx(circle(12), abs=1e-4)


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("a.csv", "x,y\n1,0\n0,one\n", r"a.csv: line 3: got '0,one', need two finite numbers x, y"),
        ("a.csv", "1,o\n1,0\n", r"a.csv: line 1: got '1,o', need two finite numbers"),
        ("a.csv", "1,0\n0,nan\n", r"a.csv: line 2: got '0,nan', need two finite numbers"),
        ("a.csv", "1,0,3\n", r"a.csv: line 1: got '1,0,3', need two finite numbers"),
        ("a.csv", "x,y\nz,w\n", r"a.csv: line 2: got 'z,w'"),
        ("a.csv", "", r"a.csv: got 0 different points, an outline needs at least 3"),
        (
            "a.csv",
            "1,0\n0,1\n-1,0\n",
            r"a.csv: section points: area or second moments of 4 control points are .36 % off; take more control",
        ),
        ("a.csv", "1,0\n0,-1\n-1,0\n0,1\n", r"a.csv: section points run clockwise"),
        ("a.csv", "1,0\n2,0\n3,0\n4,0\n", r"a.csv: the outline has no area"),
        ("a.csv", b"\xff\xfe\x00", r"a.csv: is not a text file"),
        ("a.dat", "wing\n3. 3.\n0 0\n1 1\n", r"a.dat: line 2: says 3 and 3 points, but 2 follow"),
        ("a.dat", "wing\n3.5 3.5\n0 0\n1 1\n", r"a.dat: line 2: got 3.5 3.5, need how many points"),
        ("a.dat", "wing\n1 0\n0.5 0.1 7\n", r"a.dat: line 3: got '0.5 0.1 7', need two"),
    ],
)
def test_bad_files(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as problem:
        from_file(path, 4)
    assert "\n" not in str(problem.value) and str(path) in str(problem.value)


test_refusals = refused(
    (lambda: from_file("nowhere.csv", 8), "nowhere.csv: No such file or directory"),
    (lambda: from_file("nowhere.csv", 8, scale=0.0), "section scale: got 0, need a positive number"),
    (lambda: from_points(circle(8), 4, near=(np.nan, 0.0)), "need two finite coordinates"),
    (lambda: from_points(circle(8), 4, near=(1.0, 0.0), closer=0.5), "closer: got 0.5, need a factor of 1 or more"),
    (lambda: rounded_rectangle(8, 0.0, 1.0, 0.1), "rectangle width: got 0, need a positive length"),
    (lambda: rounded_rectangle(8, 1.0, np.nan, 0.1), "rectangle height: got nan"),
    (lambda: rounded_rectangle(8, 1.0, 2.0, 0.6), "corner radius: got 0.6, need 0 to 0.5"),
    (lambda: rounded_rectangle(8, 1.0, 2.0, np.nan), "corner radius: got nan"),
)
