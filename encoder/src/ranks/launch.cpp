// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cstdlib>
#include <cstring>

#include "stgs/encoder/ranks.h"

namespace stgs::encoder {
namespace {

// Returns the integer in an environment variable; 0 if it is unset or not an integer.
int number_of(const char* name) {
  const char* text = std::getenv(name);
  int value = 0;
  if (text == nullptr) return 0;
  const char* end = text + std::strlen(text);
  const auto [stopped, error] = std::from_chars(text, end, value);
  return error == std::errc() && stopped == end ? value : 0;
}

}  // namespace

Launch detect_launch() {
  if (const int size = number_of("OMPI_COMM_WORLD_SIZE"); size > 1) return {size, "mpirun"};
  if (const int size = number_of("PMI_SIZE"); size > 1) return {size, "mpirun"};
  // An allocation or a batch script sets SLURM_NTASKS too; only a step runs several processes.
  if (std::getenv("SLURM_STEP_ID") == nullptr) return {};
  int size = number_of("SLURM_STEP_NUM_TASKS");
  if (size == 0) size = number_of("SLURM_NTASKS");
  return size > 1 ? Launch{size, "srun"} : Launch{};
}

}  // namespace stgs::encoder
