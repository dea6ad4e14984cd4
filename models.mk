# Trains the shipped models again, on the authors' 20 training objects: one for the pad, one for the stylus, and the
# paper's network; about 25 minutes of one core, each step under 15. With TACTOPHONE_RECORDINGS set to a folder of real
# recordings, the stylus learns from its `lmt` too.
SETS   = build/sets
MODELS = src/tactophone/perception/models
RENDER = $(BIN)/python -m tactophone simulate dataset --seconds 6
OBJECTS = --objects $(shell seq -s, 0 19)
TRAIN  = $(BIN)/python -m tactophone train
RECIPE = --recipe examples/recipes
PAD    = $(SETS)/pad-train --also $(SETS)/pad-hall
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
	$(TRAIN) $(PAD) $(RECIPE)/texture.toml --out $(MODELS)/texture.onnx

model-stylus: sets
	$(TRAIN) $(SETS)/stylus-train --also $(SETS)/stylus-hall $(addprefix --also ,$(LMT)) \
	  $(RECIPE)/stylus.toml --out $(MODELS)/stylus.onnx

model-paper: sets
	$(TRAIN) $(PAD) $(RECIPE)/paper.toml --out $(MODELS)/paper.onnx

model-paper-mono: sets
	$(TRAIN) $(PAD) $(RECIPE)/paper-mono.toml --out $(MODELS)/paper-mono.onnx

# Writes the scores on held-out simulated objects into the models' cards.
scores: sets
	for model in texture paper paper-mono; do \
	  $(SCORE) $$model --data $(SETS)/pad-test --note "simulated, held out" || exit; \
	done
	$(SCORE) stylus --data $(SETS)/stylus-test --note "simulated, held out"
