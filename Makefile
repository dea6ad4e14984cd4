# `make demo` runs the main job; `make check` is for every edit; `make test` is all that CI checks.
VENV   ?= .venv
PYTHON ?= python3
BIN     = $(VENV)/bin
READY   = $(VENV)/.ready
CODE    = src tests benchmarks examples hardware scripts/retired_words scripts/docs_hooks.py
# Two workers on two cores: libraries that start a thread per core would only compete with each other.
PYTEST  = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest
# Bytecode is kept even where the environment says otherwise: the tests start hundreds of processes, each of which would
# compile every module anew (`feel --help` 0.7 s in place of 0.2, collecting the tests 9 s in place of 6).
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo check test lint types imports words fast unit package realtime fuzz coverage docs lock model clean

# RECORDING=finger.wav sends that instead of the simulated finger's sound.
demo: $(READY)  ## stroke a smooth and a rough stone, with no hardware; prints where picture and sound are
	$(BIN)/python -m tactophone demo $(if $(RECORDING),--recording '$(RECORDING)')

check: lint types words fast  ## lint, types, retired words and the fast tests

# What needs one processor runs two at once; the tests share both.
test: $(READY)  ## everything that CI checks
	$(MAKE) --jobs 2 --output-sync=target package types lint imports words
	$(MAKE) unit realtime

$(READY): pyproject.toml constraints.txt scripts/system-packages
	scripts/system-packages
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet torch==2.13.0  # not in constraints.txt: its build, and so its hash, differs by machine
	$(BIN)/python -m pip install --quiet --require-hashes --requirement constraints.txt
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

words: $(READY)
	$(BIN)/python scripts/retired_words

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
TIMED  = tests/runtime/test_safety.py tests/runtime/test_stalls.py tests/measurement/test_latency.py tests/cli/test_try.py
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

# Resolves constraints.txt anew from pyproject.toml, with the newest versions it allows.
lock:
	scripts/lock

# Trains the shipped models again, on the authors' 20 training objects: one for the pad, one for the stylus, and the
# paper's network; about 25 minutes of one core, each step under 15. With TACTOPHONE_RECORDINGS set to a folder of real
# recordings, the stylus learns from its `lmt` too.
SETS   = build/sets
MODELS = src/tactophone/perception/models
RENDER = $(BIN)/python -m tactophone simulate dataset --seconds 6
OBJECTS = --objects $(shell seq -s, 0 19)
TRAIN  = $(BIN)/python -m tactophone train --opus-bitrate 96
PAD    = $(SETS)/pad-train --also $(SETS)/pad-hall
PAPER  = --recipe paper-fast --precision bfloat16
SCORE  = $(BIN)/python -m tactophone evaluate
TEST   = --objects 23,24,25,26,27,28,29,30,31,32 --takes long_medium,short_light,wiggle
LMT    = $(wildcard $(TACTOPHONE_RECORDINGS)/lmt)
.PHONY: sets model-texture model-stylus model-paper model-paper-mono scores
model: sets model-texture model-stylus model-paper model-paper-mono scores

sets: $(READY)
	$(RENDER) $(OBJECTS) $(SETS)/pad-train --takes long_medium,short_light,wiggle --seed 21
	$(RENDER) $(OBJECTS) $(SETS)/pad-hall --takes long_loud,short_medium --hall --seed 24
	$(RENDER) $(OBJECTS) $(SETS)/stylus-train --tip stylus --takes long_medium,short_light,wiggle --seed 22
	$(RENDER) $(OBJECTS) $(SETS)/stylus-hall --tip stylus --takes long_loud,short_medium --hall --seed 25
	$(RENDER) $(TEST) $(SETS)/pad-test --seed 31
	$(RENDER) $(TEST) $(SETS)/stylus-test --tip stylus --seed 32

model-texture: sets
	$(TRAIN) $(PAD) --recipe texture --out $(MODELS)/texture.onnx

model-stylus: sets
	$(TRAIN) $(SETS)/stylus-train --also $(SETS)/stylus-hall $(addprefix --also ,$(LMT)) --recipe texture --channels 1 \
	  --microphone air --tip stylus --out $(MODELS)/stylus.onnx

model-paper: sets
	$(TRAIN) $(PAD) $(PAPER) --out $(MODELS)/paper.onnx

model-paper-mono: sets
	$(TRAIN) $(PAD) $(PAPER) --variant one-channel --out $(MODELS)/paper-mono.onnx

# Writes the scores on held-out simulated objects into the models' cards.
scores: sets
	for model in texture paper paper-mono; do \
	  $(SCORE) $$model --data $(SETS)/pad-test --note "simulated, held out" || exit; \
	done
	$(SCORE) stylus --data $(SETS)/stylus-test --note "simulated, held out"

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
