"""Copies of a rod of a file: where they are, what is theirs, and what is refused."""

import numpy as np
import pytest

from isorod import InputError
from isorod.files.scene import FileScene

WIRE = """
[rod.wire]
curve = {helix = {radius = 5.0, pitch = 3.0, turns = 0.6}}
section = {ellipse = {a = 0.5, b = 0.3}}
law = {LinearElastic = {E = 1e4, nu = 0.3}}
space = {elements = 5, degree = 4, order = 1}
"""
CORE = """
[rod.core]
curve = {straight = 10.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 1e4, nu = 0.3}}
"""
STATICS = """
[support.foot]
rod = "wire"
end = "start"
[load.tip]
rod = "wire"
end = "end"
force = [0.001, 0, 0]
[analysis.statics]
[measure.tip]
displacement = "wire"
unit = "mm"
[measure.wall]
reaction = "foot"
"""


def written(tmp_path, *parts):
    path = tmp_path / "scene.toml"
    path.write_text("\n".join(parts))
    return FileScene(str(path))


def geometry(tmp_path, copy):
    return written(tmp_path, WIRE, f"copy = {copy}", "[analysis.geometry]").rods()


@pytest.mark.parametrize(
    "copy, moved",
    [
        (
            '{around = "z", count = 3}',
            lambda x: x @ [[-0.5, 0.75**0.5, 0.0], [-(0.75**0.5), -0.5, 0.0], [0.0, 0.0, 1.0]],
        ),
        ("{move = [1, 2, -3]}", lambda x: np.add(x, [1.0, 2.0, -3.0])),
        ('{mirror = "y"}', lambda x: x * [1.0, -1.0, 1.0]),
    ],
)
def test_copies_are_where_they_are_told(tmp_path, copy, moved):
    first, second = geometry(tmp_path, copy)[:2]
    around = np.linspace(0.0, 2.0 * np.pi, 9)
    xi = np.stack([np.cos(around), np.sin(around)], axis=1)
    # The section of a mirror image runs round the other way.
    turned = xi * [1.0, -1.0] if "mirror" in copy else xi
    u = first.axis.evenly(2)
    np.testing.assert_allclose(second.grid(turned, u)[0], moved(first.grid(xi, u)[0]), atol=1e-12)
    assert second.check() == pytest.approx(first.check(), rel=1e-9)
    assert second.volume() == pytest.approx(first.volume(), rel=1e-12)


def test_what_names_a_rod_is_there_for_each_of_its_copies(tmp_path):
    held = '[support.core]\nrod = "core"\nend = "start"'
    scene = written(tmp_path, WIRE, 'copy = {mirror = "x"}', CORE, STATICS, held)
    assert scene.rod_names() == ["wire-1", "wire-2", "core"]
    model = scene.model()
    assert [one.body for one in model.supports] == [0, 1, 2]
    assert [one.body for one in model.loads] == [0, 1]
    assert scene.units == {"tip-1": "mm", "tip-2": "mm", "wall-1": "", "wall-2": ""}
    assert scene.named("support 1, body 1, support 2") == "support foot-2, rod wire-2, support core"


def test_a_mirror_image_answers_in_the_mirror(tmp_path):
    from isorod import statics

    scene = written(tmp_path, WIRE, 'copy = {mirror = "z"}', STATICS)
    with pytest.warns(UserWarning, match="final overlap: body 0 .* penetrates body 1"):
        # They begin at the mirror.
        found = scene.measure(statics.solve(scene.model()))
    np.testing.assert_allclose(found["tip-2"], np.array(found["tip-1"]) * [1.0, 1.0, -1.0], rtol=1e-9)
    np.testing.assert_allclose(found["wall-1"], [-0.001, 0.0, 0.0], atol=1e-10)


def test_one_copy_may_be_named(tmp_path):
    scene = written(
        tmp_path, WIRE, "copy = {move = [0, 20, 0], count = 3}", STATICS, '[load.more]\nrod = "wire-3"\npressure = 0.1'
    )
    assert [one.body for one in scene.model().loads] == [0, 1, 2, 2]


