# SPDX-License-Identifier: Apache-2.0
# Two commands on a bare Debian 12: `make demo` shows what STGS does, `make check` proves that it
# works. Both install what is missing, then build. Everything else is plain CMake (see README.md).
PRESET ?= release
BUILD := build/$(PRESET)
JOBS ?= $(shell nproc)

.PHONY: demo check build setup clean

demo: build
	@tools/demo/demo.sh $(BUILD)/bin/stgs build/demo

check: build
	@ctest --test-dir $(BUILD) --output-on-failure --no-tests=error -j $(JOBS)

build: setup
	@cmake --preset $(PRESET)
	@cmake --build $(BUILD) -j $(JOBS)

setup:
	@tools/setup/setup.sh

clean:
	rm -rf build
