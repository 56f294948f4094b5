# make demo: set up and run the main job; make test: set up and run the tests. Everything goes into .venv.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
# One thread per process: the matrices here are small, and two processes with two threads each stand in each other's way.
export OPENBLAS_NUM_THREADS ?= 1
# Compiled modules are kept, whatever the image says: else every process of the suite compiles them again, 10 s each.
unexport PYTHONDONTWRITEBYTECODE

# One look at every part of the house that is quick to see; which tests these are is said here and nowhere else.
QUICK = tests/core tests/inputs tests/sensors tests/logs tests/flight/test_trim.py tests/flight/test_linearise.py \
  tests/contracts/test_input_contract.py tests/contracts/test_suite_contract.py tests/estimators/regression/test_regression_structure.py \
  tests/evaluation tests/information tests/page/test_draw.py tests/questions/importing \
  tests/questions/campaign/test_draws.py tests/questions/run/test_scenario.py tests/test_house_rules.py \
  tests/test_packaging.py

# Studies and benchmarks; each writes what results/README.md says. TESTBENCH_SMALLEST=FOLDER before make: its first unit of
# work alone, written to FOLDER. ARGS: what the script is told besides, such as make mutants ARGS="--count 60".
ARGS ?=
STUDIES = advice-study anybody-test autopilot-log-study believed-study benchmarks blind-test campaign-cost clearance-study coloured-errors-study corpus-study \
  course-study dataset-study design-study env-study estimator-study filter-error-study gap-in-batches global-study live-study log-input-study loop-study mutants new-users \
  pages-held promise-study public-faults reliability same-bytes sequential-study static-margin-study stock surroundings third-party

.PHONY: demo quick lint test test-slow fuzz docs clean reproduction $(STUDIES)

demo: $(VENV)/installed
	$(BIN)/testbench run eolo_alpha

quick: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m "not slow" -k "not test_lint" -n 2 --dist worksteal $(QUICK)

lint: $(VENV)/installed-dev
	$(BIN)/python -m ruff check .
	$(BIN)/python -m ruff format --check .
	$(BIN)/python -m mypy

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m "not slow" -n 2 --dist worksteal

# Damaged files of every format, 2000 of each: some twenty minutes on an idle machine.
FUZZ_SEEDS ?= 2000
fuzz: $(VENV)/installed-dev
	FUZZ_SEEDS=$(FUZZ_SEEDS) $(BIN)/python -m pytest tests/fuzz -n 2 --dist worksteal

# Small errors sown into the numerical rooms, into results/mutants.csv: hours on two cores; it goes on where it stopped.
mutants: $(VENV)/installed-dev
	$(BIN)/python tests/studies/mutants.py $(ARGS)

# The quick tests without extras, home, room or locale, and with other versions: results/surroundings.csv; some ten minutes.
surroundings: $(VENV)/installed-dev
	$(BIN)/python tests/studies/surroundings.py $(ARGS)

# Every command stopped, starved and misled, damaged files, crashes of JSBSim, very many runs: results/reliability.md, from a
# part on each core. It goes on where it stopped; one command alone: PYTHONPATH=.:tests python -m studies.reliability --command run
reliability: $(VENV)/installed-dev
	PYTHONPATH=.:tests $(BIN)/python -m studies.reliability

test-slow: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m slow

# Every page in results/, and small ones of kinds that are not there, in Chromium: axe-core's faults (light and dark),
# words, bytes, widths, keys; npm brings axe-core. Some three minutes.
pages-held: $(VENV)/installed-dev
	mkdir -p build && cd build && npm pack --silent axe-core@4 && tar xzf axe-core-4*.tgz package/axe.min.js
	rm -rf build/pages && PYTHONPATH=. $(BIN)/python tests/studies/made_pages.py build/pages
	PYTHONPATH=. $(BIN)/python tests/studies/pages_held.py results build/package/axe.min.js
	PYTHONPATH=. $(BIN)/python tests/studies/pages_held.py build/pages build/package/axe.min.js

benchmarks: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/flight_overhead.py
	$(BIN)/python tests/benchmarks/seam_cost.py
	$(BIN)/python tests/benchmarks/batch_speed.py
	$(BIN)/python tests/benchmarks/batch_cost.py
	$(BIN)/python tests/benchmarks/batch_cost.py memory
	$(BIN)/python tests/benchmarks/export_speed.py
	$(BIN)/python tests/benchmarks/design_speed.py
	$(BIN)/python tests/benchmarks/campaign_speed.py
	$(BIN)/python tests/benchmarks/dataset_speed.py
	$(BIN)/python tests/benchmarks/env_speed.py
	$(BIN)/python tests/benchmarks/subspace_speed.py
	$(BIN)/python tests/benchmarks/output_error_speed.py
	$(BIN)/python tests/benchmarks/gap_speed.py
	$(BIN)/python tests/benchmarks/log_speed.py
	$(BIN)/python tests/benchmarks/long_log.py

# Every model that comes with JSBSim, into results/aircraft/stock.csv: some two minutes on two cores.
stock: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/stock_aircraft.py

# Faults in flight that other people flew, from a folder of clones: make public-faults ARGS=FOLDER; some minutes.
public-faults: $(VENV)/installed-dev
	$(BIN)/python tests/studies/public_faults.py $(ARGS)

