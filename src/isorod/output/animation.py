"""Animated GIFs: pictures one after the other, in one palette."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from isorod.output.results import write_beside

if TYPE_CHECKING:
    from PIL.Image import Image

A_SECOND = 12

# Of a mode, from rest to rest.
SWING = 24


def shares() -> list[float]:
    """Return the shares of a mode's shape in the frames of one swing."""
    return [float(one) for one in np.sin(2.0 * np.pi * np.arange(SWING) / SWING)]


def quarters() -> list[tuple[float, float]]:
    """Return the shares of a whirl's shape, and of that a quarter of a period later, in the frames of one period."""
    return [(float(np.cos(one)), float(np.sin(one))) for one in 2.0 * np.pi * np.arange(SWING) / SWING]


def written(times: ArrayLike) -> str:
    """Return the format in which times are written, the same for all of them."""
    steps = np.diff(np.asarray(times, dtype=float))
    smallest = float(steps[steps > 0.0].min(initial=np.inf))
    digits = max(0, int(np.ceil(-np.log10(smallest) - 1e-9)) + 1) if np.isfinite(smallest) else 3
    return f".{digits}f" if digits < 7 else ".4e"


def save(pictures: "Iterable[Image]", path: Path) -> int:
    """Write pictures as an animation that begins anew at its end, and return their number.

    All have the colours of the first one, whose scale has them all, so that they do not flicker.

    Raises
    ------
    InputError
        If the file cannot be written; none is left then.
    """
    from PIL.Image import Dither

    first, *others = (picture.convert("RGB") for picture in pictures)
    palette = first.quantize(256)
    frames = [picture.quantize(palette=palette, dither=Dither.NONE) for picture in others]
    options: dict[str, Any] = {"duration": 1000 // A_SECOND, "loop": 0, "optimize": True}
    write_beside(
        path, lambda beside: palette.save(beside, format="GIF", save_all=True, append_images=frames, **options)
    )
    return 1 + len(frames)
