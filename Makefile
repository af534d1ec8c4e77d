# make demo: everything installed, the paper's workspace and line by every method of ours, and the report.   make test, make lint: what CI runs.
PYTHON ?= python3
VENV   ?= .venv
OUT    ?= optik-demo
BIN    := $(VENV)/bin
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
# Environments of the peers that clash with ours; Drake's is left to `optik bench peer drake --install`, its tests are skipped.
export OPTIK_PEERS ?= $(abspath $(VENV))/peers
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: demo test lint docs pictures tables results soak soak-part newest on-newest mutants kernels wheel clean

demo: $(VENV)/.core
	$(BIN)/optik demo --out $(OUT)

test: $(VENV)/.dev
	$(BIN)/optik kernels --compile
	$(BIN)/python -m pytest --ignore=tests/lint -n auto --dist loadfile --durations=40

soak: $(VENV)/.dev
	$(BIN)/python -m pytest -m 'soak or hypothesis' -n auto
	$(MAKE) newest

# A twelfth of it, the next one with each commit; without the whole history one that the sources choose.
COMMITS = $(shell test "$$(git rev-parse --is-shallow-repository 2>/dev/null)" = false && git rev-list --count HEAD \
  || find benchmarks optik planners tests -name '*.py' | sort | xargs cat | cksum | cut -d' ' -f1)
soak-part: $(VENV)/.dev
	$(BIN)/python -m pytest -m 'soak or hypothesis' -n auto --durations=10 --part $(COMMITS)/12

# The tests on the newest Python of this machine (3.12 to 3.14); an extra that pip cannot install there is skipped by name.
NEWEST = $(shell for v in 14 13 12; do \
  $(BIN)/python -c "import sys; sys.exit(sys.version_info >= (3, $$v))" && python3.$$v -c '' 2>/dev/null && echo python3.$$v && break; done)
newest: $(VENV)/.dev
	@$(if $(NEWEST),$(MAKE) on-newest NEWEST=$(NEWEST),echo "skipped: no Python here that is newer than the one in $(VENV)")

on-newest:
	$(NEWEST) -m venv .venv-newest
	for extra in tests closed-form shapes sim robots ros2 peers; do \
	  .venv-newest/bin/python -m pip install --quiet --only-binary=:all: -e ".[$$extra]" || echo "skipped: pip cannot install $$extra for $(NEWEST)"; \
	done
	.venv-newest/bin/python -m pytest -n auto --dist loadfile --durations=40

# Changes one point of the code at a time: some test must notice. Goes on where it was stopped; results in .mutants.jsonl.
mutants: $(VENV)/.dev
	$(BIN)/python -m tests.mutants

# The documentation site, in docs/_build: a page for each file in docs/, and the API from the docstrings.
docs: $(VENV)/.compiled
	rm -rf docs/_build
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build/html
	$(BIN)/python -m tests.site docs/_build/html

# Before a page runs, after each change of a source file.
$(VENV)/.compiled: $(VENV)/.docs $(shell find optik planners benchmarks -name '*.py')
	$(BIN)/optik kernels --compile
	@touch $@

# The pictures of the site and of the README, in docs/pictures, which are committed; Chromium draws them.
pictures: $(VENV)/.dev
	$(BIN)/python -m docs.pictures

# Compiled for every processor of this kind, collected anew from the usual calls and the documentation; a checkout uses them, too.
kernels: $(VENV)/.dev
	$(BIN)/python -P -m benchmarks.kernels.build

# In dist/, for this platform and Python, with the kernels; without them it would be pure.
wheel: kernels
	@rm -f dist/*.whl
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# The tables of docs/suites.md, from the settings that they show; a test compares them.
tables: $(VENV)/.core
	$(BIN)/python -m docs.suite_keys

# Measures every part of benchmarks/results that is not finished, about two hours in all, and writes its page and README's table.
results: $(VENV)/.dev
	$(BIN)/python -m docs.results

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -q tests/lint

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "optik needs Python 3.11 or newer; name one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "Python's venv module is missing; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	@echo "creating an environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.core: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing optik and what it needs into $(VENV)"
	$(BIN)/python -m pip install --progress-bar off -e '.[bench,closed-form]'
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing optik, the tools of its developers and the peers into $(VENV)"
	$(BIN)/python -m pip install --progress-bar off -e '.[dev]'
	$(BIN)/optik bench peer optik_py --install
	$(BIN)/optik bench peer placo --install
	@touch $@ $(VENV)/.core

$(VENV)/.docs: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing optik and what the documentation needs into $(VENV)"
	$(BIN)/python -m pip install --progress-bar off -e '.[docs]'
	@touch $@ $(VENV)/.core

clean:
	rm -rf $(VENV) .venv-newest $(OUT) dist optik/compiled/_kernels docs/_build docs/generated .mypy_cache .ruff_cache .pytest_cache .hypothesis
