# Two commands on a fresh machine: `make book` and `make test`. Each sets up .venv by itself.
PYTHON ?= python3
BIN := .venv/bin
BUILD := _build
HTML := $(BUILD)/html
PDF := $(BUILD)/himap.pdf
PIP := $(BIN)/python -m pip install -q --disable-pip-version-check
NEWEST = $(PIP) -r requirements.txt
LOCKED = $(PIP) --require-hashes -r requirements.lock && $(PIP) --no-deps --no-build-isolation -e .
INPUTS := _config.yml _toc.yml CHANGELOG.md CITATION.cff $(shell find book -type f -not -path '*/__pycache__/*') $(wildcard notebooks/*.ipynb)

.PHONY: help setup book pdf refresh test clean distclean

help:
	@echo "make book   run the notebooks that are stale, then render the book to $(HTML)/index.html"
	@echo "make pdf    the same, and print it to $(PDF); needs Chromium"
	@echo "make test   run all tests, those of the notebooks' numbers included"
	@echo "make setup  only install into .venv (make setup PYTHON=python3.12 chooses the interpreter,"
	@echo "            make setup LOCK=1 the packages of requirements.lock)"
	@echo "make clean  remove the rendered book and caches; make distclean removes .venv as well"

setup: .venv/.installed

# A Debian machine may have pip but no ensurepip; pip can then fill the environment from outside.
.venv/.installed: requirements.txt requirements.lock pyproject.toml
	@$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('himap needs Python 3.11 or newer, \
	this is ' + sys.version.split()[0] + '. Name another: make PYTHON=python3.12')"
	@echo "Setting up .venv (a few minutes, once)"
	@$(PYTHON) -m venv .venv >/dev/null || { $(PYTHON) -m venv --clear --without-pip .venv \
	&& $(PYTHON) -m pip --python $(BIN)/python install -q pip; }
	@$(if $(LOCK),$(LOCKED),$(NEWEST))
	@touch $@

# The notebooks are looked at again after the stale ones ran, hence the second make.
book: refresh
	@$(MAKE) --no-print-directory $(HTML)/.complete
	@echo "The book: $(HTML)/index.html"

pdf: book
	@$(BIN)/python book/print_pdf.py $(HTML) $(PDF)
	@echo "The book on paper: $(PDF)"

refresh: .venv/.installed
	@$(BIN)/himap run --stale
	@$(BIN)/python book/readme_figure.py
	@$(BIN)/python book/metadata.py

# Sphinx forgets a warning once its page is cached, so a build always starts clean: a page that warned
# must warn until it is mended.
$(HTML)/.complete: .venv/.installed $(INPUTS)
	@rm -rf $(HTML) $(BUILD)/.doctrees
	@$(BIN)/jupyter-book build . --path-output . -W --keep-going
	@touch $@

# Two files at a time, each on one core: threads would only get into each other's way.
test: export DUCC0_NUM_THREADS = 1
test: export OMP_NUM_THREADS = 1
test: .venv/.installed
	@$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --nbval notebooks tests

clean:
	rm -rf $(BUILD) .pytest_cache .ruff_cache

distclean: clean
	rm -rf .venv himap.egg-info
