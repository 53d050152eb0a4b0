// SPDX-License-Identifier: Apache-2.0
#include "cpu/cpu_renderer.h"

#include <chrono>
#include <exception>
#include <new>
#include <utility>

#include "stgs/format/parallel.h"
#include "views.h"

namespace stgs::player {
namespace {

using Clock = std::chrono::steady_clock;

// Returns the milliseconds since `start` and sets `start` to now.
double lap(Clock::time_point& start) {
  const auto now = Clock::now();
  const double ms = std::chrono::duration<double, std::milli>(now - start).count();
  start = now;
  return ms;
}

// Converts an image in the encoding of its scene to sRGB.
void to_output(int encoding, Image& colour) {
  const std::size_t pixels =
      static_cast<std::size_t>(colour.width) * static_cast<std::size_t>(colour.height);
  float *red = colour.plane(0), *green = colour.plane(1), *blue = colour.plane(2);
  parallel_for(std::size_t{0}, static_cast<std::size_t>(colour.height), [&](std::size_t y) {
    const std::size_t width = pixels / static_cast<std::size_t>(colour.height);
    for (std::size_t p = y * width; p < (y + 1) * width; ++p) {
      const math::Vec3 shown = math::displayed({red[p], green[p], blue[p]}, encoding);
      red[p] = shown.x;
      green[p] = shown.y;
      blue[p] = shown.z;
    }
  });
}

class CpuRenderer final : public Renderer {
 public:
  std::string name() const override { return "cpu"; }

  Status draw(Timeline& timeline, double seconds, const std::vector<View>& views,
              RenderStats* stats) override {
    STGS_TRY(check_views(views, timeline));
    RenderStats sums;
    auto clock = Clock::now();
    STGS_ASSIGN(const Timeline::Active active, timeline.at(seconds));
    sums.fetch_ms = lap(clock);
    sums.stored = timeline.stored_primitives();
    for (const auto& one : active.segments) sums.active += one.candidates->size();
    try {
      frames_.resize(views.size());
      const int encoding = encoding_of(timeline.metadata());
      for (std::size_t i = 0; i < views.size(); ++i) {
        draw(active, views[i], frames_[i], sums);
        if (encoding != 0) to_output(encoding, frames_[i].colour);
      }
    } catch (const std::bad_alloc&) {
      return {StatusCode::kNoMemory,
              fmt::format("{}: cannot render {} s: out of memory", timeline.name(), seconds)};
    } catch (const std::exception& e) {
      return runtime_error("{}: cannot render {} s: {}", timeline.name(), seconds, e.what());
    }
    if (stats != nullptr) *stats = sums;
    return {};
  }

  // Swaps buffers instead of copying: the caller's become those of the next draw().
  Status read(std::vector<Frame>& frames) override {
    frames.resize(frames_.size());
    frames.swap(frames_);
    return {};
  }

 private:
  void draw(const Timeline::Active& active, const View& view, Frame& frame, RenderStats& stats) {
    RasterSettings settings;
    settings.background = view.background;
    if (view.fovea) settings.fovea = fovea_of(view);
    auto clock = Clock::now();
    begin_frame(view.camera, splats_);
    for (const auto& one : active.segments) {
      slice(*one.set, *one.candidates, one.ticks, view.camera, settings, one.id_base, splats_);
    }
    stats.slice_ms += lap(clock);
    bin(splats_);
    stats.bin_ms += lap(clock);
    // Blends into the buffers of the frame.
    std::swap(output_.colour, frame.colour);
    std::swap(output_.alpha, frame.alpha);
    std::swap(output_.depth, frame.depth);
    blend(splats_, settings, output_);
    std::swap(output_.colour, frame.colour);
    std::swap(output_.alpha, frame.alpha);
    std::swap(output_.depth, frame.depth);
    stats.blend_ms += lap(clock);
    stats.splats += splats_.splats.size();
  }

  std::vector<Frame> frames_;
  SplatFrame splats_;
  RasterOutput output_;
};

}  // namespace

std::unique_ptr<Renderer> make_cpu_renderer() {
  return std::make_unique<CpuRenderer>();
}

}  // namespace stgs::player
