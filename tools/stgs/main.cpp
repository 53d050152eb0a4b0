// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <exception>
#include <new>

#include "program.h"
#include "stgs/format/status.h"

int main(int argc, char** argv) {
  try {
    return stgs::tools::run_program(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fputs("stgs: error: not enough memory\n", stderr);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "stgs: error: %s\n", error.what());
  }
  return static_cast<int>(stgs::StatusCode::kRuntime);
}
