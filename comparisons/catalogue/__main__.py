"""``python -m comparisons.catalogue [NAME ...]``: the table of catalogue rods, printed row by row."""

import sys

from comparisons.catalogue import REFERENCES, compare
from comparisons.catalogue.computed import compute
from isorod import options

options.initialize([])
print("rod | quantity | isorod | reference | difference | known to | mesh | seconds, warnings of isorod")
for name in sys.argv[1:] or dict.fromkeys(one.name for one in REFERENCES):
    rows = list(compare([name]))
    computed = compute(name, [row.reference.measure for row in rows])
    for row in rows:
        reference = row.reference
        value, known, by = reference.value, "stored", reference.by
        if computed is not None:
            limit = computed.limits[reference.measure]
            value, known, by = limit.values[0], f"{100 * limit.uncertainty:.2g} %", computed.by
        off = 100.0 * (row.value / value - 1.0)
        cells = (name, reference.measure, f"{row.value:.6g}", f"{value:.6g}", f"{off:+.2f} %", known, by)
        print(" | ".join(cells), f"{row.seconds:.0f}, {len(row.warnings)}", sep=" | ", flush=True)
