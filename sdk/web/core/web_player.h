// SPDX-License-Identifier: Apache-2.0
// A player for a page: the shared player without threads. Workers of the host decode the segments.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "page_transport.h"
#include "provided_source.h"
#include "stgs/player/player.h"
#include "stream/stream_player.h"
#include "worker_executor.h"

namespace stgs::web {

// One thread.
class WebPlayer {
 public:
  // A change of the segments that the page should hold.
  struct Change {
    std::uint32_t segment = 0;
    std::uint32_t decoded = 0;  // id of WorkerExecutor; 0: the segment is no longer needed
    double begin = 0, end = 0;  // ticks of the timeline at which it is needed
    double origin = 0;          // ticks of the timeline from which its times count
  };

  // `follows`: whether to follow the growth of a file that is being recorded, `latency_seconds`
  // behind its live edge (LiveSettings).
  WebPlayer(const std::string& name, std::uint64_t file_bytes, bool follows, double latency_seconds,
            std::uint64_t memory_budget, std::uint64_t max_primitives, double prefetch_seconds,
            int decodes);

  // Opens the file. While source().is_pending(), provide() the missing bytes and call it again.
  Status open();
  ProvidedSource& source() { return *provided_; }

  // The player; open() has succeeded.
  player::StreamPlayer& player() { return *player_; }
  PageTransport& transport() { return *transport_; }
  WorkerExecutor& executor() { return *executor_; }
  // The file, as far as known now.
  const SceneReader& reader() const { return *reader_; }

  // Advances playback to `now` and begins reads and decodings, for at most about `budget` seconds.
  // Returns when to call it again, seconds after `now`; infinity: after stgs_read_done(),
  // stgs_decode_done() or a command.
  double step(double now, double budget);
  // A read of the host has ended, with a message if it failed; `file_bytes`: size of the file.
  void read_done(std::uint32_t id, const std::string& failure, std::uint64_t file_bytes,
                 double now);
  // Returns the next change that the last step() has found; nothing if there is none.
  std::optional<Change> next_change();
  // Returns StreamPlayer::buffered(), of many ranges the present one and the longest.
  std::vector<player::TimeRange> buffered() const;

 private:
  // Adopts the reader of the player, and starts to read the bytes that it needs.
  void read_index();
  void find_changes();
  // Returns the decoded segments that the page should hold now.
  std::vector<player::Timeline::SegmentRef> wanted();
  Change added(const player::Timeline::SegmentRef& ref) const;

  const player::PlayerSettings settings_;
  const std::uint64_t max_primitives_;  // when it is opened, see StreamPlayer::limit_primitives()
  const int decodes_;                   // segments that the host decodes at a time
  const std::shared_ptr<Budget> budget_;
  std::shared_ptr<player::RangeSource> ranges_;
  ProvidedSource* provided_ = nullptr;  // of `ranges_`
  player::IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  std::vector<std::uint8_t> index_bytes_;  // of a read in progress
  std::uint32_t index_read_ = 0;           // its id, 0: there is none
  std::uint64_t index_offset_ = 0;         // its first byte
  PageTransport* transport_ = nullptr;     // of `player_`
  WorkerExecutor* executor_ = nullptr;     // of `player_`
  std::unique_ptr<player::StreamPlayer> player_;
  // The next ones last; without a set: to drop.
  std::vector<player::Timeline::SegmentRef> changes_;
  // The version of each segment that the page holds.
  std::map<std::uint32_t, std::weak_ptr<const Gaussians4D>> sent_;
};

}  // namespace stgs::web
