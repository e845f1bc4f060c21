# A fresh machine needs make and Python 3.11 or newer; everything else goes into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := sample_data/descent
# one process a core, whole files, as tests of a file share what takes long; tests/conftest.py gives the order
PARALLEL := -n logical --dist loadfile --no-loadscope-reorder --durations=15
# compiled tests are kept, whatever the environment says: to compile them takes each process seven seconds
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest $(PARALLEL)

.PHONY: help venv demo test test-all fuzz lint types bench sample-data docs site clean

help:
	@echo 'make demo         slopes and map of the sample pair, checked against their truth (into demo_output/)'
	@echo 'make test         what must hold for every commit: lint, types, tests (six minutes on two cores)'
	@echo 'make test-all     the same with all seeds, all kills and all data sets'
	@echo 'make fuzz         10 000 odd and damaged inputs (make fuzz N=100000 SEED=3)'
	@echo 'make lint         ruff: rules and format'
	@echo 'make types        mypy'
	@echo 'make bench        how fast, and how it compares (writes docs/benchmarks.md)'
	@echo 'make docs         write docs/cli.md, the examples of the documents and their pictures anew'
	@echo 'make site         the documentation as a site (into site/)'
	@echo 'make sample-data  render sample_data/ anew'
	@echo 'make venv         only install into .venv (PYTHON=python3.12 picks the interpreter)'

venv: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("slopemap needs Python 3.11 or newer, but $(PYTHON) is %d.%d; try make PYTHON=python3.12" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	$(BIN)/python -m compileall -q slopecli  # as an installed package is
	@touch $@

demo: venv
	$(BIN)/slopemap estimate $(DEMO)/image1.png $(DEMO)/image2.png --camera $(DEMO)/camera.json -o demo_output
	$(BIN)/python sample_data/check_demo.py demo_output/slopes.json $(DEMO)/truth.json
	$(BIN)/slopemap map $(DEMO)/image1.png $(DEMO)/image2.png --camera $(DEMO)/camera.json --baseline 2.175 -o demo_output/map
	$(BIN)/python sample_data/check_demo.py demo_output/map/slopes.json $(DEMO)/truth.json

test: lint types
	$(PYTEST)

test-all: lint types
	SLOPEMAP_TEST_ALL=1 $(PYTEST)

N ?= 10000
SEED ?= 0
fuzz: venv
	PYTHONPATH=tests $(BIN)/python -m fuzzing -n $(N) --seed $(SEED)

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: venv
	$(BIN)/mypy

bench: venv
	-$(BIN)/python -m pip install --quiet --editable '.[peers]'
	OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/compare.py --into docs/benchmarks.md

site: venv
	-$(BIN)/python -m pip install --quiet --editable '.[site]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

docs: venv
	$(BIN)/python docs/generate.py

sample-data: venv
	$(BIN)/python sample_data/make_sample_data.py
	$(BIN)/python sample_data/make_sample_data.py --output slopecli sample/descent sample/town

clean:
	rm -rf site demo_output fuzz_failures .pytest_cache .mypy_cache .ruff_cache .hypothesis
