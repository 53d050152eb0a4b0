# SPDX-License-Identifier: Apache-2.0
# Commands for a bare Debian 12 or 13. Each installs the packages it needs, then builds.
#   make           builds the program with its page for browsers, build/release/bin/stgs
#   make web       builds the player for browsers, build/release/web/stgs
#   make demo      builds the program and encodes, checks and renders the sample capture
#   make check     builds everything and runs the tests (half an hour on two cores)
#   make check-all the same, then the slow tests: sanitizers, builds without the encoder, Debian 13
# Everything else is plain CMake (README.md, CMakePresets.json).
JOBS ?= $(shell nproc)
# Many tests wait for a clock, a child or a server: two jobs more than cores.
CTEST = STGS_VALIDATED=1 ctest --output-on-failure --no-tests=error -j $$(($(JOBS) + 2))

.PHONY: program web demo check check-all check-slow setup clean

program:
	@tools/setup/setup.sh core program web
	@cmake --preset release $(shell tools/setup/cuda.sh)
	@cmake --build build/release -j $(JOBS) --target stgs

web:
	@tools/setup/setup.sh core program web
	@cmake --preset release $(shell tools/setup/cuda.sh)
	@cmake --build build/release -j $(JOBS) --target stgs_web

demo: program
	@tools/demo/demo.sh build/release/bin/stgs build/demo

# STGS_VALIDATED: the Vulkan tests fail without the validation layer, which setup installs.
check: setup
	@cmake --preset check
	@cmake --build build/check -j $(JOBS)
	@$(CTEST) --test-dir build/check -LE slow

check-all: check
	@tools/setup/setup.sh check-all
	@$(CTEST) --test-dir build/check -L slow
	@for preset in asan tsan decode-only no-encoder; do \
	  cmake --preset $$preset -DSTGS_BUILD_TESTS=ON -DSTGS_BUILD_EXAMPLES=ON && \
	  cmake --build build/$$preset -j $(JOBS) && \
	  ctest --preset $$preset -LE slow -j $(JOBS) || exit 1; \
	done
	@tools/setup/debian13.sh build/debian13

check-slow: check
	@$(CTEST) --test-dir build/check -L slow

setup:
	@tools/setup/setup.sh core program web check
	@tools/setup/npm.sh

clean:
	rm -rf build
