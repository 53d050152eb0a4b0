// SPDX-License-Identifier: Apache-2.0
// Fetches and decodes, ahead of a viewer, what he is about to see, within a budget of memory.
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
#include "stream/event_queue.h"
#include "stream/need.h"
#include "stream/piece_source.h"
#include "stream/throughput.h"

namespace stgs::player {

// All may be called from any thread; none waits for a transfer, but the destructor for those that
// are under way.
class SegmentStore {
 public:
  // `source` is the one of `reader`. `on_changed` is told, by a thread of the store, whether a file
  // that is not followed is another than it was, when that changes; it does not throw.
  SegmentStore(std::shared_ptr<const SceneReader> reader, std::shared_ptr<RangeSource> source,
               const PlayerSettings& settings, std::function<void(bool)> on_changed);
  ~SegmentStore();
  // Begins nothing any more. What is under way ends by itself, or by who interrupts the source.
  void stop();
  SegmentStore(const SegmentStore&) = delete;
  SegmentStore& operator=(const SegmentStore&) = delete;

  // A reader of the file as it is known now. Another generation: its segments are not those that
  // there were, and more; all that was held of these has gone.
  struct Known {
    std::shared_ptr<const SceneReader> reader;
    std::uint64_t generation = 0;
  };
  Known known() const;
  // The file has grown: `reader` is one of what it is now. Where that throws, it has not.
  void grow(std::shared_ptr<const SceneReader> reader);
  int tiers() const;
  std::uint64_t memory_budget() const { return settings_.memory_budget; }

  // Where the viewer is now; nothing is fetched before it is known. `jumped`: not where he was
  // about to come.
  void move(const Playhead& motion, bool jumped);
  Playhead motion() const;

  // What is there of a segment of that generation, or null.
  std::shared_ptr<const ResidentSegment> held(std::uint32_t segment,
                                              std::uint64_t generation) const;
  // Whether nothing of layer 0 at this moment is still to come.
  bool ready(double ticks) const;
  // The moments around which nothing of layer 0 is still to come, ascending, apart from each other.
  std::vector<TickRange> ready_ranges() const;
  // Layers of which all is there at a moment, from 0 on.
  int layers(double ticks) const;
  // Whether nothing more of a moment comes as long as the viewer is there.
  bool settled(double ticks) const;
  StreamStatistics statistics() const;
  // What damage has taken so far.
  std::vector<SegmentDamage> segment_damage() const;
  // What has happened since the last call.
  std::vector<PlayerEvent> take_events();
  // Adds one, at the moment of the motion.
  void tell(PlayerEvent event) noexcept;

 private:
  enum class At { kAway, kComing, kHere, kLost };  // kLost: not to be had, for now or for ever
  struct PieceState {
    At at = At::kAway;
    double retry = 0;          // of kLost: when to try again
    double patience = 0;       // how long the last wait for it was, seconds; 0: none
    std::uint64_t memory = 0;  // that is counted for it
  };
  struct Entry {
    PieceState base, harmonics;
    bool decoding = false, with_harmonics = false;  // the latter: of `held`
    std::shared_ptr<const ResidentSegment> held;
  };
  struct PlacedPiece {
    Piece piece;
    std::uint64_t offset = 0, bytes = 0;
  };
  // Pieces that are asked for at once: they follow each other in the file.
  struct Run {
    std::uint64_t offset = 0, bytes = 0;
    std::vector<PlacedPiece> pieces;
    std::uint64_t jumps = 0;  // when it began
    double begun = 0;
    std::uint64_t generation = 0;
  };
  using Runs = std::list<Run>;
  // What is being decoded.
  struct UnderWay {
    int segments = 0, ahead = 0;  // ahead: that are not needed yet
    std::uint64_t bytes = 0;      // of memory that they are counted with
    UnderWay with(const UnderWay& o) const {
      return {segments + o.segments, ahead + o.ahead, bytes + o.bytes};
    }
    UnderWay without(const UnderWay& o) const {
      return {segments - o.segments, ahead - o.ahead, bytes - o.bytes};
    }
  };

  PieceState& state(const Piece& piece) {
    return piece.harmonics ? entries_[piece.segment].harmonics : entries_[piece.segment].base;
  }
  const PieceState& state(const Piece& piece) const {
    return piece.harmonics ? entries_[piece.segment].harmonics : entries_[piece.segment].base;
  }
  std::uint64_t piece_bytes(const Piece& piece) const;
  std::uint64_t piece_offset(const Piece& piece) const;
  std::uint64_t memory_of(const Piece& piece) const;  // that it takes, decoded too
  Need need_for(const Piece& piece) const;
  double urgency_of(const Piece& piece) const;
  bool base_settled(std::uint32_t segment) const;  // here and decoded, or lost so far
  bool harmonics_settled(std::uint32_t segment) const;
  bool has_no_room(const Piece& piece) const;

