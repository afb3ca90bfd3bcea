# Targets for a fresh Debian machine with Python 3.11, make and nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
LINK := canopen
AXIS := config/axes/edm-vertical$(patsubst -canopen,,-$(LINK)).toml
SEED ?= 1000
RUNS ?= 2000
STAMP := $(VENV)/.installed
# One thread of linear algebra a process: at these sizes several only wait for each other.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Tests start some hundred programs: what is compiled once is kept.
unexport PYTHONDONTWRITEBYTECODE

# The floors that need no wire and no process of their own.
QUICK := core signals models recordings importing estimation control experiments sim face cli
# Those whose tests wait for a wire or for other programs, and those that only compute.
WIRED := docs drivers end_to_end faults fuzz node peer service tuning view workbench
# Of the first kind's folders what waits for nobody: programs that compute, one after the other.
ALONE := docs/test_walkthrough.py
COMPUTED := $(filter-out $(WIRED) support %.py __pycache__,$(notdir $(wildcard tests/*)))
ANNOUNCED := echo "the tests: about five minutes on two cores; they are told at the end of each half"

# Everything between host and drive, and what stores, restores and survives.
HURT := node drivers experiments end_to_end tuning service faults fuzz
# A real controller's; a target of their own.
LINUXCNC := export/test_linuxcnc.py docs/test_export_pages.py

.PHONY: install demo test quick check lint types layers unit computed wired quick-tests bench faults long audit linuxcnc pictures clean

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "autotune needs Python 3.11 or newer; found " + sys.version.split()[0] + ". Set PYTHON=/path/to/python3.11.")'
	@$(PYTHON) -m venv $(VENV) || { echo "The venv module is missing: on Debian, apt-get install python3-venv"; exit 1; }
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@$(BIN)/python -m autotune.cli.compile_kernels
	@touch $(STAMP)

demo: install
	@$(BIN)/python -m autotune.cli.demo $(AXIS)

test: install
	@$(MAKE) --no-print-directory check

check:
	@$(MAKE) --no-print-directory --jobs 2 --output-sync lint layers
	@$(ANNOUNCED)
	@$(MAKE) --no-print-directory --jobs 3 --output-sync types wired computed

# What computes fills the time in which the others wait; it gives way to them, because a wire is played in real time.
unit:
	@$(ANNOUNCED)
	@$(MAKE) --no-print-directory --jobs 2 --output-sync wired computed

wired:
	$(BIN)/pytest -n 2 --dist worksteal $(WIRED:%=tests/%) $(ALONE:%=--ignore=tests/%)

computed:
	nice -n 10 $(BIN)/pytest -n 2 --dist worksteal $(COMPUTED:%=tests/%) $(ALONE:%=tests/%)

quick: install
	@$(MAKE) --no-print-directory --jobs 2 --output-sync lint quick-tests

quick-tests:
	$(BIN)/pytest -n 2 --dist worksteal -m 'not slow and not long' $(QUICK:%=tests/%)

lint:
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/python -m bench.house_rules

types:
	nice -n 10 $(BIN)/mypy

layers:
	$(BIN)/lint-imports

bench: install
	@$(BIN)/python -m bench

faults: install
	HYPOTHESIS_PROFILE=random $(BIN)/pytest -n 2 --dist worksteal -m '' $(HURT:%=tests/%)
	$(BIN)/python -m bench.faults --named
	$(BIN)/python -m bench.faults --seed $(SEED) --runs $(RUNS)

# The long tests that neither `faults` nor `linuxcnc` runs: whole fits, pages in a browser, the pages of docs.
long: install
	$(BIN)/pytest -n 2 --dist worksteal -m long tests $(HURT:%=--ignore=tests/%) $(LINUXCNC:%=--ignore=tests/%)

# Known vulnerabilities of the pinned versions. Needs pip-audit and a network; where one is missing this is said, not failed.
audit: install
	@if ! $(BIN)/python -c 'import pip_audit' 2>/dev/null; then \
	  echo "skipped: pip-audit is not installed ($(BIN)/pip install pip-audit)"; \
	else \
	  $(BIN)/python -m bench.audit constraints.txt; \
	fi

# The exported component in a real controller. Debian's packages run without a real-time kernel; installing them needs root.
# Where they cannot be had the tests skip, and say so by name.
linuxcnc: install
	@command -v halcompile >/dev/null || DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends linuxcnc-uspace linuxcnc-uspace-dev \
	  || echo "linuxcnc-uspace and linuxcnc-uspace-dev could not be installed (root, and Debian's package lists, are needed)"
	$(BIN)/pytest -m '' -rs $(LINUXCNC:%=tests/%)

pictures: install
	$(BIN)/python -m bench.pictures
	$(BIN)/python -m bench.architecture_picture

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
