// SPDX-License-Identifier: Apache-2.0
// Fetches and decodes segments ahead of playback, within a memory budget.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <limits>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "resident_segment.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/player.h"
#include "stream/availability.h"
#include "stream/event_queue.h"
#include "stream/need.h"
#include "stream/range_source.h"
#include "stream/throughput.h"

namespace stgs::player {

// Thread-safe. Only the destructor waits for transfers, namely for those in flight.
class SegmentStore final : public Availability {
 public:
  // `source` is the one that `reader` reads. `on_replaced` is called by threads of the store when a
  // file that is not live turns out to be replaced (true), or to be the right one again (false); it
  // must not throw.
  SegmentStore(std::shared_ptr<const SceneReader> reader, std::shared_ptr<RangeSource> source,
               const PlayerSettings& settings, std::function<void(bool)> on_replaced);
  ~SegmentStore() override;
  // Begins no further work. Work in flight ends by itself or when the source is interrupted.
  void stop();
  SegmentStore(const SegmentStore&) = delete;
  SegmentStore& operator=(const SegmentStore&) = delete;

  // The file as it is known at present. A new generation renumbers the segments instead of only
  // appending some, and evicts everything that was resident.
  struct Snapshot {
    std::shared_ptr<const SceneReader> reader;
    std::uint64_t generation = 0;
  };
  Snapshot snapshot() const;
  // Adopts a reader of the file after it has grown. If this throws, nothing has changed.
  void grow(std::shared_ptr<const SceneReader> reader);
  int tiers() const;
  std::uint64_t memory_budget() const { return settings_.memory_budget; }

  // Sets the playback position. Nothing is fetched before the first call. `jumped`: the position
  // did not result from playback.
  void set_playhead(const Playhead& playhead, bool jumped);
  Playhead playhead() const;

  // Returns a segment of the given generation if it is resident, else null.
  std::shared_ptr<const ResidentSegment> resident(std::uint32_t segment,
                                                  std::uint64_t generation) const;
  ClipExtent extent() const override;
  bool ready(double ticks) const override;
  std::vector<TickRange> ready_ranges() const override;
  // Returns the number of layers, counting from layer 0, that are complete at `ticks`.
  int layers(double ticks) const;
  // Returns whether nothing more will arrive for `ticks` while the position stays there.
  bool is_complete(double ticks) const;
  StreamStatistics statistics() const;
  // Returns the damage found so far.
  std::vector<SegmentDamage> segment_damage() const;
  // Removes and returns the events since the last call.
  std::vector<PlayerEvent> take_events();
  // Queues an event, stamped with the playback position.
  void push_event(PlayerEvent event) noexcept;
  // Queues an event that has its position.
  void push_stamped_event(PlayerEvent event) noexcept;

 private:
  enum class LoadState {
    kMissing,
    kInFlight,
    kResident,
    kFailed  // could not be read or decoded; retried later or never
  };
  struct LayerState {
    LoadState state = LoadState::kMissing;
    double retry_at = 0;       // kFailed: when to retry
    double backoff = 0;        // delay before the last retry, seconds; 0: none failed
    std::uint64_t memory = 0;  // bytes charged to the budget
  };
  struct Entry {
    LayerState base, sh;
    bool decoding = false;
    bool has_sh = false;  // `resident` includes its spherical harmonics
    std::shared_ptr<const ResidentSegment> resident;
  };
  // A segment layer and its location in the file.
  struct LocatedLayer {
    SegmentLayer layer;
    std::uint64_t offset = 0, bytes = 0;
  };
  // Segment layers that are adjacent in the file and fetched together.
  struct FetchRequest {
    std::uint64_t offset = 0, bytes = 0;
    std::vector<LocatedLayer> layers;
    std::uint64_t jumps = 0;  // value of jumps_ when it began
    double started_at = 0;
    std::uint64_t generation = 0;
  };
  using FetchRequests = std::list<FetchRequest>;
  // The segments that are being decoded.
  struct InFlight {
    int segments = 0;
    int ahead = 0;            // of these, segments that are not needed yet
    std::uint64_t bytes = 0;  // memory charged for them
    InFlight with(const InFlight& o) const {
      return {segments + o.segments, ahead + o.ahead, bytes + o.bytes};
    }
    InFlight without(const InFlight& o) const {
      return {segments - o.segments, ahead - o.ahead, bytes - o.bytes};
    }
  };

  LayerState& state_of(const SegmentLayer& layer) {
    return layer.sh ? entries_[layer.segment].sh : entries_[layer.segment].base;
  }
  const LayerState& state_of(const SegmentLayer& layer) const {
    return layer.sh ? entries_[layer.segment].sh : entries_[layer.segment].base;
  }
  std::uint64_t memory_of(const SegmentLayer& layer) const;  // fetched and decoded
  Need need_for(const SegmentLayer& layer) const;
  double deadline_of(const SegmentLayer& layer) const;