# Aircraft of other people, from a folder of repositories OWNER+NAME: make third-party ARGS=FOLDER; minutes each.
third-party: $(VENV)/installed-dev
	$(BIN)/python tests/studies/third_party.py $(ARGS)

campaign-cost: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/campaign_cost.py

design-study: $(VENV)/installed-dev
	$(BIN)/python tests/benchmarks/design_study.py
	$(BIN)/python tests/benchmarks/design_against_aeroid.py

# Writes results/estimators/global.csv: global models of simulated flights against the aircraft's tables; some 15 min.
global-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/global_study.py $(ARGS)

# Writes results/live/flights.csv; ten minutes of processor time. Interrupted: it goes on where it stopped.
live-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/live_study.py $(ARGS)

# Writes results/live/courses.csv; an hour of processor time for a hundred campaigns. Interrupted: it goes on where it stopped.
course-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/course_study.py $(ARGS)

# Writes results/design/promise.csv and robust.csv; about half an hour of processor time. Interrupted: it goes on where it stopped.
promise-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/promise_study.py
	$(BIN)/python tests/studies/robust_study.py

# Writes results/app/new_users.csv and replies.csv: three kinds of new user in Chromium, steps counted; some five minutes.
# ARGS="--pictures FOLDER": pictures of every view at four widths, light and dark.
new-users: $(VENV)/installed-dev
	$(BIN)/python tests/studies/new_users.py $(ARGS)

# Writes results/plan/loop.csv; some 4 min of processor time an aircraft. Interrupted: it goes on where it stopped.
loop-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/loop_study.py $(ARGS)

# Writes results/plan/clearance.csv; a quarter of an hour of processor time. Interrupted: it goes on where it stopped.
clearance-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/clearance_study.py $(ARGS)

# Writes results/design/sequential.csv; some 8 s of processor time a trial. Interrupted: it goes on where it stopped.
sequential-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/sequential_study.py

# Writes results/estimators/*.csv; about an hour of processor time. Interrupted: estimator_study.py --resume.
estimator-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/subspace_inputs.py
	$(BIN)/python tests/studies/f16_prediction.py
	$(BIN)/python tests/studies/estimator_study.py

# Writes results/estimators/advice.csv; 40 min of processor time. Interrupted: the same again.
advice-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/advice_study.py

# From simulated PX4 and ArduPilot logs to derivatives, 100 seeds: hours on one core; it goes on where it stopped.
autopilot-log-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/autopilot_logs.py

# Writes results/logs/inputs.csv: logs of many writers, and what import says of each; make log-input-study ARGS=FOLDER
# takes public logs, fetched into FOLDER. Half a minute.
log-input-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/log_inputs.py $(ARGS)

# Writes results/instruments/kinds.csv and results/estimators/believed.csv; a quarter of an hour.
believed-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/instruments_study.py --first 150000
	$(BIN)/python tests/studies/identify_study.py --first 300000

# Writes results/estimators/coloured_errors.csv: a minute of processor time.
coloured-errors-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/coloured_errors.py

# Writes results/estimators/filter_error_gusts.csv.
filter-error-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/filter_error_study.py $(ARGS)

# Writes results/aircraft/corpus.csv: derivatives from plans beside published ones, and the spreads they come to; a minute.
corpus-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/corpus_study.py

# Writes results/aircraft/static_margin.csv; some two minutes.
static-margin-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/static_margin.py --write

# Cases of the last blind draw again: in batches against JSBSim, and those left unexplained by the open set.
gap-in-batches: $(VENV)/installed-dev
	$(BIN)/python tests/studies/gap_in_batches.py $(ARGS)

# Do the packaged scenarios give the bytes that they gave at another commit? Hours; see the script's --help.
REVISION ?= HEAD~1
same-bytes: $(VENV)/installed-dev
	$(BIN)/python tests/studies/same_bytes.py $(REVISION) $(ARGS)

# Writes results/dataset/*.csv: methods scored on the packaged data sets; half an hour of processor time.
dataset-study: $(VENV)/installed-dev
	$(BIN)/python tests/studies/dataset_study.py

env-study: $(VENV)/installed-rl
	for task in eolo:6 taurus:2; do name=$${task%:*}; \
	  $(BIN)/python -m testbench.envs.train --task $$name --hold $${task#*:} || exit 1; \
	  $(BIN)/python -m testbench.envs.baselines --task $$name --agent results/envs/$${name}_agent.zip \
	    --out results/envs/$$name.csv || exit 1; done

# The papers' figures and tables beside ours, into results/reproduction: some three minutes on an idle machine.
reproduction: $(VENV)/installed
	$(BIN)/testbench reproduce all

# Hours on one core; it goes on where it stopped.
blind-test: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m studies.blind --workers 2

# Nine aircraft, most of them not the testbench's own, with noise, air and starts as in life: results/gap/anybody; hours.
anybody-test: $(VENV)/installed
	PYTHONPATH=tests $(BIN)/python -m studies.blind.anybody $(ARGS)

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q -c constraints.txt -e .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[campaign,envs,geometry,jax,logs,parquet,teaching]" axe-playwright-python fmpy hatchling lupa mypy playwright pytest pytest-xdist pyulog ruff
	touch $@

$(VENV)/installed-rl: $(VENV)/installed-dev
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[rl]"
	touch $@

docs: $(VENV)/installed-docs
	$(BIN)/python docs/generate.py
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