  bool goes_on(const SceneReader& reader) const;
  void take_reader(std::shared_ptr<const SceneReader> reader);
  void forget_segments();
  void start_threads();
  void start_more_decoders();
  void run_thread(void (SegmentStore::*work)());
  void count(const Piece& piece, std::uint64_t memory);  // that it takes from now on
  void hold(std::uint32_t segment, std::shared_ptr<const ResidentSegment> held);
  void release(const Piece& piece, At at);
  bool can_drop(std::uint32_t segment) const;
  bool make_room(std::uint64_t bytes, double urgency);
  void drop(std::uint32_t segment);
  void drop_harmonics(std::uint32_t segment) noexcept;
  void add_event(PlayerEvent event) noexcept;
  void lose(const Piece& piece, bool for_ever, PlayerEvent::Kind kind,
            const Status& status) noexcept;

  // segment_fetch.cpp
  void fetch_pieces();
  // Seconds: what is needed later is not fetched yet. As far as play asks for before it goes on.
  double farthest_ahead() const {
    return std::max(settings_.prefetch_seconds, settings_.resume_seconds);
  }
  std::size_t place_of(const Piece& piece) const {
    return places_[2 * std::size_t{piece.segment} + (piece.harmonics ? 1 : 0)];
  }
  std::vector<std::size_t> pieces_ahead() const;
  bool wanted(const Piece& piece, double now) const;
  bool in_time(const Piece& piece) const;
  bool is_waited_for(double now) const;
  std::optional<Piece> next_piece(double now) const;
  bool next_run(double now, Runs& taken);
  bool take(const Piece& piece, double urgency);
  bool is_decoding() const;
  void extend(Run& run, double urgency, double now);
  std::size_t stretch_of(const Run& run) const;
  bool given_up(const Run& run) const;
  bool is_needless(const Run& run, std::uint64_t from) const;
  Status fetch(const Run& run, std::vector<std::uint8_t>& bytes);
  void put(const Run& run, std::span<const std::uint8_t> bytes);
  void settle(const Run& run, bool came, const Status& status) noexcept;
  bool is_followed() const;
  void note_change(bool changed) noexcept;
  void give_back(const Run& run) noexcept;

  // segment_decoding.cpp
  void decode_segments();
  std::optional<std::uint32_t> next_decode() const;
  bool is_ahead(std::uint32_t segment) const;  // not needed at the viewer's moment
  bool may_begin(std::uint32_t segment) const;
  Status decode(const SceneReader& reader, std::uint32_t segment, bool with_harmonics,
                std::shared_ptr<const ResidentSegment>& held, Status& harmonics) const;
  void take_decoded(std::uint32_t segment, bool with_harmonics,
                    std::shared_ptr<const ResidentSegment> held, const Status& base,
                    const Status& harmonics) noexcept;
  bool note_loss(const Piece& piece, const Status& status) noexcept;

  const std::shared_ptr<RangeSource> source_;
  const PlayerSettings settings_;
  const std::function<void(bool)> on_changed_;
  int decoders_ = 1;  // segments that are decoded at once, at most

  mutable std::mutex mutex_;  // of all that follows
  std::shared_ptr<const SceneReader> reader_;
  std::uint64_t generation_ = 0;  // how often its segments were not those before, and more
  int tiers_ = 1;
  std::vector<Piece> in_file_;       // all, by offset
  std::vector<std::size_t> places_;  // in in_file_: of a segment's base, of its harmonics
  std::condition_variable to_fetch_, to_decode_;
  bool stopping_ = false;
  bool is_changed_ = false;    // as on_changed_ was told
  double doubtful_until_ = 0;  // what comes until then may be of another file, clock seconds
  std::uint64_t jumps_ = 0;
  bool is_placed_ = false;  // motion_ is the viewer's
  Playhead motion_;
  std::vector<Entry> entries_;  // by segment
  UnderWay under_way_;
  bool is_full_ = false;  // something found no room: what decoding leaves may be enough
  Runs running_;          // under way
  std::uint64_t memory_ = 0;
  // Nothing as urgent as this or later found room when nothing was under way.
  double full_from_ = std::numeric_limits<double>::infinity();
  Throughput throughput_;
  std::uint64_t fetched_bytes_ = 0, stored_primitives_ = 0;
  EventQueue events_;
  std::vector<SegmentDamage> losses_;
  std::vector<std::thread> threads_;
};

}  // namespace stgs::player
