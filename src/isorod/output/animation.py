"""Animated GIFs: pictures with a common palette."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from isorod.output.picture import COLOURS
from isorod.output.results import write_beside

if TYPE_CHECKING:
    from PIL.Image import Image

A_SECOND = 12

# Frames of one period of a mode.
SWING = 24


def amplitudes() -> list[float]:
    """Return the factors of a mode's shape in the frames of one period."""
    return [float(one) for one in np.sin(2.0 * np.pi * np.arange(SWING) / SWING)]


def quarters() -> list[tuple[float, float]]:
    """Return the factors of a whirl's shape and its quarter-period shape in the frames of one period."""
    return [(float(np.cos(one)), float(np.sin(one))) for one in 2.0 * np.pi * np.arange(SWING) / SWING]


def written(times: ArrayLike) -> str:
    """Return a common format for times."""
    steps = np.diff(np.asarray(times, dtype=float))
    smallest = float(steps[steps > 0.0].min(initial=np.inf))
    digits = max(0, int(np.ceil(-np.log10(smallest) - 1e-9)) + 1) if np.isfinite(smallest) else 3
    return f".{digits}f" if digits < 7 else ".4e"


def save(pictures: "Iterable[Image]", path: Path) -> int:
    """Write pictures as an endless animation, and return their number.

    Raises
    ------
    InputError
        If the file cannot be written; none is then left.
    """
    from PIL.Image import Dither

    palette = _palette()
    first, *others = [picture.convert("RGB").quantize(palette=palette, dither=Dither.NONE) for picture in pictures]
    options: dict[str, Any] = {"duration": 1000 // A_SECOND, "loop": 0, "optimize": True}
    write_beside(path, lambda where: first.save(where, format="GIF", save_all=True, append_images=others, **options))
    return 1 + len(others)


def _palette() -> "Image":
    """Return an image with one palette for all frames, so that colours do not flicker.

    It has the colours of the scale, darker ones as under lines, and greys.
    """
    from matplotlib import colormaps
    from PIL import Image

    scale = colormaps[COLOURS](np.linspace(0.0, 1.0, 44))[:, :3]
    shades = np.concatenate([scale * shade for shade in (1.0, 0.87, 0.72, 0.55, 0.35)])
    greys = np.linspace(0.0, 1.0, 36)[:, None] * np.ones(3)
    image = Image.new("P", (1, 1))
    image.putpalette(np.round(255.0 * np.concatenate([shades, greys])).astype(np.uint8).tobytes())
    return image
