"""``python -m comparisons.catalogue [NAME ...]``: the table of catalogue rods, printed."""

import sys

from comparisons.catalogue import compare

for row in compare(sys.argv[1:]):
    one = row.reference
    print(f"{one.name}: {one.measure} {row.value:.6g}, {one.by} {one.value:.6g}, {100 * row.off:+.2f} %", end=", ")
    print(f"{row.seconds:.0f} s, {len(row.warnings)} warnings", flush=True)
