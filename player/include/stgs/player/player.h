// SPDX-License-Identifier: Apache-2.0
// Plays a scene from a file, a URL or another byte source: fetches and decodes segments ahead of
// playback, and advances the playback position.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <memory_resource>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/task_runner.h"
#include "stgs/player/source.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

class StreamPlayer;  // implements Player

// Something that happened to a player, see Player::take_events().
struct PlayerEvent {
  enum class Kind {
    kBuffering,   // playback stalled: the data that it needs next is missing
    kResumed,     // playback resumed after kBuffering
    kLooped,      // playback wrapped around
    kEnded,       // playback reached the end
    kLayers,      // the number of layers available at the current position changed
    kRetry,       // a transfer failed and is being retried
    kReadFailed,  // a segment layer could not be read; the player retries it later
    kDamaged,     // a segment layer is corrupt; frames are rendered without it
    // The file was replaced, or lost data that it had. Missing segments cannot be fetched for as
    // long as that is so. Reported once, and again if the file was valid in between.
    kReplaced,
    // The following occur only for recordings that the player follows.
    kStalled,  // nothing was added for LiveSettings::stall_seconds; the player keeps polling
    kSkipped,  // the position was too far behind the live edge and jumped towards it
    kFinished  // the recording was closed: nothing more is added, and the duration is final
  };
  Kind kind = Kind::kBuffering;
  double seconds = 0;  // playback position when the event occurred
  int layers = 0;      // kLayers only: the new number of layers
  // The following are set for kRetry, kReadFailed, kDamaged, kReplaced and kStalled.
  std::uint64_t offset = 0;  // byte of the file
  StatusCode code = StatusCode::kOk;
  std::string message;
};

// How the player follows a growing recording (spec 9). Only sources that may grow are followed:
// files, URLs and sources for which ByteSource::may_grow() is true. The live edge is the end of the
// recorded data.
struct LiveSettings {
  // False: the data present when the source is opened is played as a finished clip.
  bool follow = true;
  // Minimum latency behind the live edge, seconds. The player increases it to the length of a
  // fragment plus the jitter of their arrival, so that playback does not stall; 0 is the smallest
  // latency that avoids stalls.
  double latency_seconds = 1;
  // Interval between polls when the next fragment is due; clamped to at least 0.01 s. Grows up to
  // 2 s while nothing arrives.
  double poll_seconds = 0.05;
  double stall_seconds = 5;  // without new data before kStalled is reported
  // If the position falls further behind its target than this, it jumps to the target. Otherwise
  // the rate is changed by up to 10 % until the position catches up.
  double skip_seconds = 3;
};

// Settings of a player. Times are finite and not negative.
struct PlayerSettings {
  std::uint64_t memory_budget = kDefaultMemoryBudget;  // bytes of fetched and decoded data
  // Bytes of the budget that a decoded segment takes besides its primitives.
  std::uint64_t segment_overhead = 0;
  double prefetch_seconds = 10;   // fetched ahead of the position, seconds at the current rate
  double resume_seconds = 0.3;    // of data required before stalled playback resumes
  double layer_lead_seconds = 1;  // how much further ahead each layer is fetched than the next one
  // Delay before a failed read is retried. Doubles with each failure, up to 10 s.
  double retry_seconds = 1;
  int max_reads_in_flight = 4;  // 1 to 64
  LiveSettings live;
  HttpSettings http;  // for URLs
  // Receives transfer events while a URL is being opened, from the player's threads, one call at a
  // time. If it is not set, take_events() returns these events once the file is open.
  std::function<void(const PlayerEvent&)> on_opening_event;
  ReadLimits limits;
  // A file larger than this when it is opened is rejected before any of it is read.
  std::uint64_t max_file_bytes = std::numeric_limits<std::int64_t>::max();
  TaskRunner* task_runner = nullptr;  // runs decoding; outlives the player; null: internal threads
  // Allocates fetched and decoded data, from several threads at once. Null: the heap; up to 32 MiB
  // of it that are freed are kept for all players of the process.
  std::shared_ptr<std::pmr::memory_resource> memory;
};

inline constexpr double kMinRate = -2, kMaxRate = 4;
// Largest step of the position per call of Player::advance(), seconds at rate 1. If more time has
// passed, playback resumes where it was instead of jumping ahead.
inline constexpr double kMaxStepSeconds = 0.25;
inline constexpr std::size_t kMaxEvents = 1024;  // queued for take_events(); older ones are dropped

enum class PlayerState {
  kPaused,     // the position does not change
  kPlaying,    // the position advances
  kBuffering,  // playing, but the data that is needed next is missing
  kEnded       // playback reached the end
};

