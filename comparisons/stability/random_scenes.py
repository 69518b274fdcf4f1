"""Random scenes of slender rods, run as files by the command with nothing chosen, beside frames of thin bars.

``python -m comparisons.stability.random_scenes FOLDER SEED ...`` keeps the files in a folder, and prints by how much
each is off, its estimate and its warnings, and what is off by more than half a percent.  The frames know neither the
thickness of a curved bar nor how layers share a load near supports of means.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.stability import random_frames

# Degrees below which an angle is none.
_LEAST_TURN = 1e-9

# What is off by more is wrong.
LARGE = 5e-3

# Of these each number counts by itself.
_EACH = ("frequencies", "factors")


def toml(value: Any) -> str:
    """Return a value as TOML, tables inline."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def text(tables: Mapping[str, Any]) -> str:
    """Return a scene as TOML, a line for each thing that has a name."""
    found = []
    for key, value in tables.items():
        if isinstance(value, Mapping):
            found += [f"[{key}]", *(f"{name} = {toml(one)}" for name, one in value.items())]
        else:
            found.insert(0, f"{key} = {toml(value)}")
    return "\n".join(found) + "\n"


def run(path: Path, *words: str, seconds: float = 300.0) -> tuple[dict[str, Any] | str, list[str]]:
    """Return the record of a run, or why it is refused, and its warnings."""
    command = [sys.executable, "-m", "isorod", "run", path.name, "--json", *words]
    done = subprocess.run(command, cwd=path.parent, capture_output=True, text=True, check=False, timeout=seconds)
    said = [line.removeprefix("isorod: ") for line in done.stderr.splitlines() if line.startswith("isorod: ")]
    warned = [one.removeprefix("warning: ") for one in said if one.startswith("warning: ")]
    if done.returncode:
        return done.stderr.splitlines()[-1], warned
    return json.loads(done.stdout.splitlines()[-1]), warned


def off(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> dict[str, float]:
    """Return differences of answers, each as a share of the largest of its kind (the word before ``_``)."""
    sizes: dict[str, float] = {}
    for name, value in wanted.items():
        kind = name.partition("_")[0]
        sizes[kind] = max(sizes.get(kind, 0.0), float(np.abs(value).max()))
    if "moment" in sizes:
        # Forces of rods that moments alone bend are nothing.
        sizes["force"] = max(sizes["force"], 1e-3 * sizes["moment"] / wanted["length"])
    if "turn" in sizes:
        # Angles of what is only drawn out are rounding.
        sizes["turn"] = max(sizes["turn"], _LEAST_TURN)
    told = {}
    for name, value in wanted.items():
        if name == "length":
            continue
        one, other = (np.asarray(each, dtype=float).ravel() for each in (found[name], value))
        # Buckling has as many factors as are asked for.
        count = min(one.size, other.size)
        one, other = one[:count], other[:count]
        apart = (
            np.abs(one / other - 1.0).max()
            if name in _EACH
            else np.linalg.norm(one - other) / sizes[name.partition("_")[0]]
        )
        told[name] = float(apart)
    return told


def main(arguments: Sequence[str]) -> int:
    """Run seeds; keep files in a folder if one is named."""
    seeds = [int(one) for one in arguments if one.isdigit()]
    folder = Path(next((one for one in arguments if not one.isdigit()), tempfile.mkdtemp()))
    folder.mkdir(exist_ok=True)
    for seed in seeds:
        tables, wanted = random_frames.draw(seed)
        path = folder / f"scene{seed}.toml"
        path.write_text(text(tables))
        try:
            record, warned = run(path)
        except subprocess.TimeoutExpired:
            print(seed, "took too long", flush=True)
            continue
        if isinstance(record, str):
            print(seed, "refused:", record, flush=True)
            continue
        apart = off(record, wanted)
        told = {name: (apart[name], record[name], value) for name, value in wanted.items() if name in apart}
        worst = max(one for one, *_ in told.values())
        print(
            seed,
            f"{100 * worst:.3f} %",
            "estimate",
            record.get("error_estimate"),
            "stress",
            record.get("stress_error"),
            record["seconds"]["total"],
            flush=True,
        )
        for name, (one, *both) in told.items():
            if one > LARGE:
                print("   ", name, one, *(np.asarray(each).tolist() for each in both))
        for line in warned:
            print("    warned:", line[:200])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
