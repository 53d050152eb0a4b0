// SPDX-License-Identifier: Apache-2.0
// SegmentStore: the segments of the file, and their layers in file order.
#include <algorithm>
#include <limits>
#include <utility>

#include "stream/no_memory.h"
#include "stream/segment_store.h"

namespace stgs::player {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

std::uint64_t offset_of(const SegmentInfo& segment, bool sh) {
  return sh ? segment.sh_offset : segment.offset;
}
std::uint64_t bytes_of(const SegmentInfo& segment, bool sh) {
  return sh ? segment.sh_bytes : segment.bytes;
}

// Returns the layers of the segments from index `first` on, ordered by offset.
std::vector<SegmentLayer> layers_from(const std::vector<SegmentInfo>& segments, std::size_t first) {
  std::vector<SegmentLayer> out;
  for (std::size_t s = first; s < segments.size(); ++s) {
    for (const bool sh : {false, true}) {
      if (bytes_of(segments[s], sh) == 0) continue;
      out.push_back({static_cast<std::uint32_t>(s), sh});
    }
  }
  const auto offset = [&](const SegmentLayer& layer) {
    return offset_of(segments[layer.segment], layer.sh);
  };
  std::sort(out.begin(), out.end(),
            [&](const SegmentLayer& a, const SegmentLayer& b) { return offset(a) < offset(b); });
  return out;
}

}  // namespace

std::uint64_t SegmentStore::stored_bytes(const SegmentLayer& layer) const {
  return bytes_of(reader_->segments()[layer.segment], layer.sh);
}

std::uint64_t SegmentStore::file_offset(const SegmentLayer& layer) const {
  return offset_of(reader_->segments()[layer.segment], layer.sh);
}

// Returns whether the segments of `reader` begin with the known ones, followed by others that lie
// behind them in the file.
bool SegmentStore::is_continuation(const SceneReader& reader) const {
  const std::vector<SegmentInfo>&before = reader_->segments(), &now = reader.segments();
  const auto same = [](const SegmentInfo& a, const SegmentInfo& b) {
    return a.offset == b.offset && a.bytes == b.bytes && a.primitives == b.primitives &&
           a.sh_offset == b.sh_offset && a.sh_bytes == b.sh_bytes;
  };
  return now.size() >= before.size() &&
         std::equal(before.begin(), before.end(), now.begin(), same) &&
         std::all_of(now.begin() + static_cast<std::ptrdiff_t>(before.size()), now.end(),
                     [&](const SegmentInfo& s) { return s.offset >= reader_->file_bytes(); });
}

// Adds the new segments of `reader`, which follow the known ones in the file. Everything that can
// throw comes before any change.
void SegmentStore::adopt_reader(std::shared_ptr<const SceneReader> reader) {
  const std::vector<SegmentInfo>& segments = reader->segments();
  // A damaged index fragment omits segments that a later one may list again.
  const bool renumbered = !is_continuation(*reader);
  const std::vector<SegmentLayer> added = layers_from(segments, renumbered ? 0 : entries_.size());
  reserve_for(entries_, segments.size());
  reserve_for(file_order_, (renumbered ? 0 : file_order_.size()) + added.size());
  reserve_for(file_index_, 2 * segments.size());
  if (renumbered) forget_segments();
  reader_ = std::move(reader);
  const std::size_t first = entries_.size();
  entries_.resize(segments.size());
  for (std::size_t s = first; s < segments.size(); ++s) {
    tiers_ = std::max(tiers_, segments[s].tier + 1);
    if (!segments[s].available) entries_[s].base = {LoadState::kFailed, kNever};
    if (!segments[s].sh_available) entries_[s].sh = {LoadState::kFailed, kNever};
    if (segments[s].sh_bytes == 0) entries_[s].sh.state = LoadState::kResident;
  }
  file_index_.resize(2 * segments.size());
  for (const SegmentLayer& layer : added) {
    file_index_[2 * std::size_t{layer.segment} + (layer.sh ? 1 : 0)] = file_order_.size();
    file_order_.push_back(layer);
  }
}

// Requests in flight are discarded when they end.
void SegmentStore::forget_segments() {
  for (const SegmentLayer& layer : file_order_) {
    if (state_of(layer).state == LoadState::kResident) source_->erase(file_offset(layer));
  }
  source_->forget_recent();
  entries_.clear();
  file_order_.clear();
  file_index_.clear();
  damage_.clear();
  memory_ = stored_primitives_ = 0;
  full_from_ = kNever;
  ++generation_;
}

void SegmentStore::grow(std::shared_ptr<const SceneReader> reader) {
  {
    const std::lock_guard lock(mutex_);
    adopt_reader(std::move(reader));
  }
  to_fetch_.notify_all();
}

SegmentStore::Snapshot SegmentStore::snapshot() const {
  const std::lock_guard lock(mutex_);
  return {reader_, generation_};
}

int SegmentStore::tiers() const {
  const std::lock_guard lock(mutex_);
  return tiers_;
}

}  // namespace stgs::player
