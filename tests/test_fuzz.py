"""Generated input of every kind ends in finite numbers or in one line and exit code 2.

No traceback, no hang, no silent NaN.

Each family of inputs runs a few examples, and marked slow all of its share of ten thousand; the examples are the same
at every run.
"""

import dataclasses
import hashlib
import json
import string
import tempfile
import threading
import types
import typing
import warnings
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from fuzzing import EDGES, Hang, Maker, is_finite, judge, limited
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from isorod import InputError, SolveError, Space, dynamics, options, scenes, statics
from isorod.output import checkpoint, results

# Quick and full number of examples of each family.
SHARES = {
    "scene": (150, 3000),
    "words": (80, 2200),
    "petsc": (30, 700),
    "python": (100, 2500),
    "rule": (30, 400),
    "checkpoint": (30, 700),
    "records": (30, 300),
    "page": (20, 200),
}

# What keeps each scene small.
SMALL = {
    "spring": {"coils": 1, "elements_per_turn": 8, "section_points": 4, "degree": 2},
    "blade": {"elements": 2, "section_points": 16},
    "biceps": {"elements": 5, "section_points": 4, "end_elements": 0}
    | {"end_time": 5e-5, "outputs": 2, "activation": 0.1},
    "flower": {},
    "ring": {},
}

# Wider ranges give small numbers, and so the same ones, again and again.
SEEDS = st.integers(0, 2**24 - 1)
COUNTS = st.one_of(
    st.integers(-2, 9), st.sampled_from([-(2**63), -(10**9), 10**9, 2**31, 2**63, 10**20]), st.integers(10**9, 10**30)
)
TEXTS = st.one_of(
    st.sampled_from(
        ["", " ", "nan", "inf", "-inf", "1e3", "0x10", "½", "１２", "1_0", "--", "-", "1,5", "two", "\n", "1e999"]
    ),
    st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=6),
)
RULES = st.one_of(
    st.sampled_from(["auto", "full", "paper", "2x1", "2x1x3", "1x1x1", "64x64x65", "0x2x2", "999x9x9", "2x-1", "2x1x"]),
    st.from_regex(r"1?[0-4]x[0-4](x[0-5])?", fullmatch=True),
    TEXTS,
)
CHOICES = {
    "fibre": ["y", "tangent", "z"],
    "airfoil": ["paper", "2412", "0012", "9999", "24"],
    "formulation": ["mixed", "displacement"],
}


def examples(family: str):
    """Parametrise a test by the number of examples of its family, the full one slow."""
    quick, full = SHARES[family]
    return pytest.mark.parametrize("count", [quick, pytest.param(full, marks=pytest.mark.slow)])


def generated(count: int, *strategies):
    """Run a function on that many examples."""

    def decorate(function):
        silent = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture]
        settings(max_examples=count, suppress_health_check=silent)(given(*strategies)(function))()

    return decorate


@pytest.fixture(scope="module", autouse=True)
def quiet():
    """Leave out what costs time and depends on no input: the commit of a record.

    Let PETSc's words reach it though it runs already.
    """
    patch = pytest.MonkeyPatch()
    patch.setattr(results, "_commit", lambda: None)
    patch.setattr(warnings, "showwarning", warnings.showwarning)
    options.initialize([])
    from petsc4py import PETSc

    patch.setattr(options, "initialize", lambda words: PETSc.Options().insertString(" ".join(words)))
    with np.errstate(all="ignore"):
        yield
    patch.undo()


def values_of(field, name: str):
    """Return a strategy for the text of a field: mostly of its kind, sometimes anything."""
    kind = field.type
    kind = typing.get_args(kind)[0] if isinstance(kind, types.UnionType) else kind
    if kind is int:
        own = COUNTS.map(str)
    elif kind is float:
        scale = st.floats(0.25, 4.0).map(lambda share: share * SMALL[name].get(field.name, field.default))
        own = st.one_of(scale, scale, st.sampled_from(EDGES)).map(repr)
    elif field.name == "quadrature":
        own = RULES
    else:
        own = st.one_of(st.sampled_from(CHOICES.get(field.name, [field.default])), TEXTS)
    return st.one_of(own, own, own, own, own, own, TEXTS)


def options_of(name, more=()):
    """Return the words that make a scene small, and others."""
    return [f"--{key.replace('_', '-')}={value}" for key, value in (SMALL[name] | dict(more)).items()]


