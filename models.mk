# Trains the shipped models again, on the authors' 20 training objects and eleven soft ones: one for each tip, and the
# paper's network; each step under 15 minutes of one core. With TACTOPHONE_RECORDINGS set to a folder of real recordings,
# the stylus learns from its `lmt` too. At -12 dB one take of 620 clips; training undoes the gain.
SETS   = build/sets
MODELS = packages/tactophone/src/tactophone/signal/perception/models
RENDER = $(BIN)/python -m tactophone simulate dataset --seconds 6 --tip
EVERY  = --objects $(shell seq -s, 0 19),$(shell seq -s, 33 43) --gain -12
QUIET  = --takes long_medium,short_light,wiggle
HALL   = --takes long_loud,short_medium --hall
TEST   = --objects 23,24,25,26,27,28,29,30,31,32 $(QUIET)
TRAIN  = $(BIN)/python -m tactophone train --no-score
RECIPE = --recipe examples/recipes
SCORE  = $(BIN)/python -m tactophone evaluate
LMT    = $(wildcard $(TACTOPHONE_RECORDINGS)/lmt)
TIPS   = pad rubber plastic stylus
# Of the sets train, hall and test.
SEEDS-pad     = 21 24 31
SEEDS-stylus  = 22 25 32
SEEDS-rubber  = 26 27 33
SEEDS-plastic = 26 27 34
.PHONY: sets tips model-texture model-rubber model-plastic model-stylus model-paper model-paper-mono scores
model: model-texture model-rubber model-plastic model-stylus model-paper model-paper-mono tips scores

sets: $(TIPS:%=sets-%)
sets-%: $(READY)
	$(RENDER) $* $(EVERY) $(SETS)/$*-train $(QUIET) --seed $(word 1,$(SEEDS-$*))
	$(RENDER) $* $(EVERY) $(SETS)/$*-hall $(HALL) --seed $(word 2,$(SEEDS-$*))
	$(RENDER) $* $(TEST) $(SETS)/$*-test --seed $(word 3,$(SEEDS-$*))

model-texture: sets-pad
	$(TRAIN) $(SETS)/pad-train --also $(SETS)/pad-hall $(RECIPE)/texture.toml --out $(MODELS)/texture.onnx

model-rubber model-plastic: model-%: sets-%
	$(TRAIN) $(SETS)/$*-train --also $(SETS)/$*-hall $(RECIPE)/$*.toml --out $(MODELS)/$*.onnx

model-stylus: sets-stylus
	$(TRAIN) $(SETS)/stylus-train --also $(SETS)/stylus-hall $(addprefix --also ,$(LMT)) \
	  $(RECIPE)/stylus.toml --out $(MODELS)/stylus.onnx
	$(if $(LMT),$(BIN)/python benchmarks/no_touch.py stylus --fit $(SETS)/stylus-train $(SETS)/stylus-hall)

model-paper model-paper-mono: model-%: sets-pad
	$(TRAIN) $(SETS)/pad-train --also $(SETS)/pad-hall $(RECIPE)/$*.toml --out $(MODELS)/$*.onnx

# Writes the scores on held-out simulated objects into the models' cards.
scores: sets
	for model in texture paper paper-mono; do \
	  $(SCORE) $$model --data $(SETS)/pad-test --note "simulated, held out" || exit; \
	done
	for tip in rubber plastic stylus; do \
	  $(SCORE) $$tip --data $(SETS)/$$tip-test --note "simulated, held out" || exit; \
	done

# Fits by which sound a wrong tip is noticed, and scores that on objects and seeds that it was not fitted to.
OBJECTS-201 = $(shell seq -s, 0 3 18),34,37,40,43
OBJECTS-202 = $(shell seq -s, 1 3 19),35,38,41
OBJECTS-301 = $(shell seq -s, 23 32)
tips: sets
	$(foreach tip,$(TIPS),$(foreach seed,201 202 301,$(RENDER) $(tip) --seconds 5 --gain -12 $(QUIET) \
	  --objects $(OBJECTS-$(seed)) --seed $(seed) $(SETS)/$(tip)-$(seed) &&)) true
	$(BIN)/python benchmarks/tip_sounds.py $(foreach set,train 201 202,$(TIPS:%=$(SETS)/%-$(set))) --out $(MODELS)/tips.npz
	$(BIN)/python benchmarks/tip_sounds.py $(TIPS:%=$(SETS)/%-test) $(TIPS:%=$(SETS)/%-301)

# Tables I to III and the ablations, trained as the paper trains, as its authors' code does, and fast, on both simulated
# tasks. The six that take every window need about ten hours of a core for each task, the three fast ones a quarter of
# an hour. Every training is kept by hash and goes on after a stop. PAPER_DATA takes real recordings in the authors'
# layout (`tactophone fetch authors OUT`) in place of both simulated tasks, PAPER_PAGE another file for the page.
# `make paper PAPER_SECONDS=4 PAPER_RECIPES='examples/recipes/tables/fast-*.toml'` is a small one.
PAPER         = build/paper
PAPER_SECONDS = 30
PAPER_RECIPES = examples/recipes/tables/*.toml
PAPER_DATA    = $(PAPER)/box $(PAPER)/finals
PAPER_PAGE    = $(PAPER)/tables.md
SIMULATED     = $(filter $(PAPER)/box,$(PAPER_DATA))
comma := ,
empty :=
.PHONY: paper
paper: $(READY)  ## the paper's tables, in build/paper/tables.md
	mkdir -p $(PAPER)
	$(if $(SIMULATED),$(BIN)/python -m tactophone simulate dataset $(PAPER)/box --authors-layout --opus --seconds $(PAPER_SECONDS))
	$(if $(SIMULATED),$(BIN)/python -m tactophone simulate dataset $(PAPER)/finals --authors-layout --opus --levels derived --seconds $(PAPER_SECONDS))
	$(if $(SIMULATED),for task in box finals; do \
	  $(BIN)/python -m tactophone simulate competition $(PAPER)/$$task --authors-layout --opus --task $$task || exit; done)
	{ echo "# The paper's tables" && echo && \
	  echo "Made by \`make paper\` on $$(date -u +%F) at commit $$(git rev-parse --short HEAD), seed 0, $(PAPER_SECONDS) s a take." && \
	  $(BIN)/python benchmarks/paper_tables.py 1 2 $(PAPER_DATA:%=--data %) --cache $(PAPER)/cache --form markdown \
	    --methods $(subst $(empty) $(empty),$(comma),$(wildcard $(PAPER_RECIPES))),texture,rendered:texture,rendered:paper && \
	  $(BIN)/python benchmarks/paper_tables.py 3 ablations $(PAPER_DATA:%=--data %) --cache $(PAPER)/cache --form markdown; \
	} > $(PAPER)/tables.part && mv $(PAPER)/tables.part $(PAPER_PAGE)

.PHONY: paper-rows
paper-rows: $(READY)  ## each row of docs/reference/paper.md whose command takes under a minute
	$(BIN)/python scripts/run_paper_rows.py
