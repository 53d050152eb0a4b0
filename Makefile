# SPDX-License-Identifier: Apache-2.0
# Two commands on a bare Debian 12: `make demo` shows what STGS does, `make check` proves that it
# works. Both install what is missing, then build. Everything else is plain CMake (see README.md).
PRESET ?= release
BUILD := build/$(PRESET)
JOBS ?= $(shell nproc)

.PHONY: demo check build setup clean

demo: build
	@tools/demo/demo.sh $(BUILD)/bin/stgs build/demo

# The validation layer is among what setup installs: without it the Vulkan tests say that they skip.
check: build
	@STGS_VALIDATED=1 ctest --test-dir $(BUILD) --output-on-failure --no-tests=error -j $(JOBS)

build: setup
	@cmake --preset $(PRESET)
	@cmake --build $(BUILD) -j $(JOBS)

setup:
	@tools/setup/setup.sh

clean:
	rm -rf build
