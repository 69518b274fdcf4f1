# Every task sets up what it needs (docker/install: apt packages or wheels, .venv) and starts at once when that is done.
# With PYTHON=... nothing is installed and that interpreter is used: make test PYTHON=python in a conda environment.
ifdef PYTHON
INSTALL := true
OPPONENTS := true
else
INSTALL := docker/install
OPPONENTS := docker/opponents
PYTHON := .venv/bin/python
# the wheels bring an mpirun of their own
export PATH := $(CURDIR)/.venv/bin:$(PATH)
endif

# One thread per rank: fair timings, and mpirun on few cores. No user site: the environment decides the versions.
export OMP_NUM_THREADS := 1
export PYTHONNOUSERSITE := 1
# what is compiled is kept, also where the environment says not to: tests start some hundred processes
unexport PYTHONDONTWRITEBYTECODE
# mpirun refuses root otherwise, which is what containers run as
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
# ranks of one machine talk through memory: Debian's exclusions and tcp, of which Open MPI 5 complains in containers
export OMPI_MCA_btl ?= ^uct,openib,ofi,tcp

.PHONY: help verify bench test test-all mutants lint docs install clean

help:
	@echo "make verify    the main job: spring and blade against finite elements, quick level, and the report page"
	@echo "make bench     isorod beside every program: dolfinx of two versions, and NGSolve; LEVEL=full takes hours"
	@echo "make test      the tests but the slow ones         make test-all   all tests"
	@echo "make mutants   share of 200 small wrong changes that the tests catch: an hour; MUTANTS='--seed 2 --jobs 2' to choose"
	@echo "make docs      these pages in build/docs/html: theory, gallery, names; warnings are errors"
	@echo "make lint      ruff and mypy                       make clean      remove caches and build leftovers"
	@echo "make install   only set up (the others do it too): apt packages (root on Debian 12, 13) or wheels (any Linux), .venv"
	@echo "GROUND=wheels  before any of them: neither apt nor root; GROUND=apt: Debian's packages, by sudo where not root"
	@echo "PYTHON=python  after any of them: use that interpreter and install nothing (conda: environment.yml)"

verify: install
	@$(PYTHON) -m comparisons verify

# What is not here is left out, and named. Another dolfinx stands in a venv of its own.
LEVEL := quick
bench:
	@$(OPPONENTS)
	@$(PYTHON) -m comparisons bench --level $(LEVEL) \
		$(addprefix --dolfinx ,$(wildcard .venv-wheels/bin/python)) $(BENCH)

# Files of tests side by side, one more than there are processors, as some wait for a browser or a disk; more than four
# would be in the way of those that start ranks.
WORKERS := $(shell n=$$(nproc); echo $$((n < 4 ? n + 1 : 4)))
PYTEST := -m pytest -n $(WORKERS) --dist loadfile

test: install
	@$(PYTHON) $(PYTEST) -m "not slow"

test-all: install
	@$(PYTHON) $(PYTEST)

mutants: install
	@$(PYTHON) -m tests.mutants $(MUTANTS)

lint: install
	@$(PYTHON) -m ruff check
	@$(PYTHON) -m ruff format --check
	@$(PYTHON) -m mypy

docs: install
	@$(PYTHON) -m sphinx -q -W --keep-going docs build/docs/html
	@echo "build/docs/html/index.html"

install:
	@$(INSTALL)

clean:
	@rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis build dist *.egg-info
	@find src comparisons meshes tests -name __pycache__ -type d -prune -exec rm -rf {} +
