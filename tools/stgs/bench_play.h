// SPDX-License-Identifier: Apache-2.0
// Playing a scene in order against the clock of a display.
#pragma once

#include <memory>
#include <string>

#include "bench_measure.h"
#include "stgs/format/byte_source.h"
#include "stgs/player/renderer.h"
#include "stgs/player/timeline.h"

namespace stgs::tools {

struct PlaySettings {
  int frames = 300;      // of the clip, from its beginning, which follows its end
  double refresh = 100;  // pictures a second
  double rate = 1;       // of play
};

// What a clip is played through.
class MeasuredPlayback {
 public:
  virtual ~MeasuredPlayback() = default;
  virtual player::Timeline& timeline() = 0;
  // The moment to draw `passed` seconds after play began; at 0 waits until it can begin.
  // kIo where what it begins with is lost, kRuntime where nothing comes for a minute.
  virtual Result<double> advance(double passed) = 0;
  // Whether it stood still at the last moment, for want of what is next.
  virtual bool waits() const = 0;
  // Whether all layers of the last moment had come.
  virtual bool is_whole() const = 0;
  // Warns of what has happened since the last call, and counts it where it was lost.
  virtual int tell(Session& session) = 0;
};

// "timeline": a moment's segments are decoded when it is drawn, by the renderer's device.
std::unique_ptr<MeasuredPlayback> playback_of(std::unique_ptr<player::Timeline> timeline,
                                              double rate);
// "player": fetched and decoded ahead, by threads of the processor.
Result<std::unique_ptr<MeasuredPlayback>> playback_of(std::unique_ptr<ByteSource> source,
                                                      std::uint64_t memory_budget, double rate);

struct Played {
  Pass pass;            // the pictures that were drawn
  int pictures = 0;     // of the display
  int missed = 0;       // of these: not ready when the next was due
  int waited = 0;       // of these: play stood still
  int incomplete = 0;   // of these: drawn, but without all that the file has of the moment
  int lost = 0;         // times that a piece of the file could not be read
  double start_ms = 0;  // until the first picture, drawn before the clock starts
  double seconds = 0;   // from then on
};

// Draws a picture of `views` each 1 / refresh seconds; but for the first, one that is late is left
// out, as by a display. `file` is for messages. kUsage where these are more than 10^7 pictures.
Result<Played> play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer,
                    const std::vector<player::View>& views, const PlaySettings& settings,
                    const std::string& file);

Json to_json(const Played& played, const PlaySettings& settings);
std::string to_text(const Played& played, const PlaySettings& settings);

}  // namespace stgs::tools
