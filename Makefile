# make demo: set up and run the main job; make test: set up and run the tests. Everything goes into .venv.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
# One thread per process: the matrices here are small, and two processes with two threads each stand in each other's way.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test test-slow benchmarks campaign-cost design-study clean

demo: $(VENV)/installed
	$(BIN)/testbench run eolo_alpha

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m "not slow" -n 2 --dist worksteal

test-slow: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m slow

benchmarks: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/flight_overhead.py
	$(BIN)/python tests/benchmarks/design_speed.py
	$(BIN)/python tests/benchmarks/campaign_speed.py
	$(BIN)/python tests/benchmarks/env_speed.py

campaign-cost: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/campaign_cost.py

design-study: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/design_study.py

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q -c constraints.txt -e .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[campaign,envs,logs,parquet,teaching]" lupa mypy playwright pytest pytest-xdist ruff
	touch $@

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
