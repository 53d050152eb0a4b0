// SPDX-License-Identifier: Apache-2.0
// Plays a scene from wherever its bytes are: fetches what is about to be seen, decodes it, and says
// which moment to draw.
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

struct PlayerEvent {
  enum class Kind {
    kBuffering,  // playing, the moment stands still, because what is next has not come
    kResumed,    // it goes on after kBuffering
    kLooped,
    kEnded,
    kLayers,      // the number of layers at the moment has changed
    kRetry,       // a transfer failed and is tried again
    kReadFailed,  // a piece could not be read; it is tried again later
    kDamaged,     // a piece is not what was written; the picture lacks it
    // The file is another one now, or has lost what it had: what has not come will not, as long as
    // it is so. Told once, and again where it has been right meanwhile.
    kReplaced,
    // Of a recording that is followed:
    kStalled,  // nothing has been added to it for LiveSettings::stall_seconds; looked for further
    kSkipped,  // the moment was too far behind the edge, and has jumped to where it follows it
    kFinished  // it is closed: nothing more comes, and the clip has its end
  };
  Kind kind = Kind::kBuffering;
  double seconds = 0;  // the moment of the clip
  int layers = 0;      // of kLayers
  // Of kRetry, kLost, kDamaged, kReplaced and kStalled: byte of the file, what is wrong.
  std::uint64_t offset = 0;
  StatusCode code = StatusCode::kOk;
  std::string message;
};

// How a recording is followed while it grows (spec 5.12), where its source can grow: a file, a URL,
// or another that says so (ByteSource::may_grow). Its edge is the end of what is recorded.
struct LiveSettings {
  bool follow = true;  // false: what there is when it is opened is a clip like any other
  // How far behind the edge play is, seconds; further where stretches are longer, or come too
  // unevenly, for that without play standing still: 0 is as near as they let it be.
  double latency_seconds = 1;
  // Between looks whether there is more, about when it is due; less than 0.01 counts as that. Up to
  // 2 s where it does not come.
  double poll_seconds = 0.05;
  double stall_seconds = 5;  // without more, then kStalled is told
  // Further behind where it follows, play jumps there; nearer, its rate is up to a tenth more or
  // less until it is there.
  double skip_seconds = 3;
};

struct PlayerSettings {
  std::uint64_t memory_budget = kDefaultMemoryBudget;  // bytes, of what is fetched and decoded
  double prefetch_seconds = 10;  // of what is fetched before it is needed, at the rate of play
  double resume_seconds = 0.3;   // that must be there before play goes on after it has stood still
  // A layer's worth: how much further ahead a layer is fetched than the next.
  double layer_lead_seconds = 1;
  // Until what could not be read is tried again; after each failure twice as long, as far as 10 s.
  double retry_seconds = 1;
  int max_reads_in_flight = 4;  // at once
  LiveSettings live;
  HttpSettings http;  // of a URL
  // Told what transfers meet with while a URL is opened, by its threads, one at a time. Not set:
  // take_events() tells it once the file is open.
  std::function<void(const PlayerEvent&)> on_opening_event;
  ReadLimits limits;  // of the file
  // Of the file when it is opened; a larger one is refused before anything of it is read.
  std::uint64_t max_file_bytes = std::numeric_limits<std::int64_t>::max();
  // Decodes; outlives the player. Null: threads of our own.
  TaskRunner* task_runner = nullptr;
  // Of what is fetched and decoded, from several threads at once. Null: the heap.
  std::shared_ptr<std::pmr::memory_resource> memory;
};

inline constexpr double kMinRate = -2, kMaxRate = 4;
// Seconds between calls of Player::advance() that a moment follows; a longer step counts as one of
// these, so that play goes on from where it was after the caller has stood still.
inline constexpr double kMaxStepSeconds = 0.25;
inline constexpr std::size_t kMaxEvents = 1024;  // that are kept until they are taken

enum class PlayerState { kPaused, kPlaying, kBuffering, kEnded };

