// SPDX-License-Identifier: Apache-2.0
// Compares the CUDA segment decoder with the CPU decoder, bit for bit.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "device_gaussians.h"
#include "stgs/format/scene_file.h"

namespace stgs::testing {

struct SegmentCounts {
  int intact = 0, unreadable = 0;
};

inline bool same_bits(Gaussians4D a, Gaussians4D b) {
  const auto of_a = DeviceGaussianArrays::arrays(a), of_b = DeviceGaussianArrays::arrays(b);
  for (std::size_t k = 0; k < of_a.size(); ++k) {
    const std::size_t size = of_a[k]->size();
    if (size != of_b[k]->size()) return false;
    if (size > 0 && std::memcmp(of_a[k]->data(), of_b[k]->data(), sizeof(float) * size) != 0)
      return false;
  }
  return true;
}

// Decodes all segments of a file in one launch and compares them with the CPU. Returns the first
// difference, or an empty text.
inline std::string compare_decoders(const SceneReader& reader, bool with_sh, TimeOrigin origin,
                                    SegmentCounts& counts) {
  std::vector<CodedSegment> coded;
  std::vector<Result<Gaussians4D>> expected;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    Result<CodedSegment> segment = reader.read(s, with_sh, origin);
    Result<Gaussians4D> set = reader.decode(s, with_sh, origin);
    if (!segment.ok()) {
      if (set.ok()) return "the CPU decodes a segment that cannot be read for the GPU";
      ++counts.unreadable;
      continue;
    }
    coded.push_back(std::move(*segment));
    expected.push_back(std::move(set));
  }
  std::vector<DeviceGaussianArrays> sets;
  std::vector<const CodedSegment*> segments;
  std::vector<player::cuda::DeviceGaussians> views;
  for (const CodedSegment& segment : coded) {
    sets.emplace_back(segment.primitives, segment.sh_degree);
    segments.push_back(&segment);
    views.push_back(sets.back().view());
  }
  player::cuda::SegmentDecoder decoder;
  if (Status status = decoder.set_tables(reader.tables(), nullptr); !status.ok())
    return status.message();
  if (Status status = decoder.prepare(segments, views); !status.ok()) return status.message();
  if (Status status = decoder.launch(nullptr); !status.ok()) return status.message();
  const Result<std::vector<bool>> intact = decoder.finish();
  if (!intact.ok()) return intact.status().message();
  for (std::size_t k = 0; k < coded.size(); ++k) {
    const std::string segment = "readable segment " + std::to_string(k);
    if ((*intact)[k] != expected[k].ok())
      return segment + (expected[k].ok() ? " is damaged for the GPU alone"
                                         : ": " + expected[k].status().message());
    if (!expected[k].ok()) continue;
    if (!same_bits(sets[k].read(), *expected[k])) return segment + " has other values";
    if (coded[k].time_origin != expected[k]->time_origin) return segment + " has another origin";
    ++counts.intact;
  }
  return {};
}

}  // namespace stgs::testing
