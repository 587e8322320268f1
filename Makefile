# `make demo` and `make test` each work alone on a fresh clone with Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Where there is a C compiler, an install compiles these (see setup.py).
HOT := $(shell sed -n 's/^    "\(.*\.py\)",$$/\1/p' setup.py)

.PHONY: demo build test quick lowest prove accuracy check docs reference bench clean

demo: $(VENV)/.base
	$(BIN)/formnet run configs/paper/section5-delay.toml

build: $(VENV)/.base

STARTS_SOMETHING := processes or browser or namespaces

test: check docs quick lowest
	$(BIN)/pytest -n 2 -m 'long and not ($(STARTS_SOMETHING))'
	$(BIN)/pytest -m '$(STARTS_SOMETHING)'

# What needs no other process, browser or namespace, and does not compute for long: in a minute.
quick: $(VENV)/.test
	$(BIN)/pytest -n 2 -m 'not (long or $(STARTS_SOMETHING))'

# The same with the lowest versions that pyproject.toml admits, in an environment of its own.
lowest:
	.ci/lowest $(PYTHON)

# Long proofs, an hour or more, of what is committed; their results go into docs/proofs.
# Part of them: make prove PROVE="nemesis --seed 7 --schedules 100"
prove: $(VENV)/.test
	PYTHONPATH=tests:tests/helpers $(BIN)/python -m proofs.prove $(PROVE)

# The table of docs/arithmetic.md.
accuracy: $(VENV)/.test
	PYTHONPATH=tests $(BIN)/python -m arithmetic.accuracy 20000

check: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site is in site/index.html; it needs no server and no network.
docs: $(VENV)/.test
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: $(VENV)/.bench
	$(BIN)/python -m benchmarks

reference: $(VENV)/.base
	$(BIN)/formnet schema --out configs/scenario.schema.json
	$(BIN)/formnet schema --of verdict --out docs/verdict.schema.json
	$(BIN)/python -m formnet.lab.schemas.scenario_page docs/scenario.md
	$(BIN)/python -m formnet.lab.schemas.verdict_page docs/verdict.md

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "formnet needs Python >= 3.11; say which with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.base: pyproject.toml setup.py $(HOT) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[lab]'
	@touch $@

$(VENV)/.test: pyproject.toml setup.py $(HOT) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,docs]'
	@touch $(VENV)/.base $@

$(VENV)/.bench: pyproject.toml setup.py $(HOT) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[benchmark]'
	@touch $@ $(VENV)/.base

clean:
	rm -rf $(VENV) .venv-lowest *.egg-info build site *.so */*.so */*/*.so .mypy_cache .pytest_cache .ruff_cache .hypothesis
