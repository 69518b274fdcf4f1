"""docs/files.md and docs/keys: their tables are those of the schema, the examples run."""

import re

from isorod.command import new
from tests.files_page import FOLDER, PAGES, TITLES, pages

PAGE = FOLDER.parent / "files.md"


def test_the_tables_are_those_of_the_schema():
    """``python -m tests.files_page`` writes them anew."""
    assert pages() == {one.name: one.read_text() for one in FOLDER.glob("*.md")}


def test_all_words_are_on_a_page_and_all_pages_are_linked():
    text = "\n".join(pages().values())
    assert all(f"## {title}\n" in text for title in TITLES)
    words = [word.strip() for forms in TITLES.values() for word in forms if word.strip()]
    assert len(words) > 60 and all(f"### `{word}`\n" in text for word in words)
    assert all(f"](keys/{name}.md)" in PAGE.read_text() for name in PAGES)


def test_the_example_runs(tmp_path, command):
    contents = re.findall(r"```toml\n(title.*?)```", PAGE.read_text(), re.DOTALL)
    for content, answer in zip(contents, ("tip ", "stretch ", "tip ", "case "), strict=True):
        (tmp_path / "my.toml").write_text(content)
        assert command.prints("run", tmp_path / "my.toml").lstrip().startswith(answer)


def test_the_examples_are_named():
    text = PAGE.read_text()
    assert all(name in text for name in new.GALLERY if name != new.STARTER)
