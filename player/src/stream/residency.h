// SPDX-License-Identifier: Apache-2.0
// Which segment layers are in memory, and which of them to evict first.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "resident_segment.h"
#include "stgs/format/budget.h"
#include "stgs/player/timeline.h"
#include "stream/change_log.h"
#include "stream/deadlines.h"
#include "stream/segment_index.h"

namespace stgs::player {

enum class LoadState {
  kMissing,
  kInFlight,
  kResident,
  kFailed  // could not be read or decoded; retried later or never
};

// The state of every segment layer. A layer is charged to Budget::Pool::kSegments if and only if it
// is in flight or resident. Segments that are being fetched or decoded are never evicted. Times are
// seconds of a monotonic clock. Not thread-safe.
class Residency {
 public:
  // Everything given by reference outlives this object. `erase_encoded` removes the encoded bytes
  // of the layer at an offset of the file, if there are any; it must not throw.
  Residency(const SegmentIndex& index, const Deadlines& deadlines, Budget& budget,
            double retry_seconds, std::function<void(std::uint64_t)> erase_encoded)
      : index_(index),
        deadlines_(deadlines),
        budget_(budget),
        retry_seconds_(retry_seconds),
        erase_encoded_(std::move(erase_encoded)) {}

  // Reserves memory, so that extend() to so many segments does not throw.
  void reserve(std::size_t segments);
  // Adds the segments by which the index has grown.
  void extend() noexcept;
  // Removes all segments. Call it before the index adopts a renumbering.
  void clear() noexcept;

  // Fetching. begin_fetch() evicts segments with a later deadline where that frees enough memory;
  // it returns false and changes nothing if the layer does not fit.
  bool begin_fetch(const SegmentLayer& layer, double deadline);
  void fetched(const SegmentLayer& layer) noexcept;
  void fetch_cancelled(const SegmentLayer& layer) noexcept { release(layer, LoadState::kMissing); }
  // Marks a layer as failed. Unless that is permanent, the layer is retried with exponential
  // backoff.
  void failed(const SegmentLayer& layer, bool permanently, double now) noexcept;

  // Decoding. decoded() frees the encoded bytes once the segment has its spherical harmonics,
  // unless its primitives may end later.
  void begin_decode(std::uint32_t segment) noexcept;
  void end_decode(std::uint32_t segment) noexcept;
  void decoded(std::uint32_t segment, DecodedSegment resident, bool has_sh) noexcept;
  // Lets segments with new ends be decoded again: they remain resident until then. Segments that
  // are being decoded are decoded again as well.
  void add_ends(const std::vector<std::uint32_t>& segments) noexcept;

  // Adopts a change of SegmentIndex::is_needed(): evicts segments that are no longer needed; those
  // in flight are cancelled as soon as another segment needs their memory.
  void apply_needs() noexcept;
  // Evicts the spherical harmonics of a segment that are not decoded yet.
  void evict_sh(std::uint32_t segment) noexcept;
  // Records permanent damage. Returns false if there is no memory for that.
  bool record_damage(const SegmentLayer& layer, const Status& status) noexcept;
  // Layers with this deadline or a later one do not fit the budget. Forgotten once one does.
  void set_full_from(double deadline) { full_from_ = std::min(full_from_, deadline); }
  void forget_full() { full_from_ = kNever; }

  LoadState state(const SegmentLayer& layer) const { return state_of(layer).state; }
  // The changes of state() and retry_at(), except those of extend() and clear(). Remembers about as
  // many as there are layers.
  const ChangeLog<SegmentLayer>& changes() const { return changes_; }
  // Returns when to retry a failed layer; infinity: never.
  double retry_at(const SegmentLayer& layer) const { return state_of(layer).retry_at; }
  // Returns whether a segment can be decoded, or decoded with spherical harmonics that it lacks.
  bool is_decodable(std::uint32_t segment) const;
  // All such segments, in any order.
  const std::vector<std::uint32_t>& decodable() const { return decodable_; }
  // The segments that became decodable, or are no longer, or whose resident() has changed, except
  // by extend() and clear(). Remembers about as many as there are segments.
  const ChangeLog<std::uint32_t>& decode_changes() const { return decode_changes_; }
  // Returns whether a segment is being decoded or can be: that may free memory.
  bool is_decoding() const { return decoding_ > 0 || !decodable_.empty(); }
  // Returns a segment if it is resident, else null.
  const DecodedSegment& resident(std::uint32_t segment) const { return entries_[segment].resident; }
  // Returns the bytes charged for a layer.
  std::uint64_t charged_bytes(const SegmentLayer& layer) const {
    return state_of(layer).charge.bytes();
  }
  std::uint64_t stored_primitives() const { return stored_primitives_; }
  const std::vector<SegmentDamage>& damage() const { return damage_; }

  // SegmentStore documents these.
  bool ready(double ticks) const;
  std::vector<TickRange> ready_ranges() const;
  int layers(double ticks) const;
  bool is_complete(double ticks) const;

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  static constexpr std::size_t kNoSlot = std::numeric_limits<std::size_t>::max();
  struct LayerState {
    LoadState state = LoadState::kMissing;
    double retry_at = 0;  // kFailed: when to retry
    double backoff = 0;   // delay before the last retry, seconds; 0: none failed
    Lease charge;
  };
  struct Entry {
    LayerState base, sh;
    bool decoding = false;
    bool has_sh = false;  // `resident` includes its spherical harmonics
    // Ends have arrived that `resident`, and a segment that is being decoded, may lack.
    bool is_outdated = false, decoding_has_ends = false;
    std::size_t slot = kNoSlot;  // in decodable_
    DecodedSegment resident;
  };

  LayerState& state_of(const SegmentLayer& layer) {
    return layer.sh ? entries_[layer.segment].sh : entries_[layer.segment].base;
  }
  const LayerState& state_of(const SegmentLayer& layer) const {
    return layer.sh ? entries_[layer.segment].sh : entries_[layer.segment].base;
  }
  bool is_base_final(std::uint32_t segment) const;
  bool is_sh_final(std::uint32_t segment) const;
  bool does_not_fit(const SegmentLayer& layer) const;
  bool is_evictable(std::uint32_t segment) const;
  bool evict_for(std::uint64_t bytes, double deadline);
  void evict(std::uint32_t segment) noexcept;
  void release(const SegmentLayer& layer, LoadState state) noexcept;
  void set_state(const SegmentLayer& layer, LoadState state) noexcept;
  void set_resident(std::uint32_t segment, DecodedSegment resident) noexcept;
  void update_decodable(std::uint32_t segment) noexcept;

  const SegmentIndex& index_;
  const Deadlines& deadlines_;
  Budget& budget_;
  const double retry_seconds_;
  const std::function<void(std::uint64_t)> erase_encoded_;
  std::vector<Entry> entries_;  // by segment
  std::vector<std::uint32_t> decodable_;
  ChangeLog<SegmentLayer> changes_;
  ChangeLog<std::uint32_t> decode_changes_;
  int decoding_ = 0;  // segments that are being decoded
  // Layers with this deadline or a later one did not fit the budget while nothing was in flight.
  double full_from_ = kNever;
  std::uint64_t stored_primitives_ = 0;
  std::vector<SegmentDamage> damage_;
};

}  // namespace stgs::player
