# Two commands on a fresh machine: make demo, make test. Both set up .venv from pinned versions.
PYTHON ?= python3
VENV   ?= .venv
BIN     = $(VENV)/bin
PIP     = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

WORKERS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN); test $$n -gt 3 && echo 4 || expr $$n + 1)  # tests also wait

.PHONY: demo test proofs lint bench bundled docs clean
demo: $(VENV)/.run
	$(BIN)/pliant demo -o results/demo

TESTS = $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --tell-skips
test: $(VENV)/.dev
	$(TESTS) $(if $(SLOW),,-m "not slow")

proofs: $(VENV)/.dev  # the slow tests alone; UNTIL=TIME, s since 1970: none starts later
	$(TESTS) -m slow $(if $(UNTIL),--slow-until $(UNTIL))

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell

bench: $(VENV)/.bench
	$(BIN)/python benchmarks/run.py

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -b html -W --keep-going docs docs/_build/html

bundled: $(VENV)/.dev  # the recordings and the film of the virtual actuator that come with the package
	$(BIN)/python -m pliant.testbed.bundle
	$(BIN)/python -m pliant.testbed.camera.bundle

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "pliant needs Python >= 3.11; run: make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) -e . && touch $@
$(VENV)/.dev: $(BIN)/python pyproject.toml constraints.txt
	$(PIP) -e '.[dev,mpc,zmq,scale,browser,export,jax,gym,view,camera,tdms,ros,lerobot]' && touch $@ $(VENV)/.run
$(VENV)/.docs: $(VENV)/.run
	$(PIP) -e '.[docs]' && touch $@
$(VENV)/.bench: $(VENV)/.dev
	$(PIP) -e '.[bench]' && touch $@

clean:
	rm -rf $(VENV) results docs/_build .pytest_cache .mypy_cache .ruff_cache
