// SPDX-License-Identifier: Apache-2.0
// Decodes all segments of a file on an NVIDIA GPU and compares them with the CPU.
#include <cuda_runtime_api.h>

#include "compare_decoders.h"
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

bool has_device() {
  int count = 0;
  return cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
}

// A decoded segment on the CPU, the same from the GPU, and its bytes, for all segments at a time.
std::uint64_t memory(View input) {
  return 4 * stgs_memory(input);
}

}  // namespace

const Target stgs::fuzz::kTarget{"decode_cuda", stgs_seeds, nullptr,   repair_stgs,
                                 stgs_units,    memory,     has_device};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto reader = SceneReader::open(memory_source({data, data + size}, "input"), kStgsLimits);
  if (!reader.ok()) return 0;
  for (const bool with_sh : {true, false}) {
    testing::SegmentCounts counts;
    const std::string difference =
        testing::compare_decoders(**reader, with_sh, TimeOrigin::kRecord, counts);
    if (!difference.empty()) std::fprintf(stderr, "%s\n", difference.c_str());
    require(difference.empty(), "the GPU decodes the same segments to the same values");
  }
  return 0;
}
