"""PETSc's options from Python: before PETSc has started, after, and not at all."""

import os
import re
from importlib.util import find_spec

import pytest
from petsc4py import PETSc

from isorod import options
from isorod.errors import InputError

SOLVE = """
from isorod.scenes.spring import Spring
from isorod import statics
print(statics.solve(Spring(preset="paper", coils=1, elements_per_turn=4, section_points=3).model()).load_steps)
"""
IMPORTS = {
    "nothing": "",
    "PETSc": "from petsc4py import PETSc",
    "MPI": "from mpi4py import MPI",
    "SLEPc": "from slepc4py import SLEPc",
    "isorod first": "import isorod.modal, isorod.dynamics",
    "options after PETSc": "from petsc4py import PETSc; from isorod import options; options.initialize([])",
}


# The wheels' PETSc asks for this before all else; where isorod comes first it does so itself.
FIRST = "import dolfinx_solver\n" if find_spec("dolfinx_solver") else ""


@pytest.mark.parametrize("before", IMPORTS.values(), ids=IMPORTS)
def test_solving_needs_no_start(before, python):
    done = python((FIRST if before.startswith(("from petsc4py", "from slepc4py")) else "") + before + SOLVE)
    assert (done.stdout, done.stderr) == ("1\n", "")


def test_solving_needs_no_start_beside_dolfinx(python):
    pytest.importorskip("dolfinx")
    done = python(FIRST + "import dolfinx" + SOLVE)
    assert done.stdout == "1\n", done.stderr


def test_options_count_after_petsc_has_started(petsc_options, tmp_path):
    file = tmp_path / "more"
    file.write_text("-snes_atol 1e-30\n")
    petsc_options(snes_rtol="1e-8", snes_atol="1e-50", snes_monitor="")
    options.initialize(["-snes_rtol", "1e-3", "-options_file", str(file), "-snes_monitor"])
    found = PETSc.Options()
    assert (found.getReal("snes_rtol"), found.getReal("snes_atol")) == (1e-3, 1e-30)


@pytest.mark.parametrize("word", ["-log_view", "-info", "-malloc_debug", "-start_in_debugger", "-fp_trap"])
def test_what_petsc_reads_only_when_it_starts_is_refused_then(word):
    with pytest.raises(InputError, match=f"PETSc option {word}: .*before anything imports petsc4py.PETSc"):
        options.initialize(["-never_set", "1", word])
    assert not PETSc.Options().hasName("never_set")


def test_what_petsc_reads_when_it_starts_is_taken_then(python):
    script = "from isorod import options; options.initialize(['-log_view', '-info', ':none'])" + SOLVE
    done = python(script)
    assert "PETSc Performance Summary" in done.stdout, done.stderr


def test_a_process_by_itself_tells_mpi_so_and_no_child(python):
    """Where something has started it as one of several it says nothing."""
    script = (
        "import os, petsc4py\nfrom isorod import options\n"
        "told = lambda: sorted(name for name in os.environ if name.startswith('OMPI_MCA_'))\n"
        "before = told()\npetsc4py.init = lambda words: print([name for name in told() if name not in before])\n"
        "options.initialize([])\nprint(told() == before)"
    )
    alone = {name: text for name, text in os.environ.items() if not name.startswith(("OMPI_", "PMI"))}
    assert python(script, env=alone).stdout == "['OMPI_MCA_ess_singleton_isolated', 'OMPI_MCA_pml']\nTrue\n"
    own = alone | {"OMPI_MCA_pml": "ucx"}
    assert python(script, env=own).stdout == "['OMPI_MCA_ess_singleton_isolated']\nTrue\n"
    for launched in ("OMPI_COMM_WORLD_SIZE", "PMI_RANK"):
        assert python(script, env=alone | {launched: "1"}).stdout == "[]\nTrue\n"


READ = "from isorod import options; options.initialize({}); from petsc4py import PETSc; print(PETSc.Options().getAll())"


