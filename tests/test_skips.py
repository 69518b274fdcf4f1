"""Tests that need a package which is not there: skipped on a machine of one's own, failures in CI."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FILES = {
    "whole": 'import pytest\npytest.importorskip("no_such_package")\n\ndef test_one(): pass\n',
    "single": 'import pytest\n\ndef test_one():\n    pytest.importorskip("no_such_package")\n',
    "program": 'import pytest\n\ndef test_one():\n    pytest.skip("mpirun is not installed")\n',
    "other": 'import pytest\n\ndef test_one():\n    pytest.skip("pins are for Debian")\n',
}


@pytest.mark.parametrize(
    ("ci", "code", "skipped"),
    [({}, 0, {"whole", "single", "program", "other"}), ({"CI": "true"}, 1, {"other"})],
    ids=["elsewhere", "in CI"],
)
def test_a_missing_package_fails_in_ci_alone(ci, code, skipped, tmp_path):
    shutil.copy(Path(__file__).parent / "conftest.py", tmp_path)
    for name, text in FILES.items():
        (tmp_path / f"test_{name}.py").write_text(text)
    environment = {key: value for key, value in os.environ.items() if key != "CI"} | ci
    options = ["-q", "-ra", "-p", "no:cacheprovider", "--continue-on-collection-errors", "--rootdir", tmp_path]
    command = [sys.executable, "-m", "pytest", *options, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=60)
    assert done.returncode == code, done.stdout
    assert set(re.findall(r"^SKIPPED .*test_(\w+)\.py", done.stdout, re.MULTILINE)) == skipped
    bad = set(re.findall(r"^(?:FAILED|ERROR) .*test_(\w+)\.py.*CI must have it$", done.stdout, re.MULTILINE))
    assert bad == set(FILES) - skipped