@st.composite
def scene_words(draw, name: str | None = None):
    """Return the words of a scene with some of its fields and of the command's own options changed."""
    # The cheap ones, and the one with every option, more often.
    name = name or draw(st.sampled_from(["spring", "spring", "blade", "biceps", "biceps", "flower", "ring"]))
    scene = scenes.find(name)
    fields = [field for field in dataclasses.fields(scene) if field.type is not bool]
    chosen = draw(st.lists(st.sampled_from(fields), max_size=4, unique_by=lambda field: field.name))
    words = options_of(name, {field.name: draw(values_of(field, name)) for field in chosen})
    words += ["--statics"] if name == "biceps" and draw(st.booleans()) else []
    own = {"spring": ["--load-steps"], "blade": ["--modes"], "biceps": ["--load-steps"]}.get(name, [])
    for word in own:
        if draw(st.booleans()):
            words.append(f"{word}={draw(st.one_of(COUNTS.map(str), TEXTS))}")
    if own and draw(st.integers(0, 19)) == 0:
        # Of those that can be reached one that is soon.
        words.append(f"--tolerance={draw(st.sampled_from([*EDGES, 0.9] if name == 'spring' else EDGES[:4]))}")
    if name == "blade":
        words += draw(st.sampled_from([[], ["--mass=lumped"], ["--mass=", "--modes=1"]]))
    return ["run", name, *words]


@examples("scene")
def test_scenes(count):
    @generated(count, scene_words(), st.integers(0, 9))
    def run(words, where):
        with tempfile.TemporaryDirectory() as place:
            # Fields take pyvista, and their time.
            output = where < (5 if words[1] in ("flower", "ring") else 1)
            more = [f"--output={place}/new"] if output else []
            with np.errstate(all="ignore"):
                judge([*words, "--json", *more], Path(place) if output else None)


@st.composite
def garbled_words(draw):
    """Return a command line with letters changed, and words lost, doubled and swapped."""
    words = draw(scene_words(draw(st.sampled_from(["flower", "ring", "spring"]))))
    words = draw(
        st.sampled_from([words, words, words, words, ["list"], ["--version"], ["run"], ["run", "ring", "--help"]])
    )
    for _ in range(draw(st.integers(1, 4))):
        k = draw(st.integers(0, len(words) - 1))
        change = draw(st.integers(0, 4))
        if change == 0:
            words = [*words[:k], *words[k + 1 :]] or [""]
        elif change == 1:
            words = [*words, words[k]]
        elif change == 2:
            words = [*words[:k], draw(TEXTS), *words[k:]]
        elif change == 3:
            words = [*words[:k], *words[k].split("=", 1), *words[k + 1 :]]
        else:
            at = draw(st.integers(0, len(words[k])))
            letter = draw(st.sampled_from(string.ascii_lowercase + "-=._ \n\t'\"%{}é\udcff"))
            words = [*words[:k], words[k][:at] + letter + words[k][at:], *words[k + 1 :]]
    return words


@examples("words")
def test_garbled_command_lines(count):
    @generated(count, garbled_words())
    def run(words):
        # The doctor, a folder of a generated name, and a tolerance that takes minutes to reach are not meant.
        if "doctor" not in words and not any(word.startswith(("--output", "--tol")) for word in words):
            judge(words)


@examples("petsc")
def test_petsc_options(count):
    @generated(count, SEEDS, st.sampled_from(["spring", "blade"]))
    def run(seed, name):
        judge(["run", name, *options_of(name), "--json", *Maker(seed).petsc(name)])


@examples("python")
def test_models_from_python(count):
    @generated(count, SEEDS)
    def run(seed):
        make = Maker(seed)
        with limited(), warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
            try:
                model = make.model()
                if make.rng.random() < 0.2:
                    found = dynamics.solve(model, make.number(), outputs=make.seldom(2, 0, -1, 10**9))
                    assert is_finite([found.displacement, found.reactions, found.kinetic])
                else:
                    found = statics.solve(model, make.seldom(1, 2))
                    assert is_finite([found.displacement, found.reactions, found.moments])
            except (InputError, SolveError) as problem:
                assert "\n" not in str(problem)


@examples("rule")
def test_quadrature_texts(count, cylinder):
    rod = cylinder()

    @generated(count, RULES, COUNTS, COUNTS)
    def run(text, degree, order):
        try:
            rule = Space.paper(rod, degree=degree, order=order, quadrature=text).rule
        except InputError as problem:
            assert "\n" not in str(problem)
            return
        assert all(1 <= number <= 64 for number in (rule.radial, rule.angular, rule.axial))


def damaged(draw, data: bytes) -> bytes:
    """Return bytes cut off, changed, inserted, removed or repeated."""
    at = draw(st.integers(0, len(data) - 1))
    kind = draw(st.integers(0, 4))
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + bytes([data[at] ^ draw(st.integers(1, 255))]) + data[at + 1 :]
    if kind == 2:
        return data[:at] + draw(st.binary(max_size=40)) + data[at:]
    if kind == 3:
        return data[:at] + data[at + draw(st.integers(1, 100)) :]
    return data + data[:at]


