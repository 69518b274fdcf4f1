"""Trees of SWC files: their branches, where these begin, and what is refused."""

import numpy as np
import pytest

from isorod import InputError, statics
from isorod.files.scene import FileScene

LAW = "law = {LinearElastic = {E = 100.0, nu = 0.3}}\ndensity = 1.0\n"
# A trunk with a branch at right angles, another one at 45 degrees, and a kind of its own for each.
PLANT = """# number kind x y z radius parent
1 1 0 0 0 1.0 -1
2 2 0 0 10 1.0 1
3 3 0 0 20 1.0 2
4 3 8 0 10 0.6 2
5 4 0 0 40 1.0 3
6 4 0 8 28 0.5 3
"""
# Three twigs that begin at the root: two of them are one bar.
STAR = """1 1 0 0 0 1.0 -1
2 3 9 0 0 0.8 1
3 3 -9 0 0 1.0 1
4 3 0 0 9 0.5 1
"""


def scene(tmp_path, content, more="", analysis="analysis = 'geometry'", keys="tolerance = 0.01"):
    (tmp_path / "tree.swc").write_text(content)
    path = tmp_path / "scene.toml"
    path.write_text(f'{analysis}\n[rod.oak]\ntree = {{file = "tree.swc", {keys}}}\n{LAW}{more}')
    return FileScene(str(path))


def ends(rod):
    return [rod.grid(np.zeros((1, 2)), [u])[0][0, 0] for u in rod.axis.breaks[[0, -1]]]


def test_branches_are_named_by_their_tips_and_begin_where_their_rim_leaves_the_trunk(tmp_path):
    found = scene(tmp_path, PLANT)
    rods = dict(zip(found.rod_names(), found.rods(), strict=True))
    assert list(rods) == ["oak-5", "oak-4", "oak-6"]
    assert found.names["ties"] == ["oak-4", "oak-6"]
    np.testing.assert_allclose(ends(rods["oak-5"]), [[0, 0, 0], [0, 0, 40]], atol=1e-9)
    # At right angles the rim reaches the surface where its widest points do: 0.8 from the axis.
    np.testing.assert_allclose(ends(rods["oak-4"]), [[0.8, 0, 10], [8, 0, 10]], atol=0.02)
    # At 45 degrees the upper point is the first: (s + 0.5) / sqrt 2 = 1.
    start = ends(rods["oak-6"])[0]
    np.testing.assert_allclose(start[1:] - [0.0, 20.0], np.full(2, (np.sqrt(2.0) - 0.5) / np.sqrt(2.0)), atol=0.02)


def test_a_fork_at_the_root_is_one_bar_and_a_twig(tmp_path):
    rods = dict(zip((found := scene(tmp_path, STAR)).rod_names(), found.rods(), strict=True))
    assert list(rods) == ["oak-3", "oak-4"]
    np.testing.assert_allclose(sorted(x[0] for x in ends(next(iter(rods.values())))), [-9, 9], atol=1e-9)


def test_what_is_said_of_the_tree_is_of_each_branch(tmp_path):
    more = """
[support.root]
rod = "oak-5"
end = "start"
[load.wind]
rod = "oak"
body_force = [1e-5, 0, 0]
"""
    found = scene(tmp_path, PLANT, more + "[measure.foot]\nreaction = 'root'\n", "[analysis.statics]")
    solution = statics.solve(found.model(), **found.settings())
    # Each is a cylinder: all of them are pushed, and held at the root alone.
    lengths = [np.linalg.norm(np.subtract(*ends(rod))) for rod in found.rods()]
    volume = np.pi * np.dot(lengths, np.square([1.0, 0.6, 0.5]))
    assert found.measure(solution)["foot"][0] == pytest.approx(-1e-5 * volume, rel=1e-4)


@pytest.mark.parametrize(
    "content, said",
    [
        ("", "0 samples"),
        ("1 1 0 0 0 1\n", "need seven numbers"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 x 1 1\n", "tree.swc:2"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 nan 1\n", "tree.swc:2"),
        ("1 1 0 0 0 1 -1\n1 1 0 0 5 1 1\n", "each once"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 0 1\n", "radius: got 0"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 1 3\n", "parent 3"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 1 -1\n", "second root"),
        ("1 1 0 0 0 1 -1\n2 1 0 0 5 1 1\n3 1 0 0 9 1 2\n4 1 0.4 0 5 0.2 2\n", "within the one it leaves"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, content, said):
    with pytest.raises(InputError) as problem:
        scene(tmp_path, content)
    assert said in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_tree_has_neither_curve_nor_copies(tmp_path):
    with pytest.raises(InputError, match="does not go with a tree"):
        scene(tmp_path, PLANT, 'copy = {around = "z"}\n')
