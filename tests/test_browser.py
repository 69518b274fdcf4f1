"""The report page in a browser: it fits wide and narrow screens, can be read in light and dark, and prints on A4."""

import html
import json
import os
import re
import shutil
import subprocess
from itertools import pairwise

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("rich")
Image = pytest.importorskip("PIL.Image")
report_page = pytest.importorskip("test_report_page")

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OPTIONS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage"
).split()

# What a page is found to be, by a script beside it that has it in a frame of some width.  Rules for dark screens, or
# for paper, hold for all where a medium is asked for.
LOOK = """
function look(page, medium) {
  for (const sheet of page.styleSheets) for (const rule of sheet.cssRules)
    if (rule.media && medium && rule.conditionText.includes(medium)) rule.media.mediaText = 'all';
  const view = page.defaultView, root = page.documentElement, poor = [];
  const parts = text => (text.match(/[\\d.]+/g) || []).map(Number);
  const linear = c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const light = text => [0.2126, 0.7152, 0.0722].reduce((sum, w, k) => sum + w * linear(parts(text)[k] / 255), 0);
  for (const one of page.body.querySelectorAll('*')) {
    if (![...one.childNodes].some(n => n.nodeType == 3 && n.data.trim()) || !one.offsetParent) continue;
    let behind = one, ground = '';
    while (behind && (!ground || parts(ground)[3] === 0)) {
      ground = view.getComputedStyle(behind).backgroundColor; behind = behind.parentElement; }
    if (parts(ground)[3] === 0) ground = 'rgb(255, 255, 255)';
    const both = [light(view.getComputedStyle(one).color), light(ground)].sort((a, b) => b - a);
    const contrast = (both[0] + 0.05) / (both[1] + 0.05);
    if (contrast < 4.5) poor.push([one.tagName, one.textContent.slice(0, 30), contrast]);
  }
  const width = root.clientWidth;
  return {
    width, scrolls: root.scrollWidth - width, poor, ground: view.getComputedStyle(page.body).backgroundColor,
    wide: [...page.querySelectorAll('img, table, pre, p, dd')].filter(one => one.offsetParent)
      .map(one => [one.tagName, one.getBoundingClientRect().right - width, !!one.closest('.wide, pre')])
      .filter(one => one[1] > 1),
    headings: [...page.querySelectorAll('h1, h2, h3, h4')].map(one => Number(one.tagName[1])),
    images: [...page.images].map(one => [one.alt, one.naturalWidth]),
    lost: [...page.querySelectorAll('a[href^="#"]')].map(one => one.hash)
      .filter(one => !page.getElementById(one.slice(1))),
    hidden: [...page.querySelectorAll('nav')].every(one => !one.offsetParent),
  };
}
addEventListener('load', () => {
  const found = [...document.querySelectorAll('iframe')].map(one => look(one.contentDocument, one.dataset.medium));
  document.getElementById('found').textContent = JSON.stringify(found);
});
"""

# Width in pixels, and a medium besides the screen; of A4 what margins leave.
SEEN = ((1300, ""), (420, ""), (1300, "dark"), (420, "dark"), (680, "print"))


def browser(folder, *words):
    """Run the browser, with a profile of its own, and return what it prints."""
    if BROWSER is None:
        pytest.skip("no browser here (apt install chromium)")
    own = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    options = [*OPTIONS, f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run([BROWSER, *options, *words], capture_output=True, text=True, timeout=120, env=own)
    assert done.returncode == 0, done.stderr[-500:]
    return done.stdout


def look(folder, text):
    """Return what is found of a page of a folder, in each of the ways it is seen."""
    frames = "".join(
        f'<iframe data-medium="{medium}" style="width:{width}px;height:900px;border:0" srcdoc="{html.escape(text)}">'
        "</iframe>"
        for width, medium in SEEN
    )
    around = folder / "around.html"
    around.write_text(f"<!doctype html><meta charset=utf-8><script>{LOOK}</script>{frames}<pre id=found></pre>")
    shown = browser(folder, "--virtual-time-budget=10000", "--dump-dom", around.as_uri())
    return json.loads(html.unescape(re.search("<pre id=.?found.?>(.*?)</pre>\\s*</body>", shown, re.DOTALL)[1]))


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The folder of a page of spring and blade, its text, and how it is seen."""
    folder = tmp_path_factory.mktemp("browser")
    for study in report_page.SCENES:
        report_page.made(study, folder)
    text = report_page.write(folder).read_text()
    # Plots as large as they are drawn.
    for name in report_page.Page(text).files:
        if name.endswith((".png", ".gif")):
            Image.new("RGB", (1560, 700), "white").save(folder / name)
    return folder, text, look(folder, text)


def test_the_page_fits_every_width_and_can_be_read(report):
    seen = dict(zip(SEEN, report[2], strict=True))
    for (width, medium), found in seen.items():
        assert abs(found["width"] - width) < 20
        assert found["scrolls"] <= 0, (width, medium)
        assert found["poor"] == [], (width, medium)
        # What is wider scrolls in a box of its own, on paper nothing.
        assert [one for one in found["wide"] if medium == "print" or not one[2]] == [], (width, medium)
        assert found["hidden"] == (medium == "print")
    assert seen[1300, ""]["ground"] != seen[1300, "dark"]["ground"]


def test_headings_pictures_and_links_are_what_readers_need(report):
    folder, text, (found, *_) = report
    levels = found["headings"]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(later <= before + 1 for before, later in pairwise(levels))
    assert found["images"] and all(len(alt) > 10 and width == 1560 for alt, width in found["images"])
    assert found["lost"] == []
    assert all((folder / name).is_file() for name in report_page.Page(text).files)


def test_the_page_prints_on_sheets_of_a4(report):
    folder = report[0]
    file = folder / "report.pdf"
    browser(folder, "--no-pdf-header-footer", f"--print-to-pdf={file}", (folder / "report.html").as_uri())
    content = file.read_bytes()
    sheets = re.findall(rb"/Type\s*/Page\b.*?/MediaBox\s*\[([\d. ]+)\]", content, re.DOTALL)
    sizes = {tuple(round(float(one)) for one in sheet.split()) for sheet in sheets}
    assert sizes == {(0, 0, 595, 842)}
    assert 4 <= len(sheets) <= 16


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ("<p style='color:#999'>pale words</p>", "poor"),
        ("<div style='width:1500px'>wide</div>", "scrolls"),
        ('<a href="#nowhere">nowhere</a>', "lost"),
    ],
)
def test_what_is_wrong_is_found(wrong, what, tmp_path):
    """The script beside the page finds each fault of a page of nothing else."""
    found = look(tmp_path, f"<!doctype html><title>page</title><h1>Page</h1>{wrong}")[0]
    faults = {"poor": bool(found["poor"]), "scrolls": found["scrolls"] > 0, "lost": found["lost"] == ["#nowhere"]}
    assert [name for name, there in faults.items() if there] == [what]
