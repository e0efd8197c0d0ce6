# The two commands are `make experiments` and `make test`; the rest is theirs or for developers.

CARGO ?= cargo
PYTHON ?= python3
# Where cargo puts what it builds: CARGO_TARGET_DIR and its configuration may say so.
TARGET := $(shell $(CARGO) metadata --format-version 1 --no-deps --locked 2>/dev/null | sed -n 's/.*"target_directory":"\([^"]*\)".*/\1/p')
TARGET := $(if $(TARGET),$(TARGET),$(CURDIR)/target)
MCL_EVAL = "$(TARGET)/release/mcl-eval"
RESULTS ?= results
# The page that shows all of them.
REPORT ?= $(RESULTS)/report.html

.PHONY: build experiments beyond sensitivity datasets figures report page-test test fuzz interop cluster large-bag bench peers localizers reproduce check deny wheel sdist python-test features package semver dist fmt clippy doc

# Not where a program is given: make page-test MCL_EVAL=FILE.
build:
ifneq ($(origin MCL_EVAL),command line)
	$(CARGO) build --release --locked -p mcl-eval
endif

# The paper's experiments on those of their data sets that are at hand, and its claims beside what came
# out. An interrupted run goes on.
# Exit code 3 (records of a log were skipped, trials were lost) has been told and stops nothing.
experiments: build
	$(MCL_EVAL) run experiments/likelihood.toml -o $(RESULTS) || test $$? -eq 3
	$(MCL_EVAL) run experiments/localization.toml -o $(RESULTS) || test $$? -eq 3
	$(MCL_EVAL) claims $(RESULTS) -o $(RESULTS)/claims.md || test $$? -eq 3
	$(MCL_EVAL) report $(RESULTS) -o $(REPORT) || test $$? -eq 3

# What goes beyond the paper: better maps, sizes and σ that the data chooses, three dimensions, other kinds of
# maps (docs/refinement.md, three-dimensions.md, representations.md); robots that are looked for, carried off, among
# people, and how sure they are (docs/filter.md).
BEYOND = refinement localization-best choices choices-grid representations likelihood-3d refinement-3d tracking \
  global kidnapped people consistency
beyond: build
	for name in $(BEYOND); do \
	  $(MCL_EVAL) run experiments/$$name.toml -o $(RESULTS) || test $$? -eq 3 || exit 1; \
	done
	$(MCL_EVAL) report $(RESULTS) -o $(REPORT) || test $$? -eq 3

# What depends on the settings that the paper does not name: its statements (docs/reproduction.md), and the
# error, by which the defaults were chosen.
sensitivity: build
	$(MCL_EVAL) run experiments/localization-recorded.toml -o $(RESULTS) || test $$? -eq 3
	$(MCL_EVAL) run experiments/regions.toml -o $(RESULTS)
	$(MCL_EVAL) run experiments/sensitivity.toml -o $(RESULTS)

# Download and check the public logs.
datasets: build
	$(MCL_EVAL) datasets fetch
	$(MCL_EVAL) datasets verify

# Draw the figures again from saved rows.
figures: build
	$(MCL_EVAL) plot $(RESULTS)

# The page again, of what is there (docs/report.md).
report: build
	$(MCL_EVAL) report $(RESULTS) -o $(REPORT) || test $$? -eq 3

# The page in a real browser without network. Needs Node 18 or later, npm, and chromium.
PAGE_TEST = crates/mcl-eval/page-test
page-test: build
	cd $(PAGE_TEST) && npm ci --silent && MCL_EVAL=$(MCL_EVAL) npm test --silent

