"""The cost of estimates of error: ``python -m comparisons.stability.cost``.

One JSON line: the time of the estimate over that of the run, default spaces, and that of ``--tolerance 5e-3`` on the
blade over that of the best discretisation known by hand (`comparisons.blade.BEST`).  Processor time of one process,
measured in turn, the least of each.
"""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from comparisons.blade import BEST
from comparisons.measure import timing
from isorod import options, statics
from isorod.command import refine, solving
from isorod.command.parser import Parser, add_fields, field_values
from isorod.geometry import section
from isorod.geometry.center_line import straight
from isorod.material import NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.output import results
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space

TOLERANCE = 5e-3


def bar() -> Any:
    """Return the solution of a clamped round bar with a force at its end."""
    space = Space(straight(10.0).sweep(section.circle(8)))
    load = SectionLoad.end(space, "end", (0.0, 1e-3, 0.0))
    return statics.solve(Model([Body(space, NeoHookean(1.0, 0.3))], [Support.end(space, "start")], loads=[load]))


def best() -> Blade:
    """Return the blade on the best discretisation known by hand."""
    parser = Parser()
    add_fields(parser, Blade())
    return Blade(**field_values(parser.parse_args(BEST[TOLERANCE][0].split()), Blade()))


def measure(turns: int) -> dict[str, float]:
    """Return the ratios, of the least times in so many turns after a first one."""
    solves: dict[str, Callable[[], Any]] = {
        "bar": bar,
        "spring": lambda: solving.solve(Spring(helix="paper"), {})[0],
        "blade": lambda: solving.solve(Blade(), {})[0],
    }
    hand = best()
    times = {name: timing.least([solve, _estimates(solve)], 1 + turns) for name, solve in solves.items()}
    pair: list[Callable[[], Any]] = [partial(solving.solve, hand, {}), partial(refine.refine, Blade(), {}, TOLERANCE)]
    # The estimate is what comes after the solution.
    ratios = {f"estimate of the {name}": both / alone - 1.0 for name, (alone, both) in times.items()}
    by_hand, by_itself = timing.least(pair, 1 + turns)
    return ratios | {"tolerance on the blade": by_itself / by_hand}


def _estimates(solve: Callable[[], Any]) -> Callable[[], Any]:
    return lambda: solve().estimate()


def main(arguments: Sequence[str]) -> int:
    """Measure in as many turns as are asked for (20)."""
    options.initialize([])
    print(results.line(measure(int(arguments[0]) if arguments else 20)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
