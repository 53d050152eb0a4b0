// SPDX-License-Identifier: Apache-2.0
#include "cpu/cpu_renderer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <new>
#include <utility>

#include "renderer_memory.h"
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

std::uint64_t pixels_of(const View& view) {
  return static_cast<std::uint64_t>(std::lround(view.camera.width)) *
         static_cast<std::uint64_t>(std::lround(view.camera.height));
}

// Returns the memory of images by their pixels, bytes: colour, alpha and depth of each, and
// transmittance and last splat of the largest one.
std::uint64_t image_bytes(const std::vector<std::uint64_t>& pixels) {
  std::uint64_t all = 0, largest = 0;
  for (const std::uint64_t one : pixels) {
    all += one;
    largest = std::max(largest, one);
  }
  return all * 5 * sizeof(float) + largest * (sizeof(float) + sizeof(std::uint32_t));
}

class CpuRenderer final : public Renderer {
 public:
  CpuRenderer() { splats_.memory = &memory_; }
  CpuRenderer(const CpuRenderer&) = delete;
  CpuRenderer& operator=(const CpuRenderer&) = delete;

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
    const Appearance appearance = appearance_of(timeline.metadata());
    try {
      const RenderStats before = sums;
      STGS_TRY(draw_within_limit(
          memory_, timeline, memory_.bytes() > 0,
          [&] {
            sums = before;
            return draw_views(active, views, appearance, sums);
          },
          [this] { return free_memory(); }));
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
  Status draw_views(const Timeline::Active& active, const std::vector<View>& views,
                    Appearance appearance, RenderStats& stats) {
    try {
      charge_images(views);
      frames_.resize(views.size());
      for (std::size_t i = 0; i < views.size(); ++i) {
        draw(active, views[i], appearance.kernel, frames_[i], stats);
        if (appearance.encoding != 0) to_output(appearance.encoding, frames_[i].colour);
      }
    } catch (const FrameTooLarge& e) {
      if (e.bytes == 0) throw;  // another limit
      return memory_.limit_error(e.what(), e.bytes);
    }
    return {};
  }

  // Charges the images of a frame.
  void charge_images(const std::vector<View>& views) {
    std::vector<std::uint64_t> held = image_pixels_;  // capacities of `frames_`
    held.resize(views.size());
    for (std::size_t i = 0; i < held.size(); ++i) held[i] = std::max(held[i], pixels_of(views[i]));
    if (image_bytes(held) > image_bytes_) {
      free_images();
      for (std::size_t i = 0; i < held.size(); ++i) held[i] = pixels_of(views[i]);
      const std::uint64_t bytes = image_bytes(held);
      if (!memory_.try_charge(bytes)) throw FrameTooLarge("the images", memory_.bytes() + bytes);
      image_bytes_ = bytes;
    }
    image_pixels_ = std::move(held);
  }

  void free_images() {
    frames_ = {};
    output_ = {};
    image_pixels_.clear();
    memory_.release(std::exchange(image_bytes_, 0));
  }

  Status free_memory() {
    free_images();
    splats_ = {};
    memory_.release(memory_.bytes());
    splats_.memory = &memory_;
    return {};
  }

  void draw(const Timeline::Active& active, const View& view, int kernel, Frame& frame,
            RenderStats& stats) {
    RasterSettings settings;
    settings.kernel = kernel;
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

  RendererMemory memory_;                    // outlives the following members
  std::vector<std::uint64_t> image_pixels_;  // of each image, at most
  std::uint64_t image_bytes_ = 0;            // charged for them
  std::vector<Frame> frames_;
  SplatFrame splats_;
  RasterOutput output_;
};

}  // namespace

std::unique_ptr<Renderer> make_cpu_renderer() {
  return std::make_unique<CpuRenderer>();
}

}  // namespace stgs::player
