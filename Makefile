# Everything sets itself up: Python >= 3.11 with venv, make and a C++17 compiler are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO ?= levelhead-demo
SOURCES := pyproject.toml CMakeLists.txt $(shell find src -name '*.hpp' -o -name '*.cpp')

.PHONY: demo test lint bench drives soak clean

demo: $(VENV)/built
	$(BIN)/levelhead demo -o $(DEMO)

test: $(VENV)/tested
	$(BIN)/python -m pytest

lint: $(VENV)/tested
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(VENV)/built
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/filters.py
	$(BIN)/python benchmarks/navigation.py
	$(BIN)/python benchmarks/preflight.py
	$(BIN)/python benchmarks/speed.py

# What takes minutes: a thousand drives, and outside authorities.
soak: $(VENV)/tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[compare]'
	$(BIN)/python -m pytest -m slow

# Real drives are not part of the repository: make drives DATA=folder
drives: $(VENV)/built
	$(BIN)/python benchmarks/real_drives.py $(DATA)
	$(BIN)/python benchmarks/formats.py $(DATA)
	$(BIN)/python benchmarks/navigation.py --seeds 2 --data $(DATA)

$(VENV)/built: $(SOURCES)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/tested: $(VENV)/built
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,lint]'
	touch $@

clean:
	rm -rf $(VENV) build dist