// A range of clip time, seconds.
struct TimeRange {
  double begin = 0, end = 0;
};

// State of live playback. Everything but `growing` is 0 unless the recording is growing.
struct LiveState {
  bool growing = false;     // more data is expected; false: the duration is final
  bool following = false;   // playback follows the live edge
  double edge_seconds = 0;  // end of the recorded data that the player knows of
  // Distance from the position to the live edge, which is assumed to advance steadily between
  // fragments: the delay that a viewer experiences.
  double latency_seconds = 0;
  double target_latency_seconds = 0;  // the latency that playback converges to
};

// Transfer and memory statistics of a player.
struct StreamStatistics {
  double bytes_per_second = 0;  // recent throughput; 0: not yet known
  std::uint64_t fetched_bytes = 0;
  std::uint64_t memory_bytes = 0;       // of the memory budget in use
  std::uint64_t stored_primitives = 0;  // decoded and resident
};

// Plays a scene. A growing recording opens at its live edge and is followed (LiveSettings).
// Pausing, seeking to an earlier time or setting a rate other than 1 ends that; go_live(), or
// playback that reaches the edge, starts it again. Playback that runs out of data buffers until
// more arrives. Once closed, a recording is a clip like any other.
//
// Not thread-safe: one thread calls the player, and one thread, possibly another, uses timeline().
// Fetching and decoding run on internal threads, which the destructor joins.
class Player {
 public:
  // Opens a path or URL and reads the head of the file. Errors: those of open_location() and
  // SceneReader::open(); kUsage for settings out of range, kLimit for a file that is too large.
  static Result<std::unique_ptr<Player>> open(const std::string& location,
                                              const PlayerSettings& settings = {});
  // Opens a source, whose reads may block for any time. The destructor calls `interrupt`, if given,
  // which must make pending and later reads fail at once.
  static Result<std::unique_ptr<Player>> from_source(std::unique_ptr<ByteSource> source,
                                                     const PlayerSettings& settings = {},
                                                     std::function<void()> interrupt = {});
  // Used by the functions above.
  explicit Player(std::unique_ptr<StreamPlayer> impl);
  // Joins the internal threads; pending reads are interrupted.
  ~Player();
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  // Returns the data that is resident, without waiting: Timeline::at() omits segments that have not
  // arrived. Lives as long as the player.
  Timeline& timeline();

  // Starts playback. At the end in the direction of playback, starts from the other end. Does
  // nothing if already playing.
  void play();
  // Pauses playback.
  void pause();
  // Seeks to a time in seconds, clamped to the clip. The next advance() returns that position.
  // kUsage if it is not finite.
  Status seek(double seconds);
  // Seeks to the beginning of a frame. kUsage if the clip has no such frame.
  Status seek_frame(std::uint32_t frame);
  // Sets the rate: kMinRate to kMaxRate and not 0, else kUsage. Negative rates play backwards.
  Status set_rate(double rate);
  // Enables or disables looping, which takes effect once the duration is final.
  void set_loop(bool loop);
  // Follows the live edge of a growing recording at rate 1, from the next advance() on. Does
  // nothing if the recording does not grow.
  void go_live();
  // Returns the state of live playback.
  LiveState live() const;

  // Advances playback to `now`, in seconds of any monotonic clock, and returns the position to
  // render. Moves by at most kMaxStepSeconds times the rate. The position stays where it is while
  // the base layer of the next one is missing, and jumps only on request.
  double advance(double now);

  // Returns the playback state.
  PlayerState state() const;
  // Returns the playback position, seconds.
  double seconds() const;
  // Returns whether all of layer 0 is available at the position, so that a frame covers all space.
  bool ready() const;
  // Returns the number of layers that are completely available at the position.
  int layers() const;
  // Returns the number of layers in the file: one per tier for the bases of its segments, then one
  // per tier for their spherical harmonics.
  int layer_count() const;
  // Returns whether nothing more will arrive for the position: every layer missing there is
  // damaged, waits to be retried after a failed read, or does not fit the memory budget.
  bool is_complete() const;
  // Returns the ranges that play without waiting, ascending: their base layer is available or could
  // not be read.
  std::vector<TimeRange> buffered() const;
  // Returns transfer and memory statistics.
  StreamStatistics statistics() const;
  // Returns the events since the last call, oldest first; at most the last kMaxEvents.
  std::vector<PlayerEvent> take_events();

 private:
  std::unique_ptr<StreamPlayer> impl_;
};

}  // namespace stgs::player
