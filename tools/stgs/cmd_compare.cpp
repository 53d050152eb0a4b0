// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "camera_file.h"
#include "command.h"
#include "end_after_signal.h"
#include "image_io.h"
#include "lpips_option.h"
#include "memory_option.h"
#include "options.h"
#include "scene_input.h"
#include "stgs/encoder/metrics.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {
namespace {

constexpr double kSameDuration = 1e-6;  // seconds
constexpr const char* kIncomplete = "the comparison is not complete";

struct Difference {
  double mse = 0, ssim = 0, max = 0;
  double lpips = 0;  // with a network
};

Result<Difference> difference(const Image& a, const Image& b, const encoder::Lpips* lpips) {
  Difference d;
  if (lpips != nullptr) {
    STGS_ASSIGN(d.lpips, lpips->distance(a, b));
  }
  d.mse = encoder::mean_squared_error(a, b);
  d.max = encoder::max_difference(a, b);
  STGS_ASSIGN(const encoder::Ssim similarity, encoder::ssim(a, b));
  d.ssim = similarity.range_1;
  return d;
}

// Bytes per pixel of an image, and of a frame in a renderer: RGB, alpha, depth and their
// intermediate values.
constexpr std::uint64_t kImageBytes = 3 * sizeof(float), kFrameBytes = 29;

Status limit_error(const std::string& name, int width, int height, std::uint64_t bytes,
                   std::uint64_t memory) {
  return {
      StatusCode::kLimit,
      fmt::format("{}: comparing images of {}x{} pixels needs {}, more than the memory limit of "
                  "{}; compare smaller images (--camera for scenes), or allow more memory",
                  name, width, height, human_bytes(bytes), human_bytes(memory))};
}

// Returns the memory of the metrics for images of this size.
std::uint64_t metric_bytes(int width, int height, const encoder::Lpips* lpips) {
  const std::uint64_t of_lpips = lpips == nullptr ? 0 : lpips->working_bytes(width, height);
  return std::max(encoder::ssim_bytes(width), of_lpips);
}

// Returns a third of the memory that is left beside an image of the first scene and the metrics:
// for the segments of each scene, and for the renderer that is at work. kLimit if it is too little
// for the frames of the renderer. `name`: where the camera is from.
Result<std::uint64_t> third_of_memory(std::uint64_t memory, const encoder::Camera& camera,
                                      const encoder::Lpips* lpips, const std::string& name) {
  const std::uint64_t pixels = static_cast<std::uint64_t>(camera.width) * camera.height;
  const std::uint64_t images =
      kImageBytes * pixels + metric_bytes(camera.width, camera.height, lpips);
  const std::uint64_t needed = images + 3 * kFrameBytes * pixels;
  if (needed > memory) return limit_error(name, camera.width, camera.height, needed, memory);
  return (memory - images) / 3;
}

class Compare final : public Command {
 public:
  Help help() const override {
    return {
        "compare", "Measure the difference between two images or two .stgs files",
        "Compares two images (PNG, JPEG, EXR), or renders two .stgs files from the start camera\n"
        "of the first, or from --camera, at several times. Prints psnr (of the pooled error, at\n"
        "most 100), ssim (as evaluate), the largest difference of a channel in [0,1] and, with\n"
        "--lpips, the mean LPIPS (smaller is better). Exit\n"
        "code 7 if psnr is below --min-psnr, if the images differ in size, or if the scenes\n"
        "differ in duration.",
        "  stgs compare a.png b.png\n  stgs compare lossless.stgs packed.stgs --min-psnr 40"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "Renderer", .threads = true, .urls = true};
  }
  void declare(Arguments& app) override {
    app.add_option("A", a_, "An image, or a .stgs file: a path, a URL, or - for standard input")
        ->required();
    app.add_option("B", b_, "The image or .stgs file to compare with")->required();
    app.add_option("--min-psnr", min_psnr_, "Exit code 7 if psnr is below this, dB")
        ->check(number_between(0, encoder::kPsnrMax));
    app.add_option("--camera", camera_, "For .stgs files: camera file (JSON), as for render");
    app.add_option("--num-frames", num_frames_, "For .stgs files: number of frames, evenly spaced")
        ->check(number_between(1, 1000))
        ->capture_default_str();
    lpips_.declare(app);
    memory_.declare(app);
  }

  Status run(Session& session) override {
    const bool images = is_image_name(a_);
    if (images != is_image_name(b_)) {
      return usage_error("{} and {}: cannot compare an image with a .stgs file", display_name(a_),
                         display_name(b_));
    }
    const EndAfterSignal end(session, kIncomplete);
    STGS_TRY(lpips_.open());
    return images ? compare_images(session) : compare_scenes(session);
  }

 private:
  Status compare_images(Session& session) {
    STGS_ASSIGN(Image a, read_image(a_, memory_.bytes()));
    STGS_TRY(lpips_.check(a.width, a.height, memory_.bytes(), a_));
    const std::uint64_t held =
        a.data.size() * sizeof(float) + metric_bytes(a.width, a.height, lpips_.network());
    if (held > memory_.bytes()) return limit_error(a_, a.width, a.height, held, memory_.bytes());
    STGS_ASSIGN(Image b, read_image(b_, memory_.bytes() - held));
    if (interrupted()) return runtime_error(kIncomplete);
    if (a.width != b.width || a.height != b.height) {
      return {StatusCode::kDiffers,
              fmt::format("the images differ in size: {} is {}x{}, {} is {}x{}", a_, a.width,
                          a.height, b_, b.width, b.height)};
    }
    STGS_TRY(encoder::check_finite(a, a_));
    STGS_TRY(encoder::check_finite(b, b_));
    STGS_ASSIGN(const Difference d, difference(a, b, lpips_.network()));
    if (interrupted()) return runtime_error(kIncomplete);
    Json json = {{"a", a_}, {"b", b_}, {"kind", "images"}};
    return report(session, json, d);
  }

