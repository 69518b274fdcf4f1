"""Numbers as people read them."""

# Kinds of cells in files: what suits a body, rational Bezier cells (`isorod.output.bezier`), many small linear ones.
CELLS = "auto", "bezier", "linear"


def duration(seconds: float) -> str:
    """Return a time in words: milliseconds, seconds, minutes or hours."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    if seconds < 3600.0:
        return f"{int(seconds / 60.0)} min {int(seconds % 60.0)} s"
    return f"{int(seconds / 3600.0):,} h {int(seconds % 3600.0 / 60.0)} min"
