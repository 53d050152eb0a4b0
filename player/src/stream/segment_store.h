// SPDX-License-Identifier: Apache-2.0
// Fetches and decodes segments ahead of playback, within a memory budget.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/player.h"
#include "stream/async_byte_source.h"
#include "stream/availability.h"
#include "stream/change_monitor.h"
#include "stream/deadlines.h"
#include "stream/decode_executor.h"
#include "stream/decode_queue.h"
#include "stream/event_queue.h"
#include "stream/fetch_scheduler.h"
#include "stream/need.h"
#include "stream/range_source.h"
#include "stream/residency.h"
#include "stream/segment_index.h"

namespace stgs::player {

// The result of SegmentStore::pump().
struct PumpResult {
  bool progressed = false;  // there may be more to do at once
  // When to call pump() again even if nothing else happens; infinity: only when woken.
  double wake_at = std::numeric_limits<double>::infinity();
};

// Why pump() has something to do.
enum class WakeReason {
  kJump,    // the calling thread has set the position
  kEnded,   // a read or a decoder has ended on the calling thread
  kChanged  // anything else
};

// Coordinates the index, the residency, the schedulers and the event queue, which have neither
// threads nor locks. pump() makes the progress; one thread at a time calls it. All other functions
// are thread-safe and never wait for a read or a decoder.
class SegmentStore final : public Availability {
 public:
  // `source` is the one that `reader` reads. `transport` reads the same file, `executor` decodes.
  // `on_replaced` is called by pump() when a file that is not live turns out to be replaced (true),
  // or to be the right one again (false); it must not throw.
  SegmentStore(std::shared_ptr<const SceneReader> reader, std::shared_ptr<RangeSource> source,
               const PlayerSettings& settings, std::shared_ptr<Budget> budget,
               std::unique_ptr<AsyncByteSource> transport, std::unique_ptr<DecodeExecutor> executor,
               std::function<void(bool)> on_replaced);
  // Waits for the reads and decoders in flight.
  ~SegmentStore() override;
  SegmentStore(const SegmentStore&) = delete;
  SegmentStore& operator=(const SegmentStore&) = delete;

  // Sets a function that is called, from any thread, when pump() has something to do. It must not
  // throw, and may call pump(). Call this before set_playhead().
  void set_wake(std::function<void(WakeReason)> wake) { wake_ = std::move(wake); }
  // Collects the reads and segments that have arrived, and begins further ones. Repeats that until
  // nothing is left to do, or until `budget` seconds have passed; once at least. Never blocks;
  // decodes on the calling thread only if the executor does. `now`: seconds of a monotonic clock.
  PumpResult pump(double now, double budget) noexcept;
  // Begins no further work. Reads in flight end early.
  void stop() noexcept;

  // Sets a function that is called when the position moves to times whose segments are not known
  // yet; it must not throw. Call this before set_playhead().
  void set_on_unknown(std::function<void()> call) { on_unknown_ = std::move(call); }
  // Returns times whose segments playback needs to know next; nothing before set_playhead().
  std::optional<TickRange> unknown_times() const;

  FileSnapshot snapshot() const;
  // Adopts a reader of the file that knows more segments. If this throws, nothing has changed.
  void grow(std::shared_ptr<const SceneReader> reader);
  int tiers() const;
  // Limits the primitives that are needed at one time, see SegmentIndex::limit_primitives().
  // Segments beyond the limit are evicted and no longer returned by resident().
  void limit_primitives(std::uint64_t max_primitives);
  // Returns tier_peaks() of the file; empty without limit_primitives().
  std::vector<std::uint64_t> tier_peaks() const;
  std::uint64_t memory_budget() const { return settings_.memory_budget; }
  const std::shared_ptr<Budget>& budget() const { return budget_; }

  // Sets the playback position. Nothing is fetched before the first call. `jumped`: the position
  // did not result from playback.
  void set_playhead(const Playhead& playhead, bool jumped);
  Playhead playhead() const;

  // Returns a segment of the given generation if it is resident, else null.
  DecodedSegment resident(std::uint32_t segment, std::uint64_t generation) const;
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
  struct Decoded {
    DecodeJob job;
    DecodeResult result;
  };

  void adopt(std::shared_ptr<const SceneReader> reader);
  void wake(WakeReason reason) const noexcept {
    if (wake_) wake_(reason);
  }

  // The steps of pump(), in store_pump.cpp. They return whether they made progress.
  bool step(double now, double& wake_at) noexcept;
  bool collect(double now) noexcept;
  void cancel_reads(double now, double& wake_at) noexcept;
  bool start_fetches(double now, double& wake_at) noexcept;
  bool start_decodes() noexcept;

  void begin_fetch(FetchRequest& request, double now) noexcept;
  void begin_read(FetchRequest& request, double now) noexcept;
  void end_read(AsyncByteSource::Done done, double now) noexcept;
  Status read_failure(const FetchRequest& request, const std::exception& e) const noexcept;
  Status insert_ranges(const FetchRequest& request) noexcept;
  void finish(FetchRequest& request, bool complete, const Status& status, double now) noexcept;
  void end_decode(Decoded decoded, double now) noexcept;
  void report_replaced() noexcept;
  FileChanges file_changes() const;

  // Called with the mutex locked.
  bool insert_decoded(const DecodeJob& job, DecodeResult& result, const FileChanges& changes,
                      double now) noexcept;
  void decode_failed(const SegmentLayer& layer, const Status& status, const FileChanges& changes,
                     double now) noexcept;
  void fail(const SegmentLayer& layer, bool permanently, PlayerEvent::Kind kind,
            const Status& status, double now) noexcept;
  void append_event(PlayerEvent event) noexcept;
  bool is_live() const;

  const std::shared_ptr<RangeSource> source_;
  const PlayerSettings settings_;
  const std::shared_ptr<Budget> budget_;
  const std::function<void(bool)> on_replaced_;

  mutable std::mutex mutex_;  // guards the following members
  Lease index_charge_;        // of the opened index
  SegmentIndex index_;
  Deadlines deadlines_;
  Residency residency_;
  FetchScheduler fetches_;
  ChangeMonitor monitor_;
  EventQueue events_;
  bool stopping_ = false;

  // Used by pump() only.
  bool replaced_reported_ = false;
  bool out_of_memory_ = false;  // reported once
  std::vector<AsyncByteSource::Done> arrived_;
  std::vector<Decoded> finished_;

  std::function<void(WakeReason)> wake_;
  std::function<void()> on_unknown_;
  std::mutex done_mutex_;  // guards the following members; never locked for long
  std::vector<AsyncByteSource::Done> reads_done_;
  std::vector<Decoded> decodes_done_;

  // The last ones, since their threads use the others.
  std::unique_ptr<AsyncByteSource> transport_;
  std::unique_ptr<DecodeExecutor> executor_;
  DecodeQueue decodes_;  // guarded by mutex_
};

}  // namespace stgs::player
