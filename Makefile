# `make demo` runs the main job; `make check` is for every edit; `make test` is all that CI checks.
VENV   ?= .venv
PYTHON ?= python3
BIN     = $(VENV)/bin
# Stamps: what the demo needs is installed, and what everything else needs, which includes it.
DEMO    = $(VENV)/.demo
READY   = $(VENV)/.ready
PROJECTS = packages/tactophone/pyproject.toml packages/tactophone-lab/pyproject.toml
CODE    = conftest.py packages tests benchmarks examples integrations hardware scripts
# One worker a core: libraries that start a thread per core would only compete with each other.
# The slowest tests are listed, so that one that grows is seen.
PYTEST  = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --durations=25 --durations-min=2
CORES  := $(shell nproc)
# Bytecode is kept even where the environment says otherwise: the tests start hundreds of processes, each of which would
# compile every module anew (`feel --help` 0.7 s in place of 0.2, collecting the tests 9 s in place of 6).
export PYTHONDONTWRITEBYTECODE =

.PHONY: integrations demo check room test lint types imports fast unit long beside package realtime timed fuzz mutants coverage golden docs docs-figures audit cost lock benchmarks-smoke clean

# RECORDING=finger.wav sends that instead of the simulated finger's sound.
demo: $(DEMO)  ## stroke a smooth and a rough stone, with no hardware; prints where picture and sound are
	@$(BIN)/python -m tactophone demo $(if $(RECORDING),--recording '$(RECORDING)')

$(DEMO): $(PROJECTS) requirements/demo.txt scripts/install scripts/system-packages
	@scripts/install demo $(VENV) $(PYTHON)

$(READY): $(PROJECTS) requirements/lock.txt scripts/install scripts/system-packages
	@scripts/install test $(VENV) $(PYTHON)

check: $(READY)  ## lint, types and the fast tests
	@$(MAKE) --jobs $(CORES) --output-sync=target lint types
	@$(MAKE) fast

# A room is a folder of tests and of src, on any floor: link, perception, lab.
room: $(READY)  ## lint, types and tests of one room: make room ROOM=link
	@$(if $(ROOM),,$(error name a room: make room ROOM=link))
	@rooms=$$(find packages/*/src packages/*/tests tests -type d -name '$(ROOM)' -not -path '*/node_modules/*'); \
	  test -n "$$rooms" || { echo "no room is named $(ROOM)" >&2; exit 1; }; set -ex; \
	  $(BIN)/ruff check $$rooms; $(BIN)/ruff format --check $$rooms; $(BIN)/mypy; \
	  $(PYTEST) -n $(CORES) -m 'not package' $(RERUNS) $$rooms

# The unit tests are nice and fill what the realtime ones leave of the processors; the timed ones have all of them. RERUN
# lists what had to be repeated, so that all sessions together fail at the third (conftest.py). CHANGED=1 leaves out
# the floors of tests that nothing changed since origin/main can break.
TESTS := $(if $(CHANGED),$(shell python3 scripts/changed_tests.py),tests packages)
test: export TACTOPHONE_RERUN_LIST = $(abspath $(VENV))/.rerun
test: $(READY)  ## all but `make long`, as CI checks it; CHANGED=1: what the changes since origin/main can break
	@rm -f $(VENV)/.rerun
	$(MAKE) --jobs $(CORES) --output-sync=target package types lint imports
	$(MAKE) --jobs 2 --output-sync=target beside realtime
	$(MAKE) timed

lint: $(READY)
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)

types: $(READY)
	$(BIN)/mypy

imports: $(READY)
	$(BIN)/lint-imports

