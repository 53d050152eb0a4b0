// SPDX-License-Identifier: Apache-2.0
// A player for a page: the shared player without threads, whose segments are packed for the GPU and
// handed to the host in parts.
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

namespace stgs::web {

// One thread.
class WebPlayer {
 public:
  // A change of the segments that the page should hold.
  struct Change {
    std::uint32_t id = 0;          // of a part of a segment
    std::uint32_t primitives = 0;  // 0: the part is no longer needed
    double begin = 0, end = 0;     // ticks of the timeline at which it is needed
    double origin = 0;             // ticks of the timeline from which its times count
    int sh_degree = 0;
    std::vector<std::uint8_t> packed;  // as packed_segment.h states
  };

  WebPlayer(const std::string& name, std::uint64_t file_bytes, std::uint64_t memory_budget,
            double prefetch_seconds);

  // Opens the file. kIo while bytes are missing: provide() those of missing() and call it again.
  Status open();
  ProvidedSource& source() { return *provided_; }

  // The player; open() has succeeded.
  player::StreamPlayer& player() { return *player_; }
  PageTransport& transport() { return *transport_; }
  const SceneReader& reader() const { return *reader_; }

  // Advances playback to `now` and fetches and decodes for at most about `budget` seconds, one
  // segment at least. Returns when to call it again, seconds after `now`; infinity: after
  // stgs_read_done() or a command.
  double step(double now, double budget);
  // Returns the next change; nothing if there is none. Valid until the next call.
  const Change* next_change();

 private:
  // Primitives of a part: its packed data take at most 11 MB.
  static constexpr std::uint32_t kPartPrimitives = 1 << 16;
  // Ids of parts: 4096 of a segment.
  static constexpr std::uint32_t kPartsPerSegment = 1 << 12;
  static constexpr std::size_t kMaxSegments = std::size_t{1} << 20;

  // A segment that the page holds, in the version `set`.
  struct Sent {
    std::weak_ptr<const Gaussians4D> set;
    std::uint32_t parts = 0;
  };
  struct Pending {
    std::uint32_t segment = 0;
    std::shared_ptr<const Gaussians4D> set;
    std::uint32_t part = 0;  // the next one
    double origin = 0;
  };

  // Finds the next segment to send, or those to drop.
  void find_changes();
  // Returns the decoded segments that the page should hold now.
  std::vector<player::Timeline::SegmentRef> wanted();
  void drop(std::uint32_t segment, std::uint32_t first_part, std::uint32_t end_part);
  void pack_part();

  const player::PlayerSettings settings_;
  const std::shared_ptr<Budget> budget_;
  std::shared_ptr<player::RangeSource> ranges_;
  ProvidedSource* provided_ = nullptr;  // of `ranges_`
  player::IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  PageTransport* transport_ = nullptr;  // of `player_`
  std::unique_ptr<player::StreamPlayer> player_;
  std::map<std::uint32_t, Sent> sent_;  // by segment
  std::vector<std::uint32_t> dropped_;  // parts
  std::optional<Pending> pending_;      // being packed
  Change change_;
};

}  // namespace stgs::web
