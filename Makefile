# `make demo` and `make test` do all set-up themselves, in .venv, with the versions in constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
CORES ?= auto
# A package index with PyTorch's CPU build, for machines whose own index has the CUDA build only.
TORCH_INDEX ?=
# Without --no-compile 400 MB of byte code are written for packages of which few modules are ever used.
PIP := -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt
# What builds the package, with a C compiler for a machine that has none.
BUILD := editables hatchling hatch-fancy-pypi-readme numba numpy pydantic pymavlink scipy setuptools $(shell command -v cc >/dev/null && command -v c++ >/dev/null || echo ziglang)
EXTRAS := arrow,fleet,mcp,serial,serve,sim,viewer,zstd
# Only Linux has CUDA builds; there the CPU build has a version of its own.
TORCH := $(shell grep ^torch== constraints.txt)$(if $(filter Linux,$(shell uname -s)),+cpu)

# Tests start hundreds of programs, and where byte code is not kept, each of them compiles its modules again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-slow test-all test-lowest lock lint model docs pictures clean

demo: .venv/.demo
	$(BIN)/python examples/demo.py demo

# What a change needs before it is proposed, in minutes; on as many cores as there are.
test: .venv/.ready
	$(BIN)/python -m pytest -q -n $(CORES) --dist worksteal -m "not slow"

# The long tests and those of real logs (MAVHUMS_REAL_LOGS): hostile links, stalled readers, training, sweeps.
test-slow: .venv/.ready
	$(BIN)/python -m pytest -q -n $(CORES) --dist worksteal -m slow tests

# Everything, with coverage of both parts together.
test-all: .venv/.ready
	$(BIN)/coverage erase
	PYTEST_ADDOPTS="--cov --cov-append --cov-report=" $(MAKE) test test-slow
	$(BIN)/coverage report --fail-under=95

# The site is part of it: its strict build finds dead links and fields without a description.
lint: .venv/.lint docs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# The models that ship with the package, one for each telemetry.
model: .venv/.ready
	for tier in instrumented without-load esc; do \
		$(BIN)/mavhums train --airframe paper --tier $$tier -o mavhums/learn/models/paper-$$tier.safetensors || exit 1; \
	done

# The documentation as a site, to be read without a network: open site/index.html.
docs: .venv/.lint
	$(BIN)/python docs/hooks.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The pictures of recordings in README and docs; needs the Debian packages mesa-vulkan-drivers and
# ca-certificates, and for the real log's its folder in MAVHUMS_REAL_LOGS.
pictures: .venv/.ready demo
	PYTHONPATH=. $(BIN)/python examples/pictures.py demo docs/recordings
	$(BIN)/python examples/sample_classes.py docs/sample-classes.png

clean:
	rm -rf .venv .venv-lowest demo build dist site .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis

.venv/.demo: pyproject.toml constraints.txt
	@echo "Setting up .venv: downloads 250 MB once, 1.2 GB on disk."
	$(PYTHON) -m venv .venv
	$(BIN)/python $(PIP) $(BUILD)
	$(BIN)/python $(PIP) --no-build-isolation -e '.[viewer]'
	touch $@

.venv/.ready: pyproject.toml constraints.txt
	@echo "Setting up .venv for the tests: downloads 700 MB once (200 MB of it PyTorch's CPU build), 2.5 GB on disk."
	$(BIN)/python -c "" 2>/dev/null || $(PYTHON) -m venv .venv
	$(BIN)/python $(PIP) $(BUILD)
	$(BIN)/python $(PIP) --no-build-isolation -e '.[$(EXTRAS),dev]'
	@$(BIN)/python $(PIP) $(TORCH) $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) || \
		echo "PyTorch's CPU build ($(TORCH)) is not on your package index: the tests of training are left out." \
			"To run them: rm .venv/.ready; make test TORCH_INDEX=URL, with the CPU index that pytorch.org names."
	touch $@ .venv/.demo

.venv/.lint: .venv/.ready
	$(BIN)/python $(PIP) --no-build-isolation -e '.[lint]'
	touch $@

# The tests in an environment with the lowest versions that pyproject.toml allows.
test-lowest: .venv-lowest/.ready
	.venv-lowest/bin/python -m pytest -q -n $(CORES) --dist worksteal -m "not slow"

.venv-lowest/.ready: pyproject.toml
	$(PYTHON) -m venv .venv-lowest
	$(PYTHON) .ci/versions.py lowest > .venv-lowest/lowest.txt
	.venv-lowest/bin/python $(PIP:constraints.txt=.venv-lowest/lowest.txt) -e '.[$(EXTRAS),dev]'
	.venv-lowest/bin/python $(PIP:constraints.txt=.venv-lowest/lowest.txt) \
		$(TORCH) $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) || true
	touch $@

# Renew the versions in constraints.txt. Run it with the oldest Python that pyproject.toml allows, so that
# every version has a build for all of them.
lock:
	$(PYTHON) .ci/versions.py lock > constraints.new
	mv constraints.new constraints.txt
