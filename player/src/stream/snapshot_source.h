// SPDX-License-Identifier: Apache-2.0
// A file that grows, as it was at a moment: what a reader of it is opened over.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <memory_resource>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_file.h"
#include "stream/piece_source.h"

namespace stgs::player {

// What opening readers over a growing file has read of it, so that the next reader reads only what
// is new. One thread at a time.
class IndexCache {
 public:
  // Reads from what is known, else from `under`, which has `size` bytes now: near its end all that
  // is there at once, since an index lies there.
  Status read(const ByteSource& under, std::uint64_t size, std::uint64_t offset,
              std::span<std::uint8_t> out);
  // Forgets what was not read since the last call, and what lies behind `complete`, which may
  // become something else.
  void keep(std::uint64_t complete);
  // Forgets only the latter: a reader could not be opened.
  void keep();
  void clear() { ranges_.clear(); }
  std::uint64_t bytes() const;
  // Of what was read at the end since the last call of keep(), what lies before `complete`: the
  // first byte's place, and the bytes.
  std::pair<std::uint64_t, std::span<const std::uint8_t>> tail(std::uint64_t complete) const;

 private:
  struct Range {
    std::vector<std::uint8_t> bytes;
    bool used = true;
  };
  Range* find(std::uint64_t offset, std::size_t bytes);

  std::map<std::uint64_t, Range> ranges_;  // by offset, apart from each other or not
  std::uint64_t complete_ = 0;
  std::optional<std::uint64_t> tail_at_;  // where what was read at the end begins
};

// Reads the index of the file as it is. `memory`: of what is decoded. Errors: SceneReader::open's.
Result<std::shared_ptr<const SceneReader>> open_snapshot(const std::shared_ptr<RangeSource>& source,
                                                         IndexCache& cache,
                                                         const ReadLimits& limits,
                                                         std::pmr::memory_resource* memory);

}  // namespace stgs::player
