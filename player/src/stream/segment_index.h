// SPDX-License-Identifier: Apache-2.0
// The segments of a file, and their layers in file order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "stgs/format/scene_file.h"
#include "stream/need.h"

namespace stgs::player {

// The file as it is known at present. A new generation renumbers the segments instead of only
// appending some.
struct FileSnapshot {
  std::shared_ptr<const SceneReader> reader;
  std::uint64_t generation = 0;
};

// A segment layer and its location in the file.
struct LocatedLayer {
  SegmentLayer layer;
  std::uint64_t offset = 0, bytes = 0;
};

// Empty until the first reader is adopted. Not thread-safe.
class SegmentIndex {
 public:
  // `overhead`: bytes that a decoded segment takes besides its primitives.
  explicit SegmentIndex(std::uint64_t overhead = 0) : overhead_(overhead) {}
  // The changes that adopting a reader makes.
  struct Update {
    std::shared_ptr<const SceneReader> reader;
    std::vector<SegmentLayer> added;   // in file order
    std::vector<std::uint32_t> ended;  // known segments with new ends
    bool renumbered = false;           // the numbers of all segments change
    int tiers = 1;
    std::vector<std::uint64_t> tier_peaks;  // tier_peaks(), with limit_primitives()
  };
  // Computes the changes for a reader of the file, and reserves memory for them. If this throws,
  // nothing has changed.
  Update prepare(std::shared_ptr<const SceneReader> reader);
  // Makes the changes of the last prepare().
  void adopt(Update update) noexcept;

  const SceneReader& reader() const { return *now_.reader; }
  const FileSnapshot& snapshot() const { return now_; }
  std::uint64_t generation() const { return now_.generation; }
  // Returns a number that changes with each adopted reader and each limit of primitives.
  std::uint64_t revision() const { return revision_; }
  std::size_t size() const { return now_.reader == nullptr ? 0 : reader().segments().size(); }
  const SegmentInfo& info(std::uint32_t segment) const { return reader().segments()[segment]; }
  double duration() const { return reader().metadata().frames; }  // ticks
  // Returns the number of tiers, which is the number of layers without spherical harmonics.
  int tiers() const { return tiers_; }

  // Limits the primitives that are needed at one time: tiers beyond the limit are not needed at
  // all. The first tier is always needed. If this throws, nothing has changed.
  void limit_primitives(std::uint64_t max_primitives);
  // Returns tier_peaks() of the file; empty without limit_primitives().
  const std::vector<std::uint64_t>& tier_peaks() const { return tier_peaks_; }
  // Returns the number of tiers that are needed, from the first.
  int needed_tiers() const { return needed_tiers_; }
  // Returns whether a segment is needed at any time.
  bool is_needed(std::uint32_t segment) const {
    return info(segment).is_needed() && info(segment).tier < needed_tiers_;
  }

  // Returns the number of the layer of the file that a segment layer belongs to.
  int layer_number(const SegmentLayer& layer) const {
    return layer_of(info(layer.segment), layer.sh, tiers_);
  }
  // Returns the size in the file; 0: the layer does not exist.
  std::uint64_t stored_bytes(const SegmentLayer& layer) const;
  std::uint64_t file_offset(const SegmentLayer& layer) const;
  LocatedLayer locate(const SegmentLayer& layer) const {
    return {layer, file_offset(layer), stored_bytes(layer)};
  }
  // Returns the memory that a layer takes at most: its bytes of the file, and the decoded segment,
  // which belongs to the base.
  std::uint64_t memory_bytes(const SegmentLayer& layer) const;

  // All existing segment layers by offset.
  const std::vector<SegmentLayer>& file_order() const { return file_order_; }
  // Returns the index of an existing layer in file_order().
  std::size_t file_index(const SegmentLayer& layer) const {
    return file_index_[2 * std::size_t{layer.segment} + (layer.sh ? 1 : 0)];
  }
  // Returns times that playback reaches within `seconds` and whose segments are not known yet; the
  // position itself first.
  std::optional<TickRange> unknown_times(const Playhead& playhead, double seconds) const;
  // Returns the layers that playback reaches within `seconds`, and a few more, as indices in
  // file_order(), ascending.
  std::vector<std::size_t> upcoming_layers(const Playhead& playhead, double seconds) const;

 private:
  bool is_continuation(const SceneReader& reader) const;
  void choose_tiers() noexcept;
  // Returns the ranges of time that playback reaches within `seconds`, and a little more.
  std::vector<TickRange> upcoming_times(const Playhead& playhead, double seconds) const;

  const std::uint64_t overhead_;
  FileSnapshot now_;
  std::uint64_t revision_ = 0;
  int tiers_ = 1;
  std::optional<std::uint64_t> max_primitives_;
  std::vector<std::uint64_t> tier_peaks_;
  int needed_tiers_ = std::numeric_limits<int>::max();  // without limit_primitives(): all
  std::vector<SegmentLayer> file_order_;
  std::vector<std::size_t> file_index_;  // in file_order_: of a segment's base, then its SH
};

}  // namespace stgs::player
