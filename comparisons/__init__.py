"""Studies that set isorod beside finite elements and beside published numbers; from the checkout, or installed."""

# A study is a module here with ``run(study)``, and one of that name in `comparisons.report` for its part of the page.
STUDIES = ("spring", "blade", "biceps", "stability", "newcomer", "scaling", "bench", "laws", "joints")

# What compares scenes of anyone's; its runs and records bear this name and the scene's.
COMPARED = "compare"
