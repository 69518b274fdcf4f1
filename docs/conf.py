"""How `make docs` makes pages of the files in this folder."""

import os
import re

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

import isorod

os.environ.setdefault("OMP_NUM_THREADS", "1")

project = "isorod"
author = "The isorod authors"
project_copyright = "the isorod authors, BSD-3-Clause"
release = version = isorod.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["_static"]
# `isorod.statics` in a docstring is a name.
default_role = "py:obj"
# What has no language is for a shell.
highlight_language = "sh"

myst_enable_extensions = ["amsmath", "dollarmath", "html_image"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}
python_maximum_signature_line_length = 72
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"isorod {release}"
html_static_path = ["_static"]
html_css_files = ["isorod.css"]
html_show_sphinx = False
html_copy_source = False
html_math_renderer = "mathml"


def equation(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write a displayed equation as MathML, with its number where it has one: pages need no script and no network."""
    self.body.append(self.starttag(node, "div", CLASS="math"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append(latex2mathml.tex2mathml(node.astext(), as_block=True))
    self.body.append("</div>")
    raise nodes.SkipNode


def formula(self: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a line as MathML."""
    self.body.append(f'<span class="math">{latex2mathml.tex2mathml(node.astext())}</span>')
    raise nodes.SkipNode


# Pages link to files as they lie in the repository; those that are pages here too are these.
PAGES = {
    "../README.md": "index.md",
    "../CHANGELOG.md": "changelog.md",
    "../CONTRIBUTING.md": "contributing.md",
    "../SECURITY.md": "security.md",
}


def within(app: Sphinx, name: str, source: list[str]) -> None:
    """Let links to files beside this folder lead to their pages."""
    up = "../" * name.count("/")
    for file, page in PAGES.items():
        source[0] = re.sub(rf"\]\({re.escape(up + file)}(#[\w-]+)?\)", rf"]({up}{page}\1)", source[0])


def attributes(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Give each of several attributes that are told of at once, ``a, b``, an entry of its own: napoleon takes one."""
    if "Attributes" not in lines:
        return
    start = lines.index("Attributes") + 2
    found = lines[:start]
    for entry in re.findall(r"^\S[^\n]*(?:\n(?:[ \t][^\n]*)?)*", "\n".join(lines[start:]), re.MULTILINE):
        head, _, text = entry.partition("\n")
        names = head.split(", ") if re.fullmatch(r"\w+(, \w+)+", head) else [head]
        found += [line for one in names for line in f"{one}\n{text}".splitlines()]
    lines[:] = found


def setup(app: Sphinx) -> None:
    """Tell Sphinx of all this."""
    app.add_html_math_renderer("mathml", inline_renderers=(formula, None), block_renderers=(equation, None))
    app.connect("source-read", within)
    # Before napoleon.
    app.connect("autodoc-process-docstring", attributes, priority=400)