  // segment_store.cpp
  bool is_base_final(std::uint32_t segment) const;
  bool is_sh_final(std::uint32_t segment) const;
  bool does_not_fit(const SegmentLayer& layer) const;
  void start_threads();
  void start_more_decoders();
  void start_thread(void (SegmentStore::*work)());
  void set_memory(const SegmentLayer& layer, std::uint64_t bytes);
  void set_resident(std::uint32_t segment, std::shared_ptr<const ResidentSegment> resident);
  void release(const SegmentLayer& layer, LoadState state);
  bool is_evictable(std::uint32_t segment) const;
  bool evict_for(std::uint64_t bytes, double deadline);
  void evict(std::uint32_t segment);
  void evict_sh(std::uint32_t segment) noexcept;
  void append_event(PlayerEvent event) noexcept;
  void mark_failed(const SegmentLayer& layer, bool permanently, PlayerEvent::Kind kind,
                   const Status& status) noexcept;

  // segment_index.cpp
  std::uint64_t stored_bytes(const SegmentLayer& layer) const;  // in the file
  std::uint64_t file_offset(const SegmentLayer& layer) const;
  bool is_continuation(const SceneReader& reader) const;
  void adopt_reader(std::shared_ptr<const SceneReader> reader);
  void forget_segments();

  // segment_fetch.cpp
  void run_fetcher();
  // Layers needed later than this are not fetched yet, seconds. At least what playback requires to
  // resume.
  double prefetch_horizon() const {
    return std::max(settings_.prefetch_seconds, settings_.resume_seconds);
  }
  std::size_t file_index(const SegmentLayer& layer) const {
    return file_index_[2 * std::size_t{layer.segment} + (layer.sh ? 1 : 0)];
  }
  std::vector<std::size_t> upcoming_layers() const;
  bool is_fetchable(const SegmentLayer& layer, double now) const;
  bool arrives_in_time(const SegmentLayer& layer) const;
  bool is_viewer_waiting(double now) const;
  std::optional<SegmentLayer> next_layer(double now) const;
  bool next_request(double now, FetchRequests& out);
  bool reserve(const SegmentLayer& layer, double deadline);
  bool is_decoding() const;
  void extend(FetchRequest& request, double deadline, double now);
  std::size_t read_size(const FetchRequest& request) const;
  bool is_abandoned(const FetchRequest& request) const;
  bool is_obsolete(const FetchRequest& request, std::uint64_t from) const;
  Status fetch(const FetchRequest& request, std::vector<std::uint8_t>& bytes);
  void insert_ranges(const FetchRequest& request, std::span<const std::uint8_t> bytes);
  void finish(const FetchRequest& request, bool complete, const Status& status) noexcept;
  void cancel(const FetchRequest& request) noexcept;
  bool is_live() const;
  void set_replaced(bool replaced) noexcept;

  // segment_decoding.cpp
  void run_decoder();
  std::optional<std::uint32_t> next_decode() const;
  bool is_ahead(std::uint32_t segment) const;
  bool may_decode(std::uint32_t segment) const;
  Status decode(const SceneReader& reader, std::uint32_t segment, bool with_sh,
                std::shared_ptr<const ResidentSegment>& out, Status& sh) const;
  void insert_decoded(std::uint32_t segment, bool with_sh,
                      std::shared_ptr<const ResidentSegment> decoded, const Status& base,
                      const Status& sh) noexcept;
  bool record_damage(const SegmentLayer& layer, const Status& status) noexcept;

  const std::shared_ptr<RangeSource> source_;
  const PlayerSettings settings_;
  const std::function<void(bool)> on_replaced_;
  int max_decodes_ = 1;  // segments decoded at once

  mutable std::mutex mutex_;  // guards the following members
  std::shared_ptr<const SceneReader> reader_;
  std::uint64_t generation_ = 0;  // how often the segments were renumbered
  int tiers_ = 1;
  std::vector<SegmentLayer> file_order_;  // all segment layers, by offset
  std::vector<std::size_t> file_index_;   // index in file_order_ of a segment's base, then its SH
  std::condition_variable to_fetch_, to_decode_;
  bool stopping_ = false;
  bool is_replaced_ = false;  // as reported to on_replaced_
  double suspect_until_ = 0;  // data fetched until then may be of another file, clock seconds
  std::uint64_t jumps_ = 0;   // of the playhead
  bool has_playhead_ = false;
  Playhead playhead_;
  std::vector<Entry> entries_;  // by segment
  InFlight decoding_;
  bool waits_for_memory_ = false;  // a layer did not fit; decoding may free enough memory
  FetchRequests requests_;         // in flight
  std::uint64_t memory_ = 0;
  // Layers with this deadline or a later one did not fit the budget while nothing was in flight.
  double full_from_ = std::numeric_limits<double>::infinity();
  Throughput throughput_;
  std::uint64_t fetched_bytes_ = 0, stored_primitives_ = 0;
  EventQueue events_;
  std::vector<SegmentDamage> damage_;
  std::vector<std::thread> threads_;
};

}  // namespace stgs::player
