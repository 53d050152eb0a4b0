// SPDX-License-Identifier: Apache-2.0
// What is alive when: decoded segments of an open file, and the candidates at a moment.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// Decodes the segments that a moment needs, keeps them within a memory budget (those needed least
// recently go first). Not thread-safe.
class Timeline {
 public:
  static Result<std::unique_ptr<Timeline>> open(const std::string& path,
                                                std::uint64_t memory_budget = std::uint64_t{4}
                                                                              << 30);
  virtual ~Timeline() = default;

  virtual const SceneMetadata& metadata() const = 0;
  virtual double duration_seconds() const = 0;

  // The decoded segments alive at the moment; valid until the next call.
  struct Active {
    // Each set with its candidate primitives (ascending indices) at this moment.
    struct Part {
      std::uint32_t segment;
      const Gaussians4D* set;
      const std::vector<std::uint32_t>* candidates;
    };
    std::vector<Part> parts;
    double ticks = 0;
  };
  virtual Result<Active> at(double seconds) = 0;
  virtual std::uint64_t memory_bytes() const = 0;
  virtual std::uint64_t stored_primitives() const = 0;
};

}  // namespace stgs::player
