# `make demo` and `make test` do all set-up themselves, in .venv.
PYTHON ?= python3
BIN := .venv/bin
CORES ?= auto
INSTALL := -m pip install --quiet --disable-pip-version-check -c constraints.txt -e

.PHONY: demo test test-all lint model docs pictures clean

demo: .venv/.demo
	$(BIN)/python examples/demo.py demo

# What a change needs before it is proposed, in minutes; on as many cores as there are.
test: .venv/.ready
	$(BIN)/python -m pytest -q -n $(CORES) --dist worksteal -m "not slow"

# Everything, with coverage: the long tests, too (hostile links, stalled readers, training, sweeps).
test-all: .venv/.ready
	$(BIN)/coverage erase
	$(BIN)/python -m pytest -q -n $(CORES) --dist worksteal --cov --cov-report=
	$(BIN)/coverage report --fail-under=95

lint: .venv/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The models that ship with the package, one for each telemetry.
model: .venv/.ready
	for tier in instrumented without-load esc; do \
		$(BIN)/mavhums train --airframe paper --tier $$tier -o mavhums/learn/models/paper-$$tier.safetensors || exit 1; \
	done

# The parts of the reference pages that come from the code.
docs: .venv/.ready
	$(BIN)/python -m docs.generate

# The pictures of recordings in README and docs; needs the Debian packages mesa-vulkan-drivers and
# ca-certificates, and for the real log's its folder in MAVHUMS_REAL_LOGS.
pictures: .venv/.ready demo
	PYTHONPATH=. $(BIN)/python examples/pictures.py demo docs/recordings

clean:
	rm -rf .venv demo build dist .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis

.venv/.demo: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python $(INSTALL) '.[viewer]'
	touch $@

.venv/.ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python $(INSTALL) '.[all,dev]'
	touch $@ .venv/.demo
