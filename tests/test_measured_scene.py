"""What a study of a scene asks finite elements for, and what it makes of their answers."""

import contextlib
import dataclasses
import types

import pytest

from comparisons.measure import scene, timing
from comparisons.measure.work import Curve

ARGUMENTS = ("--level 1", "--level 2", "--level 4")


@pytest.fixture
def asked(monkeypatch):
    """Programs that are run, each answering f = 3 + 0.4 h^2 and the frequencies of it."""
    asked = []

    def run(module, words, **more):
        asked.append((module, *words))
        level = int(words[words.index("--level") + 1])
        size = 1.0 / level
        force = 3.0 + 0.4 * size**2
        return {"options": {"layers": level}, "force": force, "frequencies": [force, 2.0 * force]}

    monkeypatch.setattr(timing, "run", run)
    return asked


def measured(kept=None, file=""):
    family = types.SimpleNamespace(label="Q2", arguments=ARGUMENTS)
    more = {} if kept is None else {"kept": kept}
    return scene.Scene("spring", ("force", "frequencies"), family, (), {}, {}, file, **more)


def study():
    """A study that keeps what it is given, and a progress."""
    records, texts = [], []

    def record(kind, found):
        records.append((kind, found))
        return found

    @contextlib.contextmanager
    def step(text):
        texts.append(text)
        yield

    return types.SimpleNamespace(record=record), types.SimpleNamespace(step=step), records, texts


def test_three_meshes_are_extrapolated(asked):
    one = measured()
    where, steps, records, texts = study()
    values = one.run(where, steps)
    assert one.steps == len(texts) == 3
    assert asked == [("comparisons.fem", "spring", *words.split()) for words in ARGUMENTS]
    assert values["force"] == pytest.approx([3.0]) and values["frequencies"] == pytest.approx([3.0, 6.0])
    kinds, found = zip(*records, strict=True)
    assert kinds == (*["convergence"] * 3, "converged")
    assert [record["arguments"] for record in found[:3]] == [*ARGUMENTS]
    last = found[-1]
    assert (last["scene"], last["element"]) == ("spring", "Q2")
    assert last["orders"]["force"] == pytest.approx([2.0]) and last["orders"]["frequencies"] == pytest.approx([2.0] * 2)
    # The finest mesh is 0.4 / 16 from 3.
    assert last["uncertainty"] == pytest.approx(0.025 / 3.0)
    assert last["force"] == values["force"]


def test_runs_along_curves_have_their_errors(asked):
    curve = Curve("ours", "cylindrical", ("--level 2", "--level 3"))
    one = dataclasses.replace(measured(), curves=(curve,))
    where, steps, records, texts = study()
    one.run(where, steps)
    assert one.steps == len(texts) == 5
    found = [record for kind, record in records if kind == "work"]
    assert [record["arguments"] for record in found] == ["--level 2", "--level 3"]
    assert [record["error"] for record in found] == pytest.approx([0.1 / 3.0, 0.4 / 27.0])
    assert {record["curve"] for record in found} == {"ours"}


def test_the_error_of_a_run_is_the_largest_of_what_is_measured():
    values = {"force": [2.0], "frequencies": [1.0, 4.0]}
    for frequencies, error in (([1.0, 4.0], 0.05), ([1.1, 4.0], 0.1), ([1.0, 3.2], 0.2)):
        assert measured().error({"force": 2.1, "frequencies": frequencies}, values) == pytest.approx(error)


def test_scenes_of_the_same_rods_share_runs(asked):
    kept = {}
    for _ in range(2):
        where, steps, _, _ = study()
        measured(kept).run(where, steps)
    assert len(asked) == len(kept) == 3
    where, steps, _, _ = study()
    measured(kept, file="own.toml").run(where, steps)
    assert len(asked) == 6
