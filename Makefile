# make campaign: install into .venv and run the default campaign. make test: install and test;
# make quick: less of it, in a minute.

PYTHON ?= python3
VENV ?= .venv
CORES ?= 2
BIN = $(VENV)/bin
SITE = NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
TOGETHER = -n $(CORES) --dist loadfile --no-loadscope-reorder

# Snakemake, the kernels and the plots keep caches in the user's home. Without one that can be
# written they lie beside the environment.
HOMELESS := $(shell home="$${XDG_CACHE_HOME:-$${HOME:+$$HOME/.cache}}"; test -n "$$home" \
	&& mkdir -p "$$home" 2>/dev/null && test -w "$$home" || echo homeless)
ifneq ($(HOMELESS),)
export XDG_CACHE_HOME := $(CURDIR)/$(VENV)/cache
export XDG_CONFIG_HOME := $(XDG_CACHE_HOME)
endif

.PHONY: campaign test quick docs pages web bench schema data architecture reference survey clean

campaign: $(VENV)/installed
	$(BIN)/snakemake -j$(CORES) all

test: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt -l 100 --no-sort --check Snakefile workflow
	$(BIN)/mypy
	$(SITE) --quiet
	$(BIN)/python -m pytest -q $(TOGETHER)

quick: $(VENV)/installed-dev  # the tests that take less than a second each
	$(BIN)/python -m pytest -q $(TOGETHER) -m "not slow and not service and not browser"

docs: $(VENV)/installed-dev  # the pages as a site, in build/site
	$(SITE)

pages: $(VENV)/installed-dev  # outputs and figures of the packaged data in docs/
	$(BIN)/python -m tests.pages

web: $(VENV)/installed-web  # the page and the API that it asks, on localhost
	$(BIN)/python -m dldsim serve both

bench: $(VENV)/installed
	$(BIN)/python -m benchmarks

schema: $(VENV)/installed
	$(BIN)/python -m dldsim.config.schema workflow/schemas/config.schema.json

survey: $(VENV)/installed  # results/survey becomes what every campaign can learn from
	$(BIN)/python -m dldsim.analysis.learning results/survey

data: $(VENV)/installed  # results/ becomes the campaign that comes with the package
	$(BIN)/python -m dldsim.design.finished_campaign results

architecture: $(VENV)/installed  # the picture of docs/architecture.md
	$(BIN)/python -m tests.architecture

reference: $(VENV)/installed  # results/reference becomes what the package is judged by
	$(BIN)/python -m dldsim.evidence.reference_study results

clean:
	rm -rf $(VENV)

$(VENV)/installed: requirements.txt pyproject.toml
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed"'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -r requirements.txt -e .
	touch $@

$(VENV)/installed-web: $(VENV)/installed requirements-web.txt
	$(BIN)/python -m pip install --quiet -r requirements-web.txt
	touch $@

$(VENV)/installed-dev: $(VENV)/installed requirements-dev.txt requirements-docs.txt \
		requirements-web.txt
	$(BIN)/python -m pip install --quiet -r requirements-dev.txt
	touch $@
