"""docs/files.md: its tables are those of the schema, its example runs."""

import re

from isorod.command import new
from tests.files_page import BEGIN, PAGE, tables


def test_the_tables_are_those_of_the_schema():
    """``python -m tests.files_page`` writes them anew."""
    assert f"{BEGIN}\n{tables()}\n" in PAGE.read_text()


def test_the_example_runs(tmp_path, command):
    contents = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for content, answer in zip(contents, ("tip ", "stretch ", "case "), strict=True):
        (tmp_path / "my.toml").write_text(content)
        assert command.prints("run", tmp_path / "my.toml").lstrip().startswith(answer)


def test_the_examples_are_named():
    text = PAGE.read_text()
    assert all(name in text for name in new.EXAMPLES if name != new.STARTER)
