"""What `isorod run` prints of vibrations under harmonic or random excitation."""

from collections.abc import Iterator, Mapping
from typing import Any

# Peaks of each that are shown, and resonances.
_PEAKS, _MOST = 6, 12


def rows(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield peaks, resonances and the state they are about."""
    for name, peaks in record.get("peaks", {}).items():
        if not peaks:
            continue
        highest = sorted(sorted(peaks, key=lambda one: -one[1])[:_PEAKS])
        more = f"; {len(peaks) - _PEAKS} lower ones" if len(peaks) > _PEAKS else ""
        yield f"peaks {name.replace('_', ' ')}", "; ".join(map(_peak, highest)) + more
    if "apparent" in record:
        frequencies = (f"{name.replace('_', ' ')} {one:.6g}" for name, one in record["apparent"].items())
        yield "root mean squares", "of the values above; they pass zero upwards at " + ", ".join(frequencies)
    resonances = [
        f"{frequency:.6g} ({100.0 * ratio:.3g} %)"
        for frequency, ratio in zip(record["resonances"], record["ratios"], strict=True)
    ]
    if resonances:
        more = f" and {len(resonances) - _MOST} more" if len(resonances) > _MOST else ""
        yield "resonances", ", ".join(resonances[:_MOST]) + more + ", of critical damping"
    yield "about", record["about"]
    left = record["left_out"]
    more = left["shapes"] - left["modes"]
    counts = "1 mode" if left["modes"] == 1 else f"{left['modes']} modes"
    yield "left out", f"{left['share']:.1g} of the energy norm, by {counts} and {more} from residuals"


def _peak(peak: list[float]) -> str:
    frequency, size, *phase = peak
    return f"{size:.5g} at {frequency:.6g}" + (f" (phase {phase[0]:.0f})" if phase else "")