def test_a_contact_is_one_of_all_copies(tmp_path):
    copies = 'copy = {around = "z", count = 3}'
    held = STATICS + '[support.core]\nrod = "core"\nend = "start"\n'

    def sides(text):
        (contact,) = written(tmp_path, WIRE, copies, CORE, held, f"[contact.lay]\n{text}").model().contacts
        return contact.first, contact.second

    assert sides('first = "wire"') == ((0, 1, 2), None)
    assert sides('first = "core"\nsecond = "wire"') == (3, (0, 1, 2))
    assert sides('first = "wire-3"\nsecond = "wire-1"') == (2, 0)
    with pytest.raises(InputError, match=r"contact.lay.second: .* named twice"):
        sides('first = "wire"\nsecond = "wire-1"')


def test_ties_are_of_each_copy_and_of_the_same_of_two(tmp_path):
    copies = 'copy = {around = "z", count = 3}'
    tie = '[tie.weld]\nslave = "wire.end"\nmaster = "core.outer"\ngap = 10.0\n'
    scene = written(tmp_path, WIRE, copies, CORE, STATICS, tie)
    assert scene.names["ties"] == ["weld-1", "weld-2", "weld-3"]
    scene = written(tmp_path, WIRE, copies, CORE, copies, STATICS, tie)
    assert [(one.slave.body, one.master.body) for one in scene.model().ties] == [(0, 3), (1, 4), (2, 5)]
    with pytest.raises(InputError, match=r"tie.weld: which copies are tied to which\? name them, as in 'wire-1.end'"):
        written(tmp_path, WIRE, copies, STATICS, tie.replace("core", "wire"))
    with pytest.raises(InputError, match=r"tie.weld: which copies are tied to which"):
        written(tmp_path, WIRE, copies, CORE, 'copy = {mirror = "x"}', STATICS, tie)


def test_spaces_may_be_told_for_all_and_for_each(tmp_path):
    scene = written(tmp_path, WIRE, 'copy = {mirror = "x"}', STATICS)
    finer = FileScene(scene.path, elements=10)
    assert [body.space.elements for body in finer.model().bodies] == [10, 10]
    spaces = [body.space for body in scene.model().bodies]
    again = scene.on([spaces[0], finer.model().bodies[1].space])
    assert [body.space.elements for body in again.model().bodies] == [5, 10]


@pytest.mark.parametrize(
    "copy, said",
    [
        ("{count = 3}", "rod.wire.copy.*: need one of around, move, mirror"),
        ('{around = "z", mirror = "x"}', "rod.wire.copy.*: need one of around, move, mirror"),
        ('{around = "w"}', "rod.wire.copy.around: 'w' is not known"),
        ('{around = "z", count = 1}', "rod.wire.copy.count: got 1, need an integer from 2 to 1000"),
        ('{mirror = "x", count = 3}', "rod.wire.copy.count: got 3, need an integer from 2 to 2"),
        ("{move = [0, 0, 0]}", "rod.wire.copy.move: got zeros"),
        ("{move = [0, 0]}", "rod.wire.copy.move: got"),
        ("5", "rod.wire.copy"),
        ('{around = "z", number = 6}', "rod.wire.copy: 'number' is not known"),
    ],
)
def test_bad_copies_are_refused(tmp_path, copy, said):
    with pytest.raises(InputError, match=f"scene.toml:[0-9]+: {said}"):
        geometry(tmp_path, copy)


def test_names_of_copies_and_of_other_rods_are_different(tmp_path):
    with pytest.raises(InputError, match=r"rod.wire-2: wire-2 is the name of a copy of another rod"):
        written(tmp_path, WIRE, 'copy = {mirror = "x"}', WIRE.replace("rod.wire", "rod.wire-2"), "[analysis.geometry]")
    with pytest.raises(InputError, match="'wire-3' is not known"):
        written(tmp_path, WIRE, 'copy = {mirror = "x"}', STATICS.replace('rod = "wire"', 'rod = "wire-3"', 1))