fast: $(READY)
	$(PYTEST) -n $(CORES) -m 'not realtime and not slow and not package and not long' tests packages/*/tests

unit: $(READY)
	$(PYTEST) -n $(CORES) --dist worksteal -m 'not realtime and not package and not long' $(TESTS)

beside: $(READY)
	nice -n 19 $(MAKE) unit

# Trainings and pages that take the time of a hundred other tests; CI runs them beside `make test`.
long: $(READY)  ## the tutorial and the notebook as they stand on their pages, virtual nights, benchmarks, trainings of examples and tables
	$(PYTEST) -n $(CORES) -m long tests packages

# Installs the wheel without extras in a fresh environment, and runs every verb there.
package: $(READY)
	$(PYTEST) -m package tests/test_package.py

# Real servers and processes, one more at once than there are cores, by file name, so that no file of few long tests is
# last; those that measure the time of sound one after another, with nothing beside them. A shared machine may stall in
# the middle of a test, so each may be repeated; the summary shows why.
# One that stands still for 5 minutes ends with the traceback of every thread.
RERUNS = --reruns 2 --reruns-delay 1 --rerun-show-tracebacks -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true
marked = $(sort $(shell grep -rl --include='test_*.py' 'mark\.$(1)' $(2)))
realtime: $(READY)
	$(PYTEST) -n $(shell expr $(CORES) + 1) --dist loadfile --no-loadscope-reorder -m 'realtime and not timed' $(RERUNS) $(call marked,realtime,$(TESTS))

timed: $(READY)
	$(PYTEST) -m timed $(RERUNS) $(call marked,timed,tests packages)

# Guided by coverage where atheris is installed; `make test` has 5 s of random inputs (tests/fuzz/test_fuzz.py), and the
# same examples of the property tests in every run.
FUZZ_SECONDS ?= 600
fuzz: $(READY)  ## every parser of outside bytes, for FUZZ_SECONDS; then the property tests with new examples
	$(BIN)/python -m tests.fuzz --seconds $(FUZZ_SECONDS)
	HYPOTHESIS_PROFILE=random $(PYTEST) -n $(CORES) -m hypothesis

# lerobot asks for another torch: LEROBOT=its/bin/python tests in an environment that has it (integrations/README.md).
integrations: $(READY)  ## the packages for other programs, those of them that are installed
	$(PYTEST) -n $(CORES) --dist worksteal integrations/*/tests
	$(BIN)/python scripts/guest_readmes.py
	$(if $(LEROBOT),PYTHONPATH=packages/tactophone/src:packages/tactophone-lab/src:. OMP_NUM_THREADS=1 $(LEROBOT) -m pytest -p no:cacheprovider \
	  integrations/lerobot_*/tests)

# A tenth of a minute each, some up to two minutes; the seed decides which. Without --draw all of them, for some hours.
DRAW ?= 100
SEED ?= 0
mutants: $(READY)  ## DRAW small faults in code that keeps a promise, and which of them no test of its room finds
	$(BIN)/python scripts/mutants.py --draw $(DRAW) --seed $(SEED)

# Encoder, detector and profiles decide what is in it; a change of its files is a change of what is felt.
golden: $(READY)  ## the golden run anew, where what is felt is meant to change: review its difference
	PYTHONPATH=. $(BIN)/python tests/data/golden_run/make.py

coverage: $(READY)
	$(PYTEST) -m 'not package' --cov=tactophone --cov=tactophone_lab --cov-report=term:skip-covered

docs: $(READY)  ## the documentation site, in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Runs each script whose figures or pictures the docs print, but those that need a data set (benchmarks/README.md marks them),
# and draws the pictures: of pages, of `feel`, the moving one and the tutorial's. hardware/pictures.py draws the printed parts.
FIGURES = help_time live_compute simulation link demo_scores printed_pad touch_events scale latency latency_figure page pictures
docs-figures: $(READY)  ## measure again what the docs print: tables on the terminal, pictures in docs/images
	for name in $(FIGURES); do echo "== $$name"; $(BIN)/python benchmarks/$$name.py $$(test $$name != pictures || echo docs/images) || exit; done
	$(BIN)/python -m tactophone demo --out build/demo
	$(BIN)/python scripts/moving_picture.py build/demo
	RENEW=1 $(BIN)/python -m pytest -q tests/test_tutorial.py

# Where the registry does not answer for single versions, it says so, and succeeds.
audit:  ## check the locked packages against the known vulnerabilities
	scripts/audit

# Needs valgrind. Counts of another Python or another version of a library are not compared.
cost: $(READY)  ## instructions of a packet by stage; fails where one differs from benchmarks/cost.json by 3 %
	$(BIN)/python benchmarks/cost.py --check

# Resolves the lock anew from pyproject.toml, with the newest versions it allows.
lock:
	scripts/lock

# Their figures mean nothing: NAMES='edges scale' runs some.
benchmarks-smoke: $(READY)  ## each script of benchmarks/ in a small setting, to see that it still reaches its end
	$(BIN)/python benchmarks/smoke.py $(NAMES)

include models.mk

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
