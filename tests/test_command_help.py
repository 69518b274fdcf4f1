"""What the command says of itself: help, lists, completion, and options by their former names."""

import json

import pytest

from isorod import scenes
from isorod.command import cli, pages
from isorod.command.new import EXAMPLES
from isorod.command.parser import Parser, add_fields


# What writes meshes is a program of its own.
@pytest.mark.parametrize("command", [name for name in pages.PAGES if name != "mesh"])
def test_a_commands_page_is_short_and_has_an_example_of_it(command, capsys):
    try:
        code = cli.main([command, "--help"])
    except SystemExit as ended:
        code = ended.code
    out = capsys.readouterr().out
    assert code == 0
    assert f"isorod {command}" in out
    assert f"example  isorod {command}" in out
    if command in pages.USAGES and command not in ("plot", "view"):
        assert out.count("\n") <= 12


def test_without_a_command_help_is_printed_and_the_code_is_that_of_an_error(capsys):
    assert cli.main([]) == 2
    assert "isorod COMMAND --help" in capsys.readouterr().out
    # Of a command it is what was asked for.
    assert cli.main(["run"]) == 0
    assert "example  isorod run" in capsys.readouterr().out


def test_help_with_a_single_dash_is_ours_where_petsc_has_none(capsys):
    assert cli.main(["run", "-help"]) == 0
    assert "example  isorod run" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        cli.main(["-help"])
    assert "usage: isorod" in capsys.readouterr().out


def test_all_scenes_and_examples_are_listed_with_their_analyses(capsys):
    assert cli.main(["list"]) == 0
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    analyses = ("statics", "modal", "buckling", "harmonic", "dynamics")
    listed = [one[0] for one in words if len(one) > 2 and one[1] in analyses]
    assert {*scenes.SCENES, *EXAMPLES} - {*listed} == {"flower", "ring"}


@pytest.mark.parametrize(
    ("name", "former", "now", "value"),
    [
        ("spring", "--pull=0.001", "--travel", 0.001),
        ("strand", "--twist=0.0001", "--twist-rate, in degrees", 0.00572957795130823),
    ],
)
def test_a_former_name_is_taken_with_a_warning_that_says_the_present_one(name, former, now, value):
    scene = scenes.find(name)()
    parser = Parser(prog="isorod")
    add_fields(parser, scene)
    with pytest.warns(FutureWarning, match=f"{former.split('=')[0]}: renamed, use {now}"):
        found = parser.known([former])
    assert getattr(found, now[2:].partition(",")[0].replace("-", "_")) == pytest.approx(value, rel=1e-12)


def test_part_of_a_turn_is_as_soft_as_it_should_be(capsys):
    """Rates of 3, 3.5 and 4 coils: reciprocals are on a straight line but for the ends' part."""
    rates = []
    for coils in ("3", "3.5", "4"):
        words = ["run", "spring", "--coils", coils, "--travel", "1e-3", "--no-estimate", "--json"]
        assert cli.main(words) == 0
        rates.append(json.loads(capsys.readouterr().out)["force"])
    assert 2.0 / rates[1] == pytest.approx(1.0 / rates[0] + 1.0 / rates[2], rel=0.01)


def completed(monkeypatch, capsys, line):
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setenv("COMP_POINT", str(len(line)))
    assert cli.main(["--complete"]) == 0
    return capsys.readouterr().out.split()


def test_a_shell_completes_commands_scenes_options_and_values(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sprung.toml").write_text("")
    assert completed(monkeypatch, capsys, "isorod sec") == ["section"]
    assert completed(monkeypatch, capsys, "isorod run spr") == ["spring", "sprung.toml"]
    assert completed(monkeypatch, capsys, "isorod run spring --tra") == ["--travel"]
    assert completed(monkeypatch, capsys, "isorod run spring --cells c") == ["curved"]
    assert completed(monkeypatch, capsys, "isorod new --from tre") == ["trefoil"]
    assert completed(monkeypatch, capsys, "isorod run spring --pu") == []
    assert completed(monkeypatch, capsys, "isorod run none.toml --") == []


def test_the_completion_is_installed_where_bash_looks_for_it(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert cli.main(["--install-completion"]) == 0
    text = (tmp_path / "bash-completion" / "completions" / "isorod").read_text()
    assert text.strip() in capsys.readouterr().out
    monkeypatch.setenv("XDG_DATA_HOME", "/dev/null/none")
    assert cli.main(["--install-completion"]) == 2
    assert capsys.readouterr().err.startswith("isorod: /dev/null/none/bash-completion/completions/isorod: cannot be")


def test_a_comparison_says_its_own_options(capsys):
    assert cli.main(["compare", "bar.toml", "--leve", "full"]) == 2
    assert capsys.readouterr().err == (
        "isorod: option --leve is not known; did you mean --level? (see isorod compare --help)\n"
    )


def test_warnings_have_the_names_of_the_file(tmp_path, capsys):
    """One brick's width of contact on a ring of eight points is warned of, by the names of contact and rod."""
    assert cli.main(["new", str(tmp_path / "ring.toml"), "--from", "press"]) == 0
    assert cli.main(["run", str(tmp_path / "ring.toml"), "--no-estimate"]) == 0
    out, err = capsys.readouterr()
    assert "isorod: warning: contact floor: contact patch under-resolved: " in err
    assert "on rod ring at u = " in err
    assert "body" not in out + err
