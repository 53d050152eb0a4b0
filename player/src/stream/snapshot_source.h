// SPDX-License-Identifier: Apache-2.0
// Opens readers over a file as it is at one point in time.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <memory_resource>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/scene_file.h"
#include "stream/range_source.h"

namespace stgs::player {

// Caches the bytes read while opening readers over a growing file, so that the next reader reads
// only new data. One thread at a time.
class IndexCache {
 public:
  // `budget`, if given, is charged for the cached bytes.
  explicit IndexCache(std::shared_ptr<Budget> budget = nullptr) : budget_(std::move(budget)) {
    if (budget_ != nullptr) charge_ = budget_->charge(Budget::Pool::kIndex, 0);
  }
  IndexCache(IndexCache&&) = default;
  // Reads from the cache, else from `under`, which is `size` bytes long at present. A read near the
  // end reads everything from there to the end at once, since an index lies there.
  Status read(const ByteSource& under, std::uint64_t size, std::uint64_t offset,
              std::span<std::uint8_t> out);
  // Discards bytes that were not read since the last call, and bytes from `complete` on, which are
  // read again.
  void retain(std::uint64_t complete);
  // Discards bytes from the last `complete` on. Call it if a reader could not be opened.
  void discard_incomplete();
  void clear();
  std::uint64_t bytes() const { return bytes_; }
  // Returns the offset and bytes of the last read at the end of the file since retain(), up to
  // `complete`; empty if there was none.
  std::pair<std::uint64_t, std::span<const std::uint8_t>> tail(std::uint64_t complete) const;

 private:
  struct Range {
    std::vector<std::uint8_t> bytes;
    bool used = true;
  };
  Range* find(std::uint64_t offset, std::size_t bytes);
  // Inserts a range, or replaces the one at its offset.
  Range& insert(std::uint64_t offset, std::vector<std::uint8_t> bytes);
  // Counts the bytes again.
  void recount();

  std::shared_ptr<Budget> budget_;  // outlives `charge_`
  Lease charge_;
  std::map<std::uint64_t, Range> ranges_;  // by offset; may overlap
  std::uint64_t bytes_ = 0;                // of `ranges_`
  std::uint64_t complete_ = 0;
  std::optional<std::uint64_t> tail_at_;  // offset of the last read at the end of the file
};

// Opens the file as it is now. `memory` allocates decoded data. Errors: those of
// SceneReader::open().
Result<std::shared_ptr<const SceneReader>> open_snapshot(const std::shared_ptr<RangeSource>& source,
                                                         IndexCache& cache,
                                                         const ReadLimits& limits,
                                                         std::pmr::memory_resource* memory,
                                                         IndexLoading loading);
// Makes a copy of a reader that reads from a source, SceneReader::loaded() or refreshed().
using Extension = std::function<Result<std::unique_ptr<SceneReader>>(
    const SceneReader& reader, std::unique_ptr<ByteSource> source)>;
// Returns the result of `extend` for a reader, with the present bytes of the file.
Result<std::shared_ptr<const SceneReader>> extend_snapshot(
    const SceneReader& reader, const std::shared_ptr<RangeSource>& source, IndexCache& cache,
    const Extension& extend);

}  // namespace stgs::player