  Status compare_scenes(Session& session) {
    const ReadLimits limits = memory_.limits();
    STGS_ASSIGN(auto first, open_scene(session, a_, limits));
    STGS_ASSIGN(auto second, open_scene(session, b_, limits));
    STGS_ASSIGN(const encoder::Camera camera, find_camera(first->metadata()));
    const std::string name = camera_.empty() ? display_name(a_) : camera_;
    STGS_TRY(lpips_.check(camera.width, camera.height, limits.max_memory, name));
    STGS_ASSIGN(const std::uint64_t third,
                third_of_memory(limits.max_memory, camera, lpips_.network(), name));
    const auto timeline = [&](std::unique_ptr<SceneReader> reader, const std::string& location) {
      auto made = player::Timeline::from_reader(std::move(reader), display_name(location), third);
      made->budget()->set_limit(Budget::Pool::kRenderer, third);  // which is 1 GiB at least
      return made;
    };
    const auto a = timeline(std::move(first), a_), b = timeline(std::move(second), b_);
    Json json = {{"a", a->name()},
                 {"b", b->name()},
                 {"kind", "scenes"},
                 {"primitives", {a->reader().primitives(), b->reader().primitives()}},
                 {"bytes", {a->reader().file_bytes(), b->reader().file_bytes()}},
                 {"num_frames", num_frames_}};
    if (std::abs(a->duration_seconds() - b->duration_seconds()) > kSameDuration) {
      return {StatusCode::kDiffers,
              fmt::format("the scenes differ in duration: {} lasts {:.6g} s, {} lasts {:.6g} s",
                          a->name(), a->duration_seconds(), b->name(), b->duration_seconds())};
    }
    Difference total;
    for (int i = 0; i < num_frames_; ++i) {
      const double seconds = a->duration_seconds() * (i + 0.5) / num_frames_;
      Image images[2];
      for (int k = 0; k < 2; ++k) {
        STGS_ASSIGN(images[k], render(session, k == 0 ? *a : *b, seconds, camera));
      }
      STGS_ASSIGN(const Difference d, difference(images[0], images[1], lpips_.network()));
      total.mse += d.mse / num_frames_;
      total.ssim += d.ssim / num_frames_;
      total.lpips += d.lpips / num_frames_;
      total.max = std::max(total.max, d.max);
      if (!session.progress("compare", static_cast<std::size_t>(i) + 1,
                            static_cast<std::size_t>(num_frames_))) {
        return runtime_error(kIncomplete);
      }
    }
    return report(session, json, total);
  }

  Result<encoder::Camera> find_camera(const SceneMetadata& metadata) const {
    if (!camera_.empty()) return read_camera(camera_);
    const std::string name = display_name(a_);
    if (!metadata.start_camera) return usage_error("{}: no start camera; use --camera", name);
    return camera_of(*metadata.start_camera, name);
  }

  static Result<Image> render(Session& session, player::Timeline& timeline, double seconds,
                              const encoder::Camera& camera) {
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    const float* b = timeline.metadata().background;
    const player::View view{camera.pinhole(timeline.metadata().near_plane), {b[0], b[1], b[2]}};
    std::vector<player::Frame> frames;
    STGS_TRY(with_render_time(renderer->render(timeline, seconds, {view}, frames, nullptr),
                              timeline.name(), seconds));
    STGS_TRY(encoder::check_finite(frames[0].colour, name_at_time(timeline.name(), seconds)));
    for (float& v : frames[0].colour.data) v = std::clamp(v, 0.0f, 1.0f);
    return std::move(frames[0].colour);
  }

  Status report(Session& session, Json& json, const Difference& d) const {
    const double psnr = encoder::psnr_of(d.mse);
    json["psnr"] = psnr;
    json["ssim"] = d.ssim;
    json["max_difference"] = d.max;
    lpips_.add(d.lpips, json);
    std::string text;
    if (json.contains("primitives")) {
      text = fmt::format(
          "primitives {} and {}, bytes {} and {}\n", json["primitives"][0].get<std::uint64_t>(),
          json["primitives"][1].get<std::uint64_t>(), json["bytes"][0].get<std::uint64_t>(),
          json["bytes"][1].get<std::uint64_t>());
    }
    text += fmt::format("psnr {:.3f} dB, ssim {:.5f}, max difference {:.5f}", psnr, d.ssim, d.max);
    text += lpips_.text(d.lpips) + "\n";
    STGS_TRY(session.emit(json, text));
    if (psnr < min_psnr_) {
      return {StatusCode::kDiffers,
              fmt::format("psnr {:.3f} dB is below {:.3f} dB", psnr, min_psnr_)};
    }
    return {};
  }

  MemoryOption memory_;
  LpipsOption lpips_;
  std::string a_, b_, camera_;
  double min_psnr_ = 0;
  int num_frames_ = 5;
};

}  // namespace

std::unique_ptr<Command> make_compare() {
  return std::make_unique<Compare>();
}

}  // namespace stgs::tools
