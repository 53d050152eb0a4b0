// SPDX-License-Identifier: Apache-2.0
// Benchmarks playback in order, against the clock of a display.
#pragma once

#include <memory>
#include <string>

#include "bench_measure.h"
#include "stgs/format/byte_source.h"
#include "stgs/player/renderer.h"
#include "stgs/player/timeline.h"

namespace stgs::tools {

struct PlaySettings {
  int frames = 300;      // of the clip, from its beginning; the clip repeats
  double refresh = 100;  // display refreshes per second
  double rate = 1;       // playback rate
};

// The decoding pipeline under test.
class MeasuredPlayback {
 public:
  virtual ~MeasuredPlayback() = default;
  virtual player::Timeline& timeline() = 0;
  // Returns the time to render `passed` seconds after playback began. The first call, at 0, blocks
  // until playback can begin: kIo if its first data cannot be read, kRuntime if nothing arrives.
  virtual Result<double> advance(double passed) = 0;
  // Returns whether playback was buffering after the last advance().
  virtual bool is_buffering() const = 0;
  // Returns whether all layers of the last time were resident.
  virtual bool is_complete() const = 0;
  // Logs the events since the last call as warnings. Returns how many of them were failed reads.
  virtual int report_events(Session& session) = 0;
};

// "timeline": segments are decoded when a frame is rendered, on the device of the renderer.
std::unique_ptr<MeasuredPlayback> playback_of(std::unique_ptr<player::Timeline> timeline,
                                              double rate);
// "player": segments are fetched and decoded ahead, on CPU threads.
// `timeout`: without data, after which playback fails to begin, seconds.
Result<std::unique_ptr<MeasuredPlayback>> playback_of(std::unique_ptr<ByteSource> source,
                                                      std::uint64_t memory_budget, double rate,
                                                      double timeout);

struct Played {
  Pass pass;             // timings of the rendered frames
  int refreshes = 0;     // of the display
  int missed = 0;        // refreshes without a new frame, because the frame was late
  int stalled = 0;       // refreshes at which playback was buffering
  int incomplete = 0;    // frames rendered without all layers of their time
  int failed_reads = 0;  // of pieces of the file
  double start_ms = 0;   // until the first frame, which is rendered before the clock starts
  double seconds = 0;    // from then on
};

// Renders a frame of `views` every 1 / refresh seconds. Late frames are dropped, as by a display,
// except the first. `file` is for messages. kUsage for more than 10^7 refreshes.
Result<Played> play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer,
                    const std::vector<player::View>& views, const PlaySettings& settings,
                    const std::string& file);

Json to_json(const Played& played, const PlaySettings& settings);
std::string to_text(const Played& played, const PlaySettings& settings);

}  // namespace stgs::tools
