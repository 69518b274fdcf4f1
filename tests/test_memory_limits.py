"""What would take more memory than there is is refused in one line before it is taken."""

import resource
import subprocess
import sys

import pytest

from isorod import memory
from isorod.errors import InputError
from isorod.files.document import Document

MEGABYTE = 1_000_000


def limited(size, *words):
    """Return what the command says on standard error, and its exit code, in so many bytes of addresses."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (size, size))

    done = subprocess.run(
        [sys.executable, "-m", "isorod", *words], preexec_fn=limit, capture_output=True, text=True, timeout=120
    )
    return done.stderr, done.returncode


@pytest.mark.parametrize("size", [300 * MEGABYTE, 600 * MEGABYTE])
def test_too_little_for_the_libraries_is_one_line(size):
    said, code = limited(size, "run", "spring")
    assert code == 2
    assert said == f"isorod: memory is limited to {size / 1e9:g} GB ('ulimit -v'); isorod needs 1 GB at least\n"


def test_what_needs_no_libraries_runs_with_little():
    assert limited(300 * MEGABYTE, "list") == ("", 0)


def test_a_tangent_that_does_not_fit_is_refused_before_it_is_made(tmp_path):
    path = tmp_path / "long.toml"
    path.write_text(
        'analysis = "statics"\n[rod.w]\ncurve = {helix = 10.0, pitch = 5.0, turns = 300}\nsection = {circle = 1.0}\n'
        'law = {LinearElastic = {E = 2e5, nu = 0.3}}\n[support.a]\nend = "start"\n[support.b]\nend = "end"\n'
        "displacement = [0, 0, 1]\n"
    )
    said, code = limited(2500 * MEGABYTE, "run", str(path))
    assert code == 2
    lines = [line for line in said.splitlines() if line.startswith("isorod: ")]
    assert len(lines) == 1 and "the tangent with its factor needs about" in lines[0], said


def test_more_than_is_free_is_an_error_that_says_both():
    with pytest.raises(InputError, match=r"a table needs about 1e\+09 GB, .* GB are free; take fewer elements"):
        memory.ask(1e18, "a table")
    memory.ask(1.0, "a byte")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a = 1\n" + ".".join(["a"] * 100_000) + " = 1\n", 2),
        ("[" + ".".join(["a"] * 30) + "]\n", 1),
        ('a = 1\nb = 2\n"a".' * 12 + "'b'.c." * 12 + "d = 1\n", None),
    ],
    ids=["key", "table", "quoted"],
)
def test_keys_of_many_names_are_refused_at_once(tmp_path, text, line):
    path = tmp_path / "deep.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"deep.toml:{line or ''}.*a key of [\d,]+ names; at most 20"):
        Document(str(path))
