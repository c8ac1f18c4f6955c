# Two commands: `make demo` and `make test`. Both set up .venv first; a second call is quick. `make test-all` adds
# the tests that take long.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO := runs/paper-physics

.PHONY: demo test test-all lint clean

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "mjsheaf needs Python 3.11 or later; set PYTHON=")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --no-deps dm-control
	touch $(STAMP)

demo: $(STAMP)
	$(BIN)/mjsheaf run paper --expect --out $(DEMO)
	@echo
	@test -e $(DEMO)/video.mp4 && echo "video   $(DEMO)/video.mp4" || echo "video   none: see the note above"
	@echo "plots   $(DEMO)/errors.png trajectories.png configurations.png"
	@echo "data    $(DEMO)/result.nc summary.json"

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Two workers, one BLAS thread each: the tests are written for two cores. A module stays on one worker, so that its
# fixtures are made once.
test: lint
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadscope -m "not slow"

# The long tests too: studies of hundreds of teams, fuzzing, kills.
test-all: lint
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadscope

clean:
	rm -rf $(VENV) runs dist build
