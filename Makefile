# make demo       co-design a gait on flat ground: speed, gait CSV and picture (sets everything up itself)
# make test       run the tests        make test-fast  run those that compile no kernel, in under a minute
# make test-device  run the drivers for GPUs on a Vulkan device (Debian's mesa-vulkan-drivers has one in software), or
#                   on that of DEVICE=cuda
# make test-browser  run the tests of pages in Chromium (Debian's chromium); SCREENSHOTS=folder keeps pictures of them
# make validate   run the slow validations, of minutes to hours
# make validate-quadrants  run all tests with Quadrants in place of Taichi, and compare their bits (sets up .venv-quadrants)
# make fuzz       give random bytes to the readers of files, and add to docs/data/fuzzing.csv what was tried;
#                 FUZZ="--seconds 600 vxa", FUZZ="--rounds 20 --seconds 60" or FUZZ="--runs 2000"
# make fuzz-physics  compute random robots in all ways, and gradients by differences; CASES=10000 GRADIENTS=500; resumes
# make coverage   run the tests and report which lines of Python, and of kernels, none of them runs or compiles
# make lint       ruff and mypy        make notebooks  run the notebooks in their short mode
# make site       build the documentation as a site that works without a network, in build/site
# make wheel      build dist/          make clean     remove what make has made, results excepted
# make same-bits  compare with version 1.0, bit for bit; SAME_BITS="--quick" or other options
# make bench-history  measure beside version 1.0, add the ratios to docs/data/bench-history.csv, draw them
#
# PYTHON=/path/to/python chooses the interpreter, TORCH_INDEX=https://download.pytorch.org/whl/cpu a further
# package index for torch (this one has small builds without CUDA), OUT=folder where the demo writes.

PYTHON ?= python3.11 python3.12 python3.13 python3
CASES ?= 1000
GRADIENTS ?= 50
DEMO ?= --geometry small --terrain flat --free orientation,shape,control --repeats 1 --climbers 16 --generations 4

venv := .venv
python := $(venv)/bin/python
install := $(python) -m pip install --quiet -c constraints.txt $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX))

# Libraries of linear algebra would start as many threads as there are cores in each of the processes. Images of
# containers often forbid Python to keep what it compiles: then each of the many processes would compile all modules.
test := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(python) -m pytest -q -p no:nbmake -n auto --maxprocesses 4 --dist loadfile

.PHONY: demo fuzz fuzz-physics test test-fast test-device test-browser coverage validate validate-quadrants notebooks same-bits bench-history lint site wheel clean

demo: $(venv)/runtime
	@n=1; while [ -e runs/demo-$$n ]; do n=$$((n + 1)); done; \
	set -x; exec $(venv)/bin/morpholab codesign $(DEMO) --out "$(or $(OUT),runs/demo-$$n)"

test: $(venv)/dev
	$(test)

test-fast: $(venv)/dev
	$(test) -m "not slow and not kernels and not long"

test-device: $(venv)/dev
	OMP_NUM_THREADS=1 MORPHOLAB_TEST_DEVICE=$(DEVICE) $(python) -m pytest -q -p no:nbmake -m device tests/taichi_sim/test_devices.py

test-browser: $(venv)/browser
	OMP_NUM_THREADS=1 MORPHOLAB_SCREENSHOTS="$(SCREENSHOTS)" $(python) -m pytest -q -p no:nbmake -m browser tests/browser

fuzz: $(venv)/fuzz
	PYTHONHASHSEED=0 nice -n 19 $(python) tests/fuzz/fuzz.py $(FUZZ)

fuzz-physics: $(venv)/dev
	OMP_NUM_THREADS=1 nice -n 19 $(python) tests/fuzz/fuzz_physics.py --cases $(CASES) --gradients $(GRADIENTS)

coverage: $(venv)/dev
	$(test) -p kernel_lines --cov --cov-branch --cov-report=
	$(test) -m "slow and not device and not browser" --cov --cov-branch --cov-append --cov-report=term-missing \
		tests/optim/studies tests/robots/test_bench.py

validate: $(venv)/dev
	$(python) -m pytest -q -m slow

validate-quadrants: $(venv)/dev
	$(MAKE) .venv-quadrants/quadrants venv=.venv-quadrants
	MORPHOLAB_COMPILER=quadrants $(MAKE) test venv=.venv-quadrants
	$(python) benchmarks/compilers.py --rounds 1

notebooks: $(venv)/dev
	MORPHOLAB_SHORT=1 $(python) -m pytest -q --nbmake --nbmake-timeout=900 notebooks

same-bits: $(venv)/dev
	$(python) benchmarks/same_bits $(SAME_BITS)

bench-history: $(venv)/dev
	$(python) benchmarks/history.py

lint: $(venv)/dev
	$(python) -m ruff check
	$(python) -m ruff format --check
	$(python) -m mypy

site: $(venv)/docs
	NO_MKDOCS_2_WARNING=1 $(python) -m mkdocs build --config-file docs/site/mkdocs.yml

wheel: $(venv)/dev
	$(python) -m build --no-isolation

clean:
	rm -rf $(venv) .venv-quadrants build dist *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache .same-bits

# Stamps: what is installed is up to date with the files on the right.
$(venv)/runtime: pyproject.toml constraints.txt | $(venv)/bin/pip
	$(install) -e .
	@touch $@

$(venv)/dev: pyproject.toml constraints.txt | $(venv)/bin/pip
	$(install) -e ".[dev]"
	@touch $@ $(venv)/runtime

$(venv)/docs: pyproject.toml constraints.txt | $(venv)/runtime
	$(install) -e ".[docs]"
	@touch $@

$(venv)/browser: $(venv)/dev
	$(install) -e ".[browser]"
	@touch $@

$(venv)/fuzz: $(venv)/dev
	$(install) -e ".[fuzz]"
	@touch $@

$(venv)/quadrants: $(venv)/dev
	$(install) -e ".[quadrants]"
	@touch $@

$(venv)/bin/pip:
	@for candidate in $(PYTHON); do \
	  if $$candidate -c 'import ensurepip, sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; \
	  then set -x; exec $$candidate -m venv --clear $(venv); fi; \
	done; \
	echo "morpholab needs Python 3.11, 3.12 or 3.13 with venv: none among '$(PYTHON)'; give one by PYTHON=" >&2; exit 1
