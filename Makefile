# make demo, make test: each alone is enough on a fresh machine with Python 3.11 or later.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3.14 python3; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
PIP := .venv/bin/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt
# pip would compile one file after the other, also the half that no program here imports.
COMPILE := .venv/bin/python -m compileall -q -q -j 0 -x '/(tests|pip|pymavlink)/' .venv/lib || true
READY := .venv/.installed
CORES ?= $(shell getconf _NPROCESSORS_ONLN)
# Plug-ins that these tests do not use: each worker would import them, notebooks' with all of Jupyter.
LEAN := -p no:nbmake -p no:anyio -p no:pytest_cov -p no:xdist.looponfail
WORKERS ?= $(shell echo $$(($(CORES) + 2)))
# Else each of the thousand processes of the tests would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test install lint types unit fast thorough coverage mutants format docs benchmarks clean

help:  ## what can be made
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST)

demo: install  ## run the default scenario, and say where log and report are
	$(BIN)/zenoh-cbef run tracking

# Types are checked while tests run, many of which wait.
test: install lint  ## lint, types, tests
	@$(MAKE) --no-print-directory -j 2 types unit

install: $(READY)  ## .venv with the project, its report and its tools, at the versions of constraints.txt

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "zenoh-cbef needs Python 3.11 or later, with venv; install it, or: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	$(PYTHON) -m venv .venv
	$(PIP) --upgrade pip
	$(PIP) hatchling editables
	$(PIP) --no-build-isolation --editable '.[report,lz4,experiment,viz,lab,foxglove,ros,pandas,xarray,receive]' --group dev --group docs
	$(COMPILE)
	touch $(READY)

lint: install  ## ruff: lint and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: install  ## mypy, strict
	$(BIN)/mypy

# A file's tests stay with one worker, as they share runs.
unit: install  ## all tests; two workers more than there are cores, as many tests wait
	$(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder || { [ $$? -eq 1 ] && $(BIN)/python -m tests.alone; }

fast: install  ## the tests that start no process and simulate no long runs (a minute)
	$(BIN)/pytest -n $(WORKERS) --dist worksteal -m "not processes and not slow" $(LEAN)

thorough: install  ## all tests that start no process, with ten times as many random examples (minutes)
	EXAMPLES=10 $(BIN)/pytest -n $(CORES) --dist worksteal -m "not processes" $(LEAN)

coverage: install  ## which lines the fast tests run; processes are not counted
	$(BIN)/pytest -n $(CORES) --dist loadfile -m "not processes" --cov --cov-report=term

mutants: install  ## tests of the tests: change the package here and there, and see whether one fails (minutes)
	$(BIN)/python -m benchmarks.mutants

format: install  ## correct what ruff can correct by itself
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: install  ## the site, into site/
	$(BIN)/mkdocs build --strict --quiet

benchmarks: install  ## the figures of docs/benchmarks.md
	$(BIN)/python -m benchmarks

clean:  ## remove what make made
	rm -rf site build .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis
