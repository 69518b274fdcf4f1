"""Studies that set isorod beside finite elements and beside published numbers; run from the checkout, not installed."""
