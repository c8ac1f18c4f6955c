# Two commands: `make demo` and `make test`. Both set up .venv first; a second call is quick. `make test` runs the tests
# that are quick, `make test-ci` besides these a choice of slow ones, `make test-all` all of them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
TESTS := $(VENV)/.developed
LOOPS := compiled-mujoco compiled-fused compiled-ideal
DEMO := runs/paper-physics
DEVELOPED := .[dev,docs]

# Python compiles modules when it first loads them, so that installing need not. Where PYTHONDONTWRITEBYTECODE forbids
# that, as in many containers, every command would compile them anew, for 3 s.
install = $(BIN)/python tools/install.py '$(1)' $(if $(PYTHONDONTWRITEBYTECODE),&& { \
	$(BIN)/python -m compileall -q -j 0 $(VENV)/lib mjsheaf >/dev/null || true; })

.PHONY: demo bench test test-ci test-all lint compiled $(LOOPS) docs clean bundle check-bundle

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "mjsheaf needs Python 3.11 or later; set PYTHON=")'
	@echo "installing into $(VENV) (seconds, or a minute by pip)"
	@$(PYTHON) -m venv $(VENV)
	@$(call install,.)
	@touch $@

# What tests and the site need in addition: a browser's driver, a type checker, dask, Sphinx.
$(TESTS): $(STAMP)
	@echo "installing what tests and the site need into $(VENV) (seconds, or a minute by pip)"
	@$(call install,$(DEVELOPED))
	@touch $@

demo: $(STAMP)
	@echo "running the paper's 13 agents and 4 targets; the first run compiles loops, once"
	$(BIN)/mjsheaf run paper --expect --quality draft --out $(DEMO)
	@echo
	@echo "look    $(DEMO)/report.html in any browser"
	@test -e $(DEMO)/video.mp4 && echo "video   $(DEMO)/video.mp4" || echo "video   none: see the note above"
	@test ! -e $(DEMO)/video.mp4 || echo "        in full quality: $(BIN)/mjsheaf video $(DEMO) --quality good"
	@echo "plots   $(DEMO)/errors.png trajectories.png configurations.png   (for a paper: run --format pdf --no-title)"
	@echo "data    $(DEMO)/result.nc summary.json"

# Speed on this machine next to references; TOPICS names some of them and options: TOPICS='fused sheaf --full'.
bench: $(STAMP)
	@$(BIN)/python -m benchmarks $(TOPICS)

lint: $(TESTS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tools/budget.py

# Machine code of the loops that many tests run, by one process a loop: workers that need the same wait for one another.
$(LOOPS): compiled-%: $(STAMP)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.compiled $*
compiled: $(LOOPS)

# Two workers, one BLAS thread each: the tests are written for two cores. Modules of tests are kept as pytest has
# rewritten them, which takes a third of collecting.
PYTEST = PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal

test: $(STAMP)
	@$(MAKE) --no-print-directory -j 2 --output-sync compiled lint
	$(PYTEST) -m "not slow"

# What continuous integration runs, after lint and compiled.
test-ci: $(TESTS)
	$(PYTEST) -m "not long"

# Besides the long ones, hypothesis tries five times as many examples, and the long studies every random case, from a
# seed: SEED=7 repeats those of the run that printed 7.
SEED ?= $(shell od -An -N2 -tu2 /dev/urandom | tr -d ' ')
test-all: lint compiled
	$(eval SEED := $(SEED))
	@echo "random cases: SEED=$(SEED)"
	MJSHEAF_SEED=$(SEED) $(PYTEST) --hypothesis-profile all --hypothesis-seed $(SEED)

# The site, in build/docs; examples, vehicles and references are made from what runs. Needs no network once installed.
# REPLAYS names the scenarios whose pages have a replay, and EXAMPLES is a pattern of the examples that run, where not
# all.
docs: $(TESTS)
	$(BIN)/python -m sphinx -W --keep-going -b html docs build/docs
	@echo "site    build/docs/index.html"

# The page's script and style, from web/: only who changes those needs node 18 or later. CI compares.
web/node_modules: web/package-lock.json
	cd web && npm ci --ignore-scripts --no-audit --no-fund
	touch web/node_modules

bundle: web/node_modules
	cd web && node build.mjs

check-bundle: web/node_modules
	cd web && node build.mjs ../build/bundle
	cmp build/bundle/bundle.js mjsheaf/page/bundle.js
	cmp build/bundle/bundle.css mjsheaf/page/bundle.css

clean:
	rm -rf $(VENV) runs dist build web/node_modules docs/generated docs/examples docs/sg_execution_times.rst
