# make demo, make test: each alone is enough on a fresh machine with Python 3.11 or later.
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3.14 python3; do \
	command -v $$p >/dev/null 2>&1 && $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
PIP := .venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
READY := .venv/.installed

.PHONY: demo test install lint types unit format benchmarks clean

demo: install  ## run the default scenario, and say where log and report are
	$(BIN)/zenoh-cbef run tracking

test: install lint types unit  ## lint, types, tests

install: $(READY)  ## .venv with the project, its report and its tools, at the versions of constraints.txt

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "zenoh-cbef needs Python 3.11 or later, with venv; install it, or: make PYTHON=/path/to/python3.11" >&2; exit 2; }
	$(PYTHON) -m venv .venv
	$(PIP) --upgrade pip
	$(PIP) hatchling editables
	$(PIP) --no-build-isolation --editable '.[report,lz4,experiment,security,viz]' --group dev
	touch $(READY)

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: install
	$(BIN)/mypy

unit: install
	$(BIN)/pytest -n 2 --dist loadgroup

format: install
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

benchmarks: install  ## the figures of docs/benchmarks.md
	$(BIN)/python -m benchmarks

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis
