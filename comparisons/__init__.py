"""Studies that set isorod beside finite elements and beside published numbers; run from the checkout, not installed."""

# A study is a module here with ``run(study)``, and one of that name in `comparisons.report` for its part of the page.
STUDIES = ("spring", "blade", "biceps", "stability")
