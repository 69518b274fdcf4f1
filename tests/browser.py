"""A browser without a display, driven as the W3C's WebDriver says, which Debian's chromium-driver does."""

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from contextlib import contextmanager

import pytest

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --window-size=1200,800"
)


class Browser:
    """One page."""

    def __init__(self, address):
        self.address = address

    def ask(self, path, **body):
        """Send a command; return the answer's value."""
        data = None if body.pop("get", False) else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, {"Content-Type": "application/json"})
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def run(self, script, *arguments):
        """Return what a script in the page returns."""
        return self.ask("/execute/sync", script=script, args=list(arguments))

    def until(self, script, *arguments, seconds=60.0):
        """Return what a script in the page returns, as soon as that is true."""
        end = time.monotonic() + seconds
        while not (found := self.run(script, *arguments)):
            assert time.monotonic() < end, f"in vain: {script}"
            time.sleep(0.05)
        return found

    def picture(self):
        """Return a screenshot, PNG."""
        return base64.b64decode(self.ask("/screenshot", get=True))

    def click(self, x, y):
        """Press and release the left button at a pixel."""
        move = {"type": "pointerMove", "duration": 0, "x": round(x), "y": round(y)}
        steps = [move, {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}]
        mouse = {"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": steps}
        self.ask("/actions", actions=[mouse])


@contextmanager
def browser(folder):
    """Open a browser that keeps what it keeps in a folder; skip the test where none is."""
    for program in ("chromium", "chromedriver"):
        if shutil.which(program) is None:
            pytest.skip(f"there is no {program}, by which a page is seen")
    words = ["chromedriver", "--port=0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as driver:
        try:
            line = next(line for line in driver.stdout if "successfully on port" in line)
            port = int(line.split("on port")[1].strip(" .\n"))
            options = {"args": [*FLAGS.split(), f"--user-data-dir={folder}"], "binary": shutil.which("chromium")}
            wanted = {"alwaysMatch": {"goog:chromeOptions": options}}
            session = Browser(f"http://127.0.0.1:{port}").ask("/session", capabilities=wanted)["sessionId"]
            page = Browser(f"http://127.0.0.1:{port}/session/{session}")
            yield page
            urllib.request.urlopen(urllib.request.Request(page.address, method="DELETE"), timeout=30)
        finally:
            driver.terminate()