# Runs the experiments whose results are committed again, on the data sets at hand, and compares: every
# file byte by byte, or numbers within a TOLERANCE (results/README.md).
# REPRODUCE="likelihood choices" takes some of the experiments.
REPRODUCED = "$(TARGET)/reproduced"
REPRODUCE ?= likelihood localization localization-recorded regions $(BEYOND)
TOLERANCE ?= 0
reproduce: build
	for name in $(REPRODUCE); do \
	  $(MCL_EVAL) run experiments/$$name.toml -o $(REPRODUCED) || test $$? -eq 3 || exit 1; \
	done
	cd $(REPRODUCED) && for folder in */*/; do \
	  test -f "$(CURDIR)/results/$$folder/study.toml" || { echo "$$folder: no results are committed"; continue; }; \
	  echo "$$folder" && $(MCL_EVAL) compare "$$folder" "$(CURDIR)/results/$$folder" --tolerance $(TOLERANCE) || exit 1; \
	done

test:
	$(CARGO) test --workspace --locked

# libFuzzer on every reader, FUZZ_SECONDS each (crates/mcl-fuzz/README.md); `make test` runs the saved corpus
# and mutations of it on any toolchain. TARGETS="carmen cdr" runs some.
FUZZ_SECONDS ?= 60
FUZZ = crates/mcl-fuzz/fuzz
TARGETS ?= $(basename $(notdir $(wildcard $(FUZZ)/targets/*.rs)))
fuzz:
	@$(CARGO) +nightly --version >/dev/null 2>&1 || { echo "make fuzz needs a nightly toolchain: rustup toolchain install nightly" >&2; exit 1; }
	@$(CARGO) +nightly fuzz --version >/dev/null 2>&1 || { echo "make fuzz needs cargo-fuzz: cargo install --locked cargo-fuzz" >&2; exit 1; }
	for target in $(TARGETS); do \
	  mkdir -p $(FUZZ)/corpus/$$target && \
	  $(CARGO) +nightly fuzz run --fuzz-dir $(FUZZ) --sanitizer none $$target $(FUZZ)/corpus/$$target crates/mcl-fuzz/corpus/$$target -- \
	    -max_total_time=$(FUZZ_SECONDS) -max_len=16384 -timeout=5 -rss_limit_mb=3000 -malloc_limit_mb=2000 \
	    -dict=$(FUZZ)/dictionaries/$$target.dict -print_final_stats=1 || exit 1; \
	done

# Bags of ours read by programs we did not write, theirs by ours, and evo's figures beside ours.
# Needs Python 3.11 or later.
INTEROP = $(TARGET)/interop
interop: build
	$(PYTHON) -m venv $(INTEROP)
	$(INTEROP)/bin/pip install --quiet --disable-pip-version-check -r crates/mcl-datasets/interop/requirements.txt
	$(INTEROP)/bin/python crates/mcl-datasets/interop/interop.py --program $(MCL_EVAL)
	$(INTEROP)/bin/pip download --quiet --disable-pip-version-check --no-deps --no-binary evo -d $(INTEROP)/evo \
	  $$(grep '^evo==' crates/mcl-datasets/interop/requirements.txt)
	tar -xzf $(INTEROP)/evo/evo-*.tar.gz -C $(INTEROP)/evo --strip-components 1
	MCL_EVO_PYTHON=$(INTEROP)/bin/python MCL_EVO_DATA=$(INTEROP)/evo/test/data \
	  $(CARGO) test -p mcl-metrics --locked --test evo -- --ignored

# A Slurm cluster of two nodes on this machine: a study in parts, a node killed, merged, the same bytes. As root on
# Debian, whose packages of Slurm it installs.
cluster: build
	crates/mcl-eval/cluster/cluster.sh $(MCL_EVAL)

# The reading of a bag of 1 GB in one run with rosbags: LARGE="--images --size 4" makes others (large_bag.py --help).
# After `make interop`, whose Python it uses.
large-bag: build
	$(INTEROP)/bin/python crates/mcl-datasets/interop/large_bag.py --program $(MCL_EVAL) $(LARGE)

# The inner loops one by one, then how their time grows (fitted exponents).
bench:
	$(CARGO) bench --workspace --exclude mcl-eval --locked
	$(CARGO) bench -p mcl-eval --bench scaling --locked -- --csv $(abspath $(RESULTS))/benchmarks/scaling.csv

# The same work by this program and by others, in turns (benches/peers/README.md). They are downloaded
# into peers beside what cargo builds. Exit code 3 (a peer could not be had) has been told and stops nothing.
peers:
	$(PYTHON) benches/peers/run.py -o $(RESULTS)/benchmarks || test $$? -eq 3

# Localizers of others in a study beside the built-in filter (docs/localizers.md). AMCL and MRPT are downloaded into
# peers there, too; a localizer that cannot be had has rows that say so.
PEERS = $(TARGET)/peers
localizers: build
	$(PYTHON) benches/peers/run.py --install-localizers || test $$? -eq 3
	PATH="$(PEERS)/bin:$(PEERS)/venv/bin:$$PATH" $(MCL_EVAL) run experiments/localizers.toml -o $(RESULTS) || test $$? -eq 3

check: fmt clippy features doc test

# Each feature of the crate of logs alone, and none: what a build leaves out is named in the error.
features:
	for features in "" bags sqlite fetch; do \
	  $(CARGO) clippy --quiet -p mcl-datasets --no-default-features --features "$$features" --locked -- -D warnings || exit 1; \
	done
	$(CARGO) test --quiet -p mcl-datasets --no-default-features --test left_out --locked
	$(CARGO) clippy --quiet -p mcl-suite --no-default-features --locked -- -D warnings

# Every published crate from its own archive, outside of the repository. PACKAGES=FOLDER keeps what is built there.
package:
	CARGO="$(CARGO)" crates/package.sh $(PACKAGES)

# What an upgrade would break of the crates whose interface versions promise (crates/mcl-suite), against a revision: the
# last release by default. Needs cargo-semver-checks; asks no registry.
SEMVER = mcl-core mcl-datasets mcl-maps mcl-filter mcl-metrics mcl-suite
BASELINE ?= $(shell git describe --tags --abbrev=0 --match 'v*' 2>/dev/null)
semver:
	@$(CARGO) semver-checks --version >/dev/null 2>&1 || { echo "make semver needs cargo-semver-checks: cargo install --locked cargo-semver-checks" >&2; exit 1; }
	@test -n "$(BASELINE)" || { echo "there is no tag of a release to compare with: make semver BASELINE=REVISION" >&2; exit 1; }
	$(CARGO) semver-checks check-release $(addprefix -p ,$(SEMVER)) --baseline-rev "$(BASELINE)"

# The Python package (docs/python.md): command and module in one wheel for all Linux systems since 2014 (elsewhere for
# this one), and the source distribution. `make python-test` tries both in fresh environments outside of the repository;
# with PROFILE=dev PORTABLE= and CARGO_PROFILE_DEV_OPT_LEVEL=2 it takes what `make test` has built.
PROFILE ?= release
WHEELS = $(TARGET)/wheels
MATURIN = $(TARGET)/maturin
MATURIN_BUILD = cd crates/mcl-py && PATH="$(MATURIN)/bin:$$PATH" maturin
PORTABLE := $(if $(filter Linux,$(shell uname -s)),--zig --compatibility manylinux2014)

$(MATURIN)/ready: crates/mcl-py/requirements-build.txt
	$(PYTHON) -m venv $(MATURIN)
	$(MATURIN)/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

wheel: $(MATURIN)/ready
	rm -f $(WHEELS)/*.whl
	$(MATURIN_BUILD) build --profile $(PROFILE) --locked $(PORTABLE) --out $(WHEELS)

sdist: $(MATURIN)/ready
	rm -f $(WHEELS)/*.tar.gz
	$(MATURIN_BUILD) sdist --out $(WHEELS)

python-test: wheel sdist
	CARGO_TARGET_DIR="$(TARGET)" MATURIN_PEP517_ARGS="--profile $(PROFILE)" crates/mcl-py/test.sh $(PYTHON) $(WHEELS)

# A release, from a clean checkout: wheel, source distribution, crates, a program for any x86-64 Linux (static, by musl),
# the licences of what is linked, and checksums. Needs cargo-about, and rustup's target of musl.
DIST = $(TARGET)/dist
STATIC = x86_64-unknown-linux-musl
VERSION := $(shell sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml)
PROGRAM = mcl-eval-$(VERSION)-x86_64-linux
dist:
	@test -z "$$(git status --porcelain)" || { echo "make dist needs a clean checkout: a release is a revision" >&2; exit 1; }
	@$(CARGO) about --version >/dev/null 2>&1 || { echo "make dist needs cargo-about: cargo install --locked cargo-about --features cli" >&2; exit 1; }
	$(MAKE) wheel sdist package
	rm -rf $(DIST) && mkdir -p $(DIST)/$(PROGRAM)
	PATH="$(MATURIN)/bin:$$PATH" $(CARGO) zigbuild --release --locked --target $(STATIC) -p mcl-eval
	$(CARGO) about generate --locked about.hbs >$(DIST)/licences-of-others.txt
	cp "$(TARGET)/$(STATIC)/release/mcl-eval" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE $(DIST)/licences-of-others.txt $(DIST)/$(PROGRAM)
	tar -C $(DIST) --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$$(git log -1 --format=%ct)" -czf $(DIST)/$(PROGRAM).tar.gz $(PROGRAM)
	rm -r $(DIST)/$(PROGRAM)
	cp $(WHEELS)/*-$(VERSION)-*.whl $(WHEELS)/*-$(VERSION).tar.gz "$(TARGET)"/package/*-$(VERSION).crate $(DIST)
	cd $(DIST) && sha256sum * >SHA256SUMS && cat SHA256SUMS

# Licences, sources and duplicates of the dependencies; needs cargo-deny.
deny:
	$(CARGO) deny --log-level error check bans licenses sources

fmt:
	$(CARGO) fmt --all --check

clippy:
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings

doc:
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked
