"""Derivatives as text: a line for each parameter, with the change by one percent of it."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

# Entries of a list that are shown.
_ENTRIES = 4


def lines(record: Mapping[str, Any]) -> Iterator[str]:
    """Yield the derivatives of a record, a table for each result."""
    if "differences" in record:
        yield f"derivatives with their errors are differences of answers: exact ones are {record['differences']}"
    for parameter, why in record["no_derivatives"].items():
        yield f"no derivative by {parameter}: {why}"
    for name, by in record["derivatives"].items():
        values = np.atleast_1d(np.asarray(record[name], dtype=float)).ravel()
        for k, value in enumerate(values[:_ENTRIES]):
            own = name if values.size == 1 else f"{name}[{k}]"
            width = max((len(one) for one in by), default=0)
            yield f"{own.replace('_', ' ')} = {value:.6g} by".ljust(width + 2) + "derivative".rjust(14) + "  1 % of it"
            for parameter, entry in by.items():
                rate = float(np.asarray(entry["derivative"]).ravel()[k])
                change = f"{entry['at'] * rate / value:+10.3g} %" if value else ""
                known = entry.get("error_estimate")
                error = "" if known is None else f"  known to {100.0 * known:.2g} %"
                yield f"  {parameter:{width}}{rate:14.6g}{change}{error}"
