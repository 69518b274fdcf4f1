"""Presets of spring and blade: what they set, and families of meshes from coarse to fine."""

import dataclasses
from itertools import pairwise
from math import prod

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.fem import published
from comparisons.fem.__main__ import _parser
from comparisons.fem.presets import blade, spring
from isorod.command import parser

SCENES = {"spring": (published.Spring, spring), "blade": (published.Blade, blade)}
FAMILIES = [
    (scene, family)
    for scene, (_, presets) in SCENES.items()
    for family in (*presets.FULL, *presets.QUICK, *presets.CONVERGED.values())
]
TEXTS = [
    *((scene, text) for scene, (_, presets) in SCENES.items() for text in presets.PRESETS.values()),
    *((scene, text) for scene, family in FAMILIES for text in family.arguments),
]


def configuration(scene, text):
    """Return what arguments stand for, and those of PETSc."""
    ours, theirs = parser.split([scene, *text.split()])
    given = vars(_parser(scene).parse_args(ours))
    for name in ("scene", "repeat", "preset"):
        given.pop(name)
    return SCENES[scene][0](**given | {"flags": tuple(given["flags"].split())}), list(theirs)


@pytest.mark.parametrize(("scene", "text"), TEXTS)
def test_presets_set_what_they_say_and_nothing_else(scene, text):
    chosen, theirs = configuration(scene, text)
    pairs = list(zip(text.split()[::2], text.split()[1::2], strict=True))
    said = {name.removeprefix("--"): value for name, value in pairs if name.startswith("--")}
    assert theirs == [word for pair in pairs if not pair[0].startswith("--") for word in pair]
    default, _ = configuration(scene, "")
    for field in dataclasses.fields(chosen):
        value = getattr(chosen, field.name)
        if field.name in said:
            assert str(value) == said.pop(field.name)
        else:
            assert value == getattr(default, field.name)
    assert not said


@pytest.mark.parametrize(("scene", "family"), FAMILIES, ids=lambda one: getattr(one, "label", one))
def test_meshes_of_a_family_go_from_coarse_to_fine(scene, family):
    meshes = [configuration(scene, text)[0] for text in family.arguments]
    sizes = ("around", "layers") if scene == "spring" else ("along", "across", "layers")
    counts = [[getattr(mesh, name) for name in sizes] for mesh in meshes]
    for (coarse, fine), (few, many) in zip(pairwise(meshes), pairwise(counts), strict=True):
        assert prod(many) > prod(few)
        assert scene == "blade" or all(a <= b for a, b in zip(few, many, strict=True))
        assert (fine.cells, fine.degree, fine.family) == (coarse.cells, coarse.degree, coarse.family)
    if family in SCENES[scene][1].CONVERGED.values():
        # Richardson's: refined alike in all directions.
        assert len(meshes) == 3
        assert len({tuple(count / each[0] for count in each) for each in counts}) == 1
        assert len({getattr(mesh, "grading", 1.0) for mesh in meshes}) == 1
