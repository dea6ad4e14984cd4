# Two commands do everything:  `make demo` runs the main job, `make test` passes all checks and tests.
VENV   ?= .venv
PYTHON ?= python3
BIN     = $(VENV)/bin
READY   = $(VENV)/.ready

.PHONY: demo test lint types imports unit realtime model clean

# RECORDING=finger.wav sends that in place of the simulated finger's sound.
demo: $(READY)  ## feel a smooth and a rough stone, with no hardware: prints where picture and sound are
	$(BIN)/python -m tactophone demo $(if $(RECORDING),--recording '$(RECORDING)')

test: lint types imports unit realtime  ## everything CI checks

$(READY): pyproject.toml scripts/system-packages
	scripts/system-packages
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet torch==2.13.0  # before the rest, so that nothing asks for a larger build
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

lint: $(READY)
	$(BIN)/ruff check src tests benchmarks
	$(BIN)/ruff format --check src tests benchmarks

types: $(READY)
	$(BIN)/mypy

imports: $(READY)
	$(BIN)/lint-imports

# Two workers on two cores: libraries that start a thread a core themselves would only get in each other's way.
unit: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m 'not realtime'

# Real servers and processes, one after another: they would disturb each other's timing. A shared machine may stand
# still in the middle of one, so each may be tried again; whatever needed that is named at the end.
realtime: $(READY)
	$(BIN)/python -m pytest -m realtime --reruns 2 --reruns-delay 1 -rR tests

# Makes the models inside the package anew, from simulated sound alone: docs/training.md. About half an hour.
# RECORDINGS, if it is there, holds real recordings: those that can hear one air microphone are scored on them too.
RECORDINGS ?= ../shared/recordings
STONES = build/stones
MODELS = src/tactophone/perception/models
TRAIN  = $(BIN)/python -m tactophone train $(STONES) --where split=train --opus 96
WAYS   = ours impulses level rules median-frequency surface scalogram-cnn logistic boosting
SCORE  = $(BIN)/python -m tactophone evaluate
model: $(READY)
	$(BIN)/python -m tactophone simulate dataset $(STONES) --seconds 10
	$(TRAIN) --precision bfloat16 --out $(MODELS)/paper.onnx
	$(TRAIN) --precision bfloat16 --out $(MODELS)/paper-mono.onnx --variant one-channel
	for way in $(WAYS); do $(TRAIN) --recipe $$way --out $(MODELS)/$$way.onnx || exit; done
	for model in paper paper-mono $(WAYS); do \
	  $(SCORE) $$model --data $(STONES) --where split=test --note "simulated, held out" || exit; \
	done
	test ! -d "$(RECORDINGS)/lmt" || for model in paper-mono $(filter-out scalogram-cnn,$(WAYS)); do \
	  $(SCORE) $$model --data "$(RECORDINGS)/lmt" --where tier=core --note "real, lmt core (air microphone)" || exit; \
	done

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
