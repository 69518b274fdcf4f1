"""The pages that `make docs` builds: without a warning, complete, and to be read without a network."""

import re
import subprocess
import sys
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import pytest

import isorod

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Each page of a fresh build by its name, as `make docs` makes them."""
    for package in ("sphinx", "furo", "myst_parser", "sphinx_copybutton"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("pages")
    words = ["-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(folder / "kept"), "docs", str(folder / "html")]
    assert " ".join(words[:5]) in (ROOT / "Makefile").read_text()
    # Collecting garbage is a third of the time: nodes of pages are many, and refer to each other.
    build = "import gc, sys; gc.disable(); from sphinx.cmd.build import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", build, *words[2:]], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return {file.relative_to(folder / "html"): file.read_text() for file in (folder / "html").rglob("*.html")}, folder


def attributes(text, name):
    return [unescape(one) for one in re.findall(rf'\b{name}="([^"]*)"', text)]


def test_links_between_pages_lead_to_places_that_are_there(pages):
    texts, folder = pages
    places = {page: {*attributes(text, "id"), *attributes(text, "name")} for page, text in texts.items()}
    checked = 0
    for page, text in texts.items():
        for link in attributes(text, "href") + attributes(text, "src"):
            if re.match(r"https?:|data:|mailto:", link):
                continue
            file, _, place = link.partition("#")
            target = (folder / "html" / page.parent / unquote(file.split("?")[0])) if file else folder / "html" / page
            assert target.resolve().exists(), (page, link)
            if place and target.suffix == ".html":
                name = target.resolve().relative_to((folder / "html").resolve())
                assert unquote(place) in places[name], (page, link)
            checked += 1
    assert checked > 1000


def test_pages_load_nothing_from_a_network(pages):
    for page, text in pages[0].items():
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"([^\"]+)\"", text)
        assert loaded
        assert not [one for one in loaded if re.match(r"(https?:)?//", one)], page


def test_equations_are_mathml(pages):
    theory = {page: text for page, text in pages[0].items() if page.parts[0] == "theory"}
    assert len(theory) >= 6
    for page, text in theory.items():
        assert "<math" in text, page
    assert 'href="#equation-map"' in theory[Path("theory/element.html")]


def test_every_name_that_isorod_offers_is_told_of(pages):
    told = {one for text in pages[0].values() for one in attributes(text, "id")}
    # Modules are told of by what is in them.
    functions = {"dynamics": "solve", "modal": "solve", "statics": "solve", "options": "initialize", "scenes": "find"}
    functions |= {"fenics": "Solid", "buckling": "solve", "harmonic": "solve", "random": "solve"}
    for name in isorod.__all__:
        if name == "errors":
            continue
        wanted = f"isorod.{name}.{functions[name]}" if name in functions else f"isorod.{name}"
        assert wanted in told, wanted