@examples("checkpoint")
def test_damaged_checkpoints(count, tmp_path):
    path, words = tmp_path / "state", ["run", "biceps", *options_of("biceps"), "--json"]
    judge([*words, f"--checkpoint={path}"])
    whole = path.read_bytes()
    head, _, body = whole.partition(b"\n")
    head = head[: -2 * hashlib.sha256().digest_size]

    @generated(count, st.data(), st.booleans(), st.booleans())
    def run(data, sealed, resume):
        if sealed:
            new = damaged(data.draw, body)
            path.write_bytes(head + hashlib.sha256(new).hexdigest().encode() + b"\n" + new)
        else:
            path.write_bytes(damaged(data.draw, whole))
        before = path.read_bytes()
        judge([*words, f"--checkpoint={path}", *(["--resume"] if resume else [])])
        # What is refused stays as it is, and what is not is whole in the end.
        assert path.read_bytes() == before or checkpoint._load(path)[1]["finished"]

    path.write_bytes(whole)
    judge([*words, f"--checkpoint={path}", "--resume"])


@examples("records")
def test_damaged_results(count, tmp_path):
    from comparisons.measure.records import newest

    lines = [{"study": "s", "run": "a", "level": "quick", "part": part, "value": 1.5} for part in ("one", "two", "end")]
    whole = "".join(json.dumps(line) + "\n" for line in lines).encode()

    @generated(count, st.data())
    def run(data):
        (tmp_path / "s.jsonl").write_bytes(damaged(data.draw, whole))
        with warnings.catch_warnings(action="ignore"):
            try:
                records = newest(tmp_path, "s")
            except InputError as problem:
                assert "\n" not in str(problem)
            else:
                assert all(record["run"] == records[0]["run"] for record in records)


WORDS = "part case sweep value error reference seconds force versions commit time machine label".split()
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.floats(0.0, 10.0), st.integers(-2, 99), st.sampled_from(WORDS)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.sampled_from(WORDS), inner, max_size=4)),
    max_leaves=6,
)


@examples("page")
def test_pages_of_records_of_another_kind(count, tmp_path):
    for name in ("matplotlib", "pyvista", "rich"):
        pytest.importorskip(name)
    from comparisons.report import page as report

    @generated(
        count,
        st.sampled_from(list(report.STUDIES)),
        st.lists(st.dictionaries(st.sampled_from(WORDS), JSON), max_size=4),
    )
    def run(study, made):
        found = [{"part": "work"} | one | {"run": "a", "study": study, "level": "quick"} for one in made]
        found.append({"run": "a", "study": study, "level": "quick", "part": "end"})
        with tempfile.TemporaryDirectory(dir=tmp_path) as place, warnings.catch_warnings():
            folder = Path(place)
            (folder / f"{study}.jsonl").write_text("".join(json.dumps(one) + "\n" for one in found))
            for make in (report.summary, report.write):
                try:
                    make(folder)
                except InputError as problem:
                    assert "\n" not in str(problem)
            assert [file for file in folder.iterdir() if file.name.startswith(".")] == []


SAMPLE = [
    "run spring --coils=1 --elements-per-turn=8 --section-points=10000000000000000000",
    "run spring --coils=1 --elements-per-turn=8 --quadrature=64x64x64x64",
    "run spring --coils=1000000000",
    "run spring --coils=1 --elements-per-turn=100000 --section-points=4 --degree=2 --quadrature=64x64x64",
    "run blade --elements=1000000000 --degree=6",
    "run blade --elements=2 --modes=1000000000",
    "run biceps --end-time=1e300",
    "run biceps --elements=5 --section-points=4 --time-step=1e-300",
    "run ring --radius=1e-320",
    "run spring --coils=1 -ksp_type",
    "run spring --coils=1 -snes_max_it abc",
]


@pytest.mark.parametrize("words", [SAMPLE[2], *(pytest.param(one, marks=pytest.mark.slow) for one in SAMPLE)])
def test_in_a_process_of_its_own(words, isorod):
    done = isorod(*words.split(), "--json")
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.startswith("isorod: ")
    assert done.stderr.count("\n") == 1


def test_the_limit_of_time_is_kept():
    """What the other tests hold every input to does stop one that takes too long."""
    assert threading.current_thread() is threading.main_thread()
    patch = pytest.MonkeyPatch()
    patch.setattr(fuzzing, "LIMIT", 0.05)
    with pytest.raises(Hang), limited():
        threading.Event().wait(5.0)
    patch.undo()
