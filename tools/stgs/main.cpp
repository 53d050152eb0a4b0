// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <cstdlib>
#include <exception>
#include <new>

#include "printable.h"
#include "program.h"
#include "standard_streams.h"
#include "stgs/format/status.h"

namespace {

constexpr const char* kNoMemory = "stgs: error: not enough memory\n";

std::atomic<bool> ran_out_of_memory = false;

void note_no_memory() {
  ran_out_of_memory = true;
  throw std::bad_alloc();
}

// Ends the program as main() would if a library runs out of memory where it cannot report it, as
// nlohmann::json in its destructor, also while another exception is thrown.
[[noreturn]] void end_without_memory() {
  if (!ran_out_of_memory) std::abort();  // a defect
  stgs::tools::write_standard_error(kNoMemory);
  std::_Exit(static_cast<int>(stgs::StatusCode::kRuntime));
}

}  // namespace

int main(int argc, char** argv) {
  stgs::tools::reserve_standard_streams();
  std::set_new_handler(note_no_memory);
  std::set_terminate(end_without_memory);
  try {
    return stgs::tools::run_program(argc, argv);
  } catch (const std::bad_alloc&) {
    stgs::tools::write_standard_error(kNoMemory);
  } catch (const std::exception& error) {
    stgs::tools::write_standard_error(
        fmt::format("stgs: error: {}\n", stgs::tools::one_line(error.what())));
  }
  return static_cast<int>(stgs::StatusCode::kRuntime);
}
