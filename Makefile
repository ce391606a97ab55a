# make campaign: install into .venv and run the default campaign. make test: install and test.

PYTHON ?= python3
VENV ?= .venv
CORES ?= 2
BIN = $(VENV)/bin

.PHONY: campaign test schema data clean

campaign: $(VENV)/installed
	$(BIN)/snakemake -j$(CORES) all

test: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/python -m pytest -q

schema: $(VENV)/installed
	$(BIN)/python -m dldsim.config workflow/schemas/config.schema.json

data: $(VENV)/installed  # results/ becomes the campaign that comes with the package
	$(BIN)/python -m dldsim.design_jobs results

clean:
	rm -rf $(VENV)

$(VENV)/installed: requirements.txt pyproject.toml
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed"'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -r requirements.txt -e .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed requirements-dev.txt
	$(BIN)/python -m pip install --quiet -r requirements-dev.txt
	touch $@
