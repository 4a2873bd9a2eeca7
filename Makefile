# One command a habit. `make demo` and `make test` set everything up by themselves.
#   PYTHON=...  a Python 3.13 (brings Blender 5.2 LTS) or 3.11 (Blender 4.5 LTS); found by itself if not given
#   VENV=...    where the environment goes (default .venv)
#   BLENDER=... a Blender program, for the tests that run inside one, for addon-dev and screenshots
#   BENCH_FLAGS=... CHART_FLAGS=... REAL_FLAGS=... options of scripts/benchmark.py; DATA=... a folder of real frames
#   PLATFORM=.. for which computers `make extension` builds: all, current, or names (see its --help)
VENV ?= .venv
PYTHON ?= $(shell scripts/dev/find_python.sh 3.13 3.11)
PLATFORM ?= all
RUN = $(VENV)/bin/python
# a file's tests in one process, in the order of the folders: few of those that take long come last; threads of numpy's
# BLAS would only busy-wait on the cores that test
PYTEST = OPENBLAS_NUM_THREADS=1 $(RUN) -m pytest --dist loadfile --no-loadscope-reorder

# each of the many processes that tests start would compile the package anew
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup demo extension dist addon-dev test test-all test-long test-outside lint bench chart bench-alignment evaluate real stability docs screenshots clean
.DEFAULT_GOAL := demo

# the environment: Blender as a module and the commands; again when pyproject.toml has changed
setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml
	@test -n "$(PYTHON)" || { echo "error: expected Python 3.13 (for Blender 5.2 LTS) or 3.11 (for Blender 4.5 LTS), found neither; install one, or name it: make PYTHON=/path/to/python" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; v = "%d.%d" % sys.version_info[:2]; v in ("3.11", "3.13") or sys.exit("error: expected Python 3.13 (for Blender 5.2 LTS) or 3.11 (for Blender 4.5 LTS), found " + v)'
	@echo "setting up $(VENV) with $$("$(PYTHON)" --version) (Blender as a module: about 400 MB)"
	@"$(PYTHON)" -m venv --clear $(VENV)
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable .
	@$(RUN) -c 'import bpy; print("Blender", bpy.app.version_string, "is ready; the commands are in $(VENV)/bin/oneframe")'
	@touch $@

# what tests and checks need
$(VENV)/.ready-to-test: $(VENV)/.ready
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[test,lint]"
	@touch $@

# the sample case and a small dataset of it, with a video
demo: setup
	@$(RUN) scripts/oneframe.py sample --out demo/case
	@$(RUN) scripts/render_dataset.py demo/case/case.toml --out demo/dataset --count 24 --video --video-frames 48
	@echo "look at demo/case/frame.png (the one frame), demo/dataset/contact_sheet.png and demo/dataset/video/trajectory.mp4"

# one zip a platform in dist/, validated by Blender, with its size
extension: setup
	@$(RUN) scripts/dev/build_extension.py --platform $(PLATFORM)

# wheel and source distribution in dist/; the wheel is built from the latter, so nothing stale gets into it
dist: $(VENV)/.ready-to-test
	@$(RUN) -m build --no-isolation --outdir dist .

# the real Blender with this checkout's add-on and the sample case; BLENDER_FLAGS=... for Blender itself
addon-dev: setup
	@$(RUN) scripts/dev/addon_dev.py --blender "$(BLENDER)" -- $(BLENDER_FLAGS)

# the tests, on all cores, without those that take long; PYTEST_FLAGS=... for pytest itself
test: $(VENV)/.ready-to-test
	$(PYTEST) --numprocesses auto -m "not long" $(PYTEST_FLAGS)

# all tests
test-all: test test-long

# those that take long, two at a time; in a Blender program and its window if BLENDER is set
test-long: $(VENV)/.ready-to-test
	$(PYTEST) --numprocesses 2 -m long --durations 50 $(PYTEST_FLAGS)

# tests/outside in full: hundreds of interruptions and changes; `make test-all` runs a sample
test-outside: $(VENV)/.ready-to-test
	$(RUN) -m pytest --long tests/outside $(PYTEST_FLAGS)

# format, rules, the contracts between the rooms, and types against the API of the environment's Blender
lint: $(VENV)/.ready-to-test
	$(RUN) -m ruff format --check .
	$(RUN) -m ruff check .
	$(VENV)/bin/lint-imports --no-logo
	$(RUN) -m mypy

# speed against PyVista, with start, in demo/bench
bench: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(RUN) scripts/benchmark.py speed --out demo/bench/render_speed.json $(BENCH_FLAGS)

# speed against accuracy, in demo/bench; CHART_FLAGS="--quick", "--bloster DIR" or "--case CASE.toml PHOTOGRAPHS.json"
chart: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(RUN) scripts/benchmark.py chart --out demo/bench/speed_accuracy.csv $(CHART_FLAGS)
	$(RUN) scripts/benchmark.py chart --light --out demo/bench/light_accuracy.csv

# accuracy of poses from landmarks, in demo/bench
bench-alignment: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[charts]"
	$(RUN) scripts/benchmark.py landmarks --trials 10000 --noise-px 2 --out demo/bench/landmark_accuracy.csv

# views against real photographs, beside the paper's method, in demo/evaluation, and in the light of the lens, in
# demo/light; the poses of further frames, in demo/registration: EVALUATE_FLAGS="--bloster FOLDER --quick"; and what
# views are worth to a network, in demo/training: TRAINING_FLAGS likewise
evaluate: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(RUN) scripts/benchmark.py evaluation --out demo/evaluation $(EVALUATE_FLAGS)
	$(RUN) scripts/benchmark.py evaluation --light --out demo/light $(EVALUATE_FLAGS)
	$(RUN) scripts/benchmark.py registration --out demo/registration $(EVALUATE_FLAGS)
	@if $(RUN) -c "import torch" 2>/dev/null; then $(RUN) scripts/benchmark.py training --out demo/training/training.csv --spoilt $(TRAINING_FLAGS); else echo "left out: training, which needs PyTorch (the extra train)"; fi

# on a real endoscopy, which DATA is the folder of, in demo/real; see docs/real-frames.md
real: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	$(RUN) scripts/benchmark.py real --data "$(DATA)" --out demo/real $(REAL_FLAGS)

# where methods fail, and what the software answers there, in demo/stability; STABILITY_FLAGS=--quick: minutes
stability: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[charts]"
	$(RUN) scripts/benchmark.py stability --out demo/stability $(STABILITY_FLAGS)

# the site in build/docs, from docs/ and the docstrings of what is public; every warning is an error
docs: setup
	@$(RUN) -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	$(RUN) -m sphinx --fail-on-warning --keep-going --quiet docs build/docs
	@echo "open build/docs/index.html"

# the pictures of docs/img anew, in a real Blender under Xvfb: make screenshots BLENDER=/path/to/blender
screenshots: $(VENV)/.ready-to-test
	ONEFRAME_SCREENSHOTS=docs/img BLENDER="$(BLENDER)" $(RUN) -m pytest tests/window/test_documentation_pictures.py

# removes everything that the other targets have made
clean:
	rm -rf $(VENV) demo build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
