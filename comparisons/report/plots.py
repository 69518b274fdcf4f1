"""Plots made from result records alone."""

from collections.abc import Sequence
from pathlib import Path

from comparisons.measure.records import Record
from isorod.output.results import write_beside

# Okabe and Ito's colours: told apart by colour-blind readers too.
COLOURS = ("#0072B2", "#009E73", "#56B4E9", "#004D40", "#3F51B5", "#00BFA5", "#1A237E", "#7CB342")
FEM_COLOURS = ("#D55E00", "#E69F00", "#CC79A7", "#8B0000", "#A0522D", "#FF6F91", "#6A1B9A", "#9E9D24")
# One fewer than colours, so that no two of many curves look alike.
MARKERS = "osD^vPX"


def work_precision(records: Sequence[Record], target: float, quantity: str, path: Path) -> None:
    """Draw error against warm run time and against unknowns, one curve a family.

    Parameters
    ----------
    records
        Records with ``curve``, ``method``, ``error``, ``dofs``, ``seconds``.
    target
        Error marked by a line.
    quantity
        What the error is of.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    curves = len({record["curve"] for record in records})
    figure, axes = pyplot.subplots(1, 2, figsize=(12.5, max(5.2, 0.26 * curves)), sharey=True, layout="constrained")
    styles: dict[str, dict[str, str]] = {}
    for record in records:
        if record["curve"] not in styles:
            same = [curve for curve, style in styles.items() if style["method"] == record["method"]]
            fem = record["method"] == "fem"
            colours = FEM_COLOURS if fem else COLOURS
            styles[record["curve"]] = {
                "method": record["method"],
                "color": colours[len(same) % len(colours)],
                "marker": MARKERS[len(same) % len(MARKERS)],
                "linestyle": "--" if fem else "-",
            }
    for curve, style in styles.items():
        points = [record for record in records if record["curve"] == curve]
        errors = [record["error"] for record in points]
        look = {key: value for key, value in style.items() if key != "method"}
        label = f"{curve} (dolfinx)" if style["method"] == "fem" else f"cylindrical, {curve}"
        axes[0].loglog([record["seconds"]["total"] for record in points], errors, label=label, **look)
        axes[1].loglog([record["dofs"] for record in points], errors, **look)
    for axis, label in zip(axes, ("warm run time, one thread [s]", "degrees of freedom"), strict=True):
        line = axis.axhline(target, color="black", linewidth=0.8)
        axis.set_xlabel(label)
        axis.grid(True, which="both", alpha=0.25)
    line.set_label(f"{100 * target:g} %")
    axes[0].set_ylabel(f"relative error of the {quantity}")
    figure.legend(loc="outside right center", frameon=False)
    write_beside(path, lambda where: figure.savefig(where, dpi=130))
    pyplot.close(figure)


def convergence(entries: Sequence[Record], path: Path) -> float:
    """Draw Fig. 13: errors of the first three frequencies against the finest model, and return their common slope.

    Parameters
    ----------
    entries
        Records with ``elements`` and ``frequencies``, coarse to fine; the last is the reference.
    """
    import matplotlib

    matplotlib.use("Agg")
    import numpy as np
    from matplotlib import pyplot

    elements = np.array([record["elements"] for record in entries[:-1]], dtype=float)
    reference = np.array(entries[-1]["frequencies"][:3])
    errors = np.array([record["frequencies"][:3] for record in entries[:-1]]) / reference - 1.0
    slopes = -np.polyfit(np.log(elements), np.log(errors), 1)[0]
    figure, axis = pyplot.subplots(figsize=(6.2, 4.6), layout="constrained")
    for k in range(3):
        label = f"mode {k + 1}, slope {slopes[k]:.2f}"
        axis.loglog(elements, errors[:, k], color=COLOURS[k], marker=MARKERS[k], label=label)
    guide = errors[0].mean() * (elements / elements[0]) ** -3.0
    axis.loglog(elements, guide, color="black", linewidth=0.8, linestyle=":", label="slope 3")
    axis.set_xlabel("elements")
    axis.set_ylabel("frequency / frequency of the finest model - 1")
    axis.set_xticks(elements, [f"{count:g}" for count in elements])
    axis.minorticks_off()
    axis.grid(True, alpha=0.25)
    axis.legend(frameon=False)
    write_beside(path, lambda where: figure.savefig(where, dpi=130))
    pyplot.close(figure)
    return float(slopes.mean())
