# Everything sets itself up: Python >= 3.11 with venv, make and a C++17 compiler are enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO ?= levelhead-demo
FUZZ_SECONDS ?= 60
SOURCES := pyproject.toml CMakeLists.txt $(shell find src -name '*.hpp' -o -name '*.cpp')

.PHONY: demo test lint bench drives soak fuzz clean

demo: $(VENV)/built
	$(BIN)/levelhead demo -o $(DEMO)

test: $(VENV)/tested
	$(BIN)/python -m pytest

lint: $(VENV)/tested
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(VENV)/tested
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/filters.py
	$(BIN)/python benchmarks/navigation.py
	$(BIN)/python benchmarks/preflight.py
	$(BIN)/python benchmarks/speed.py
	PYTHONPATH=tests $(BIN)/python benchmarks/reading.py

# What takes minutes: a thousand drives, and outside authorities.
soak: $(VENV)/tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[compare]'
	$(BIN)/python -m pytest -m slow

# Every format's sample cut at every byte and mutated ten thousand times, then atheris for FUZZ_SECONDS on each. Stopped,
# it goes on where it was.
fuzz: $(VENV)/tested
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[fuzz]'
	PYTHONPATH=tests $(BIN)/python -m hostile.table
	PYTHONPATH=tests $(BIN)/python -m hostile.guided --seconds $(FUZZ_SECONDS)

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