def test_a_folder_gives_no_options(python, tmp_path):
    """Options run code and write files: those of a folder that came from somebody else are not the user's."""
    home, here = tmp_path / "home", tmp_path / "here"
    for folder, word in ((home, "mine"), (here, "theirs")):
        folder.mkdir()
        (folder / ".petscrc").write_text(f"-of {word}\n")
    (here / "petscrc").write_text("-of theirs\n")
    (here / "named").write_text("-of named\n")
    own = os.environ | {"HOME": str(home)}
    done = python(READ.format([]), cwd=here, env=own)
    assert "'of': 'mine'" in done.stdout
    assert done.stderr == f"isorod: PETSc options of {home}/.petscrc\n"
    done = python(READ.format(["-options_file", "named"]), cwd=here, env=own)
    assert "'of': 'named'" in done.stdout
    assert done.stderr == f"isorod: PETSc options of {home}/.petscrc, named\n"
    done = python(READ.format([]), cwd=here, env=own | {"HOME": str(tmp_path)})
    assert "'of'" not in done.stdout
    assert done.stderr == ""


BAD = {
    "words": ("snes_rtol 1\n", ["-options_file", "{file}"], "Unknown first token in options file .* line 1: snes_rtol"),
    "bytes": (
        "\udcff\udcfe \udc80\n",
        ["-options_file", "{file}"],
        "Unknown first token in options file .* line 1: .*",
    ),
    "no name": ("", ["-options_file"], "Missing filename for -options_file filename option"),
    "yaml": ("", ["-options_string_yaml", "{{{{{{"], ".*YAML.*"),
    "popped": ("", ["-prefix_pop"], "Object is in wrong state More prefixes popped than pushed"),
}


@pytest.mark.parametrize("case", BAD)
def test_options_that_petsc_cannot_read_are_one_line(case, isorod, tmp_path):
    content, words, said = BAD[case]
    file = tmp_path / "options"
    file.write_text(content, errors="surrogateescape")
    done = isorod("run", "spring", *(word.format(file=file) for word in words))
    note = f"(isorod: PETSc options of {file}\n)?"
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(f"{note}isorod: PETSc options: ([A-Z][a-z ]+ )?{said}\n", done.stderr), done.stderr


def test_a_prefix_is_ended():
    with pytest.raises(
        InputError, match=r"^PETSc option -prefix_push: it stays for all others; end it with -prefix_pop$"
    ):
        options.initialize(["-prefix_push", "mine_"])


def test_what_petsc_prints_while_it_starts_is_kept(tmp_path, python):
    file = tmp_path / "options"
    file.write_text("-snes_rtol 1e-3\n")
    script = (
        "import os; from isorod import options; import petsc4py; true = petsc4py.init\n"
        "def start(words): true(words); os.write(2, b'a word\\n')\n"
        f"petsc4py.init = start; options.initialize(['-options_file', {str(file)!r}])\n"
        "from petsc4py import PETSc; print(PETSc.Options().getReal('snes_rtol'))"
    )
    done = python(script)
    assert (done.stdout, done.stderr) == ("0.001\n", f"isorod: PETSc options of {file}\na word\n")


def test_a_folder_for_temporary_files_that_is_none_is_done_without(isorod, tmp_path, monkeypatch):
    """Open MPI ends programs with a page of text, and exit code 1, where it cannot make its folder there."""
    place = tmp_path / "a file"
    place.touch()
    monkeypatch.setenv("TMPDIR", str(place / "below"))
    done = isorod("run", "spring", "--preset", "paper", "--coils", "1", "--no-estimate")
    assert (done.returncode, done.stderr) == (0, "")


def test_no_folder_for_temporary_files_at_all_is_one_line(monkeypatch):
    def none():
        raise FileNotFoundError

    monkeypatch.setenv("TMPDIR", "/nowhere")
    monkeypatch.setattr(options.tempfile, "gettempdir", none)
    with pytest.raises(InputError, match=r"^TMPDIR /nowhere: cannot be written to; name a folder that can be$"):
        options._temporary()
