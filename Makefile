# The kit's commands; `make` alone lists them. Without make: the pip commands in README.md.

# .venv holds the versions of constraints.txt, .venv-oldest the floors of pyproject.toml.
VENV := .venv$(if $(oldest),-oldest)
BIN := $(VENV)/bin

# PYTHON is the interpreter to make the environment with: python3, or the one used last time.
ifeq ($(origin PYTHON),undefined)
PYTHON := $(or $(shell sed -n 2p $(VENV)/.ready 2>/dev/null),python3)
endif
PYTEST := -m pytest -n logical --maxprocesses 8 --dist loadfile $(ARGS)
CHROMIUM ?= $(shell command -v chromium || command -v chromium-browser || command -v google-chrome)

# Its version is pinned: it need not ask the network for a newer one.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

.PHONY: help lab test test-oldest browser-test study bench clean
help:
	@echo 'make lab            open JupyterLab on the start page   (ARGS="--no-browser --port=8899" is passed on)'
	@echo 'make test           check style, run the unit tests and every notebook      (ARGS="-k surface" likewise)'
	@echo 'make test-oldest    run the unit tests and every notebook at the oldest supported versions'
	@echo 'make browser-test   drive the notebooks in a real browser (needs Chromium)'
	@echo 'make study          run what the tests leave out: all laws, presets and seeded designs'
	@echo 'make bench          measure the simulation against C'
	@echo 'make clean          remove the environments and everything else that these commands made'
	@echo
	@echo 'Each sets up .venv (.venv-oldest) if need be; PYTHON=python3.12 names the Python for it.'

lab: $(VENV)/.ready
	@echo 'Starting JupyterLab (Ctrl-C ends it) ...'
	@exec $(BIN)/jupyter-lab --notebook-dir=. --LabApp.default_url=/lab/tree/notebooks/00_start_here.ipynb \
	    $(if $(filter 0,$(shell id -u)),--allow-root) $(ARGS)

test: $(VENV)/.ready
	@echo 'Checking style, types, imports between modules, and that notebooks are stored without outputs ...'
	@$(BIN)/ruff check --quiet || { echo 'Style: ruff found the above ("$(BIN)/ruff check --fix" mends most of it).'; exit 1; }
	@said=$$($(BIN)/python -m pyright --pythonpath $(BIN)/python 2>&1) || { echo "$$said"; \
	    echo 'Types: pyright found the above (its settings are in pyproject.toml).'; exit 1; }
	@said=$$($(BIN)/lint-imports --no-logo 2>&1) || { echo "$$said"; \
	    echo 'Imports: a module imports what it must not, see above (the contracts are in pyproject.toml).'; exit 1; }
	@find notebooks -name '*.ipynb' ! -path '*/.*' -exec $(BIN)/nbstripout --keep-id --verify {} + || { \
	    echo 'Notebooks: those named above hold outputs ("$(BIN)/nbstripout --keep-id FILE" removes them).'; exit 1; }
	@echo 'Running the unit tests and every notebook ...'
	@$(BIN)/python $(PYTEST)

test-oldest:
	@$(MAKE) -s oldest=yes .venv-oldest/.ready
	@echo 'Running the unit tests and every notebook at the oldest supported versions ...'
	@.venv-oldest/bin/python $(PYTEST)

browser-test: $(VENV)/.ready
	@$(if $(CHROMIUM),,$(error No Chromium was found: install it (Debian: sudo apt install chromium), \
	    or name it with CHROMIUM=/path/to/chromium))
	@echo 'Driving JupyterLab in $(CHROMIUM) ...'
	@CHROMIUM='$(CHROMIUM)' $(BIN)/python -m pytest -m browser tests/browser -s $(ARGS)

study: $(VENV)/.ready
	@$(BIN)/python tests/designs.py $(ARGS)

bench: $(VENV)/.ready
	@echo 'Measuring; leave the machine alone for a minute ...'
	@$(BIN)/python tests/bench/bench.py $(ARGS)

clean:
	rm -rf .venv .venv-oldest dist build *.egg-info .coverage
	rm -rf .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
	find . -name .ipynb_checkpoints -prune -exec rm -rf {} +

# An environment serves while its Python runs, it lies where it was made, and PYTHON names the
# Python it was made with; otherwise it is made anew. A changed list of packages updates it.
made := $(shell $(BIN)/python -V >/dev/null 2>&1 && cat $(VENV)/.ready 2>/dev/null)
ifneq ($(made),$(CURDIR) $(PYTHON))
anew := yes
.PHONY: $(VENV)/.ready
endif
says = $(shell '$(PYTHON)' -c 'import sys; print($1 or "")' 2>/dev/null)
version = $(call says,"%d.%d" % sys.version_info[:2])

$(VENV)/.ready: pyproject.toml $(if $(oldest),tests/floors.py,constraints.txt)
ifdef anew
	@$(if $(version),,$(error $(PYTHON) does not run: install Python 3.11 or newer \
	    (Debian: sudo apt install python3 python3-venv), or name one with PYTHON=/path/to/python3))
	@$(if $(call says,sys.version_info >= (3, 11)),,$(error $(PYTHON) is Python $(version), but the kit needs \
	    3.11 or newer: name such a Python with PYTHON=/path/to/python3))
	@$(if $(call says,__import__("venv") and __import__("ensurepip")),,$(error $(PYTHON) lacks the venv module: \
	    install it (Debian: sudo apt install python$(version)-venv) and run this again))
	@echo 'Setting up $(VENV) with Python $(version) (once, takes a few minutes) ...'
	@rm -rf $(VENV)
	@'$(PYTHON)' -m venv $(VENV)
else
	@echo 'Updating $(VENV) ...'
	@rm -f $@
endif
ifdef oldest
	@$(BIN)/python tests/floors.py >$(VENV)/floors.txt
endif
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	    -c $(if $(oldest),$(VENV)/floors.txt,constraints.txt) -e '.[lab,test]' || { \
	    echo 'The packages could not be installed (pip says why above): run the same command again once that is mended.'; \
	    exit 1; }
	@printf '%s\n' "$$(pwd -P)" '$(PYTHON)' >$@
