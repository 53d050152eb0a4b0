// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <exception>
#include <new>

#include "printable.h"
#include "program.h"
#include "standard_streams.h"
#include "stgs/format/status.h"

namespace {

constexpr const char* kNoMemory = "stgs: error: not enough memory\n";

// Ends the program as main() would if a library runs out of memory where it cannot report it, as
// nlohmann::json in its destructor.
[[noreturn]] void end_without_memory() {
  try {
    if (const std::exception_ptr current = std::current_exception())
      std::rethrow_exception(current);
  } catch (const std::bad_alloc&) {
    stgs::tools::write_standard_error(kNoMemory);
    std::_Exit(static_cast<int>(stgs::StatusCode::kRuntime));
  } catch (...) {  // a defect
  }
  std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  stgs::tools::reserve_standard_streams();
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
