"""``python -m comparisons.catalogue [NAME ...]``: the table of catalogue rods, printed."""

import sys

from comparisons.catalogue import compare

for row in compare(sys.argv[1:]):
    told = f"{row.reference.name}: {row.reference.measure} {row.value:.6g}, {row.reference.by} {row.reference.value:.6g}"
    print(f"{told}, {100 * row.off:+.2f} %, {row.seconds:.0f} s, {len(row.warnings)} warnings", flush=True)