// Moments of the clip, seconds.
struct TimeRange {
  double begin = 0, end = 0;
};
struct TickRange {
  double begin = 0, end = 0;
};

// Where play is in a recording that grows.
struct LiveState {
  bool growing = false;     // more is expected; false: the clip has its end, and the rest is 0
  bool following = false;   // play keeps to the edge
  double edge_seconds = 0;  // the end of what is recorded, as far as is known
  // How far the moment is behind the edge, which is taken to move on steadily between what comes:
  // what a viewer is late by.
  double latency_seconds = 0;
  double target_latency_seconds = 0;  // how far it is to be
};

struct StreamStatistics {
  double bytes_per_second = 0;  // that the link has carried of late; 0: not known yet
  std::uint64_t fetched_bytes = 0;
  std::uint64_t memory_bytes = 0;       // of the budget
  std::uint64_t stored_primitives = 0;  // decoded and held
};

// A recording that grows is opened at its edge and followed (LiveSettings). To pause, to go to an
// earlier moment, or another rate than 1 ends that; go_live(), or play that reaches the edge,
// begins it again. Where play has no more to show it stands still until more comes, as anywhere
// (kBuffering). Closed, a recording is a clip like any other.
//
// Not thread-safe: one thread calls it, and one, which may be another, draws what timeline() has.
// Fetching and decoding have threads of their own, which the destructor ends.
class Player {
 public:
  // `place`: a path or a URL. Reads the head of the file. Errors: open_location's,
  // SceneReader::open's, settings out of range (kUsage), a file that is too large (kLimit).
  static Result<std::unique_ptr<Player>> open(const std::string& place,
                                              const PlayerSettings& settings = {});
  // The same of a source that is already open, which may answer as late as it likes. `interrupt`,
  // where given, must make its reads fail at once: the destructor calls it.
  static Result<std::unique_ptr<Player>> from_source(std::unique_ptr<ByteSource> source,
                                                     const PlayerSettings& settings = {},
                                                     std::function<void()> interrupt = {});
  virtual ~Player() = default;

  // What there is of the moment, without waiting: Timeline::at leaves out what has not come. As
  // long as the player.
  virtual Timeline& timeline() = 0;

  // From the end: from the beginning. Nothing happens while it plays, or is about to.
  virtual void play() = 0;
  virtual void pause() = 0;
  // To a moment, or to the beginning of a frame; the next advance() is there. kUsage: not a number,
  // or a frame that the clip does not have.
  virtual Status seek(double seconds) = 0;
  virtual Status seek_frame(std::uint32_t frame) = 0;
  // kMinRate to kMaxRate, not 0 (kUsage).
  virtual Status set_rate(double rate) = 0;
  // Counts once the clip has its end.
  virtual void set_loop(bool loop) = 0;
  // Follows the edge of a recording that grows, at rate 1; the next advance() is there. Nothing
  // happens where it does not grow.
  virtual void go_live() = 0;
  virtual LiveState live() const = 0;

  // The moment to draw at `now`, seconds of any clock that never goes back, kMaxStepSeconds on at
  // most (times the rate). The moment stands still where the base of the next has not come, and
  // jumps only where it is told to.
  virtual double advance(double now) = 0;

  virtual PlayerState state() const = 0;
  virtual double seconds() const = 0;
  // Whether all of layer 0 is there at the moment: what at() has is a picture of all the space.
  virtual bool ready() const = 0;
  // Layers that are there at the moment, and those that the file has: the tiers of its segments,
  // then their harmonics.
  virtual int layers() const = 0;
  virtual int layer_count() const = 0;
  // Whether nothing more of the moment is coming: what layers() lacks of it is damaged, was lost
  // and is yet to be tried again, or has no room in the memory budget.
  virtual bool is_complete() const = 0;
  // Where play does not have to wait: the base is there, or could not be had.
  virtual std::vector<TimeRange> buffered() const = 0;
  virtual StreamStatistics statistics() const = 0;
  // What has happened since the last call, in order; the last kMaxEvents of it.
  virtual std::vector<PlayerEvent> take_events() = 0;
};

}  // namespace stgs::player
