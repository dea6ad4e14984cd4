# `make demo` runs the main job; `make check` is for every edit; `make test` is all that CI checks.
VENV   ?= .venv
PYTHON ?= python3
BIN     = $(VENV)/bin
READY   = $(VENV)/.ready
CODE    = src tests benchmarks examples hardware scripts/docs_hooks.py scripts/moving_picture.py
LOCK    = requirements/lock.txt
# Two workers on two cores: libraries that start a thread per core would only compete with each other.
PYTEST  = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest
# Bytecode is kept even where the environment says otherwise: the tests start hundreds of processes, each of which would
# compile every module anew (`feel --help` 0.7 s in place of 0.2, collecting the tests 9 s in place of 6).
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo check test lint types imports fast unit package realtime fuzz coverage docs docs-figures audit lock clean

# RECORDING=finger.wav sends that instead of the simulated finger's sound.
demo: $(READY)  ## stroke a smooth and a rough stone, with no hardware; prints where picture and sound are
	$(BIN)/python -m tactophone demo $(if $(RECORDING),--recording '$(RECORDING)')

check: lint types fast  ## lint, types and the fast tests

# What needs one processor runs two at once; the tests share both.
test: $(READY)  ## everything that CI checks
	$(MAKE) --jobs 2 --output-sync=target package types lint imports
	$(MAKE) unit realtime

$(READY): pyproject.toml $(LOCK) scripts/system-packages
	scripts/system-packages
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet torch==2.13.0  # not in the lock: its build, and so its hash, differs by machine
	$(BIN)/python -m pip install --quiet --require-hashes --requirement $(LOCK)
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	-command -v npm >/dev/null && npm install --silent --no-audit --no-fund --fetch-retries 0 --fetch-timeout 20000 --prefix tests/node  # axe-core, Foxglove's client
	touch $@

lint: $(READY)
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)

types: $(READY)
	$(BIN)/mypy

imports: $(READY)
	$(BIN)/lint-imports

fast: $(READY)
	$(PYTEST) -n 2 -m 'not realtime and not slow and not package' tests

unit: $(READY)
	$(PYTEST) -n 2 --dist worksteal -m 'not realtime and not package'

# Installs the wheel without extras in a fresh environment, and runs every verb there.
package: $(READY)
	$(PYTEST) -m package tests/test_package.py

# Real servers and processes, three at once (four are no faster on two cores), by file name, so that no file of few long
# tests is last; those that measure the time of sound one after another. A shared machine may stall in the middle of a
# test, so each may be repeated; the summary shows why.
# One that stands still for 5 minutes ends with the traceback of every thread.
RERUNS = --reruns 2 --reruns-delay 1 --rerun-show-tracebacks -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true
TIMED  = tests/live/runtime/test_safety.py tests/live/runtime/test_stalls.py tests/app/measurement/test_latency.py tests/cli/test_try.py
REALTIME = $(filter-out $(TIMED),$(sort $(shell grep -rl --include='test_*.py' 'mark\.realtime' tests)))
realtime: $(READY)
	$(PYTEST) -n 3 --dist loadfile --no-loadscope-reorder -m realtime $(RERUNS) $(REALTIME)
	$(BIN)/python -m pytest -m realtime $(RERUNS) $(TIMED)

# Guided by coverage where atheris is installed; `make test` has 30 s of random inputs (tests/fuzz/test_fuzz.py), and the
# same examples of the property tests in every run.
FUZZ_SECONDS ?= 600
fuzz: $(READY)  ## every parser of outside bytes, for FUZZ_SECONDS; then the property tests with new examples
	$(BIN)/python -m tests.fuzz --seconds $(FUZZ_SECONDS)
	HYPOTHESIS_PROFILE=random $(PYTEST) -n 2 -m hypothesis

coverage: $(READY)
	$(PYTEST) -m 'not package' --cov=tactophone --cov-report=term:skip-covered

docs: $(READY)  ## the documentation site, in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Runs each script whose figures or pictures the docs print, but those that need a data set (benchmarks/README.md marks them).
FIGURES = help_time live_compute simulation link demo_scores printed_pad touch_events scale latency latency_figure page pictures
docs-figures: $(READY)  ## measure again what the docs print: tables on the terminal, pictures in docs/images
	for name in $(FIGURES); do echo "== $$name"; $(BIN)/python benchmarks/$$name.py $(if $(filter pictures,$$name),docs/images) || exit; done

# Without a network it says so, and succeeds.
audit:  ## check the locked packages against the known vulnerabilities
	scripts/audit

# Resolves the lock anew from pyproject.toml, with the newest versions it allows.
lock:
	scripts/lock

include models.mk

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
