"""Where functions of laws are kept: no run of a ready law loads SymPy but the first one, whoever it was."""

from test_compile import barred, environment, other_user, tree  # noqa: F401

LAW = """
import sys, numpy, isorod
law = isorod.Orthotropic((3.0, 2.0, 1.0), (0.2, 0.2, 0.2), (1.0, 1.0, 1.0), ((1, 0, 0), (0, 1, 0)))
print(law.stress(1.5 * numpy.eye(3)[None])[0, 2, 2].round(3), "sympy" in sys.modules)
"""


def test_the_first_process_writes_what_the_next_one_reads(python, tmp_path):
    kept = environment(NUMBA_CACHE_DIR=str(tmp_path))
    assert python(LAW, env=kept).stdout == "0.77 True\n"
    (text,) = (tmp_path / "isorod-laws").glob("law_*.law")
    assert python(LAW, env=kept).stdout == "0.77 False\n"
    text.unlink()
    assert python(LAW, env=kept).stdout == "0.77 True\n"
    assert text.is_file()


def test_beside_the_laws_others_read_it(tree, python):  # noqa: F811
    alone = environment(PYTHONPATH=str(tree), HOME="/dev/null", XDG_CACHE_HOME="/dev/null")
    assert python(LAW, env=alone).stdout == "0.77 True\n"
    folders = [path for path in tree.rglob("*") if path.is_dir()]
    for folder in folders:
        folder.chmod(0o555)
    done = python(LAW, env=alone, **other_user())
    for folder in folders:
        folder.chmod(0o755)
    assert (done.stdout, done.stderr) == ("0.77 False\n", "")


def test_where_nothing_can_be_kept_a_law_is_one_all_the_same(tree, python):  # noqa: F811
    assert python(LAW, env=barred(tree)).stdout == "0.77 True\n"
