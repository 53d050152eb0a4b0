// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>

#include "camera_file.h"
#include "command.h"
#include "options.h"
#include "picture.h"
#include "place.h"
#include "stgs/encoder/metrics.h"
#include "stgs/player/renderer.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

constexpr double kSameDuration = 1e-6;  // seconds

struct Difference {
  double mse = 0, ssim = 0, largest = 0;
};

Result<Difference> difference(const Image& a, const Image& b) {
  Difference d;
  d.mse = encoder::mean_squared_error(a, b);
  d.largest = encoder::max_difference(a, b);
  STGS_ASSIGN(const encoder::Ssim similarity, encoder::ssim(a, b));
  d.ssim = similarity.range_1;
  return d;
}

class Compare final : public Command {
 public:
  Help help() const override {
    return {"compare", "Tell how far two pictures or two .stgs files are apart",
            "Two pictures (PNG, JPEG, EXR) are compared as they are. Two .stgs files are rendered\n"
            "from the start camera of the first, or from --camera, at several moments. Prints\n"
            "psnr (of the pooled error, at most 100), ssim (as evaluate) and the largest\n"
            "difference of a channel in [0,1]. Exit code 7 where psnr is below --min-psnr, or the\n"
            "pictures differ in size, or the scenes in duration.",
            "  stgs compare a.png b.png\n  stgs compare lossless.stgs packed.stgs --min-psnr 40"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "What draws", .threads = true};
  }
  void declare(CLI::App& app) override {
    app.add_option("A", a_, "A picture, or a .stgs file or its URL")->required();
    app.add_option("B", b_, "Another of its kind")->required();
    app.add_option("--min-psnr", min_psnr_, "dB; exit code 7 below it")
        ->check(number_between(0, encoder::kPsnrMax));
    app.add_option("--camera", camera_, "For .stgs files: camera file (JSON), see 'render'");
    app.add_option("--num-frames", moments_, "For .stgs files: how many, evenly spaced")
        ->check(number_between(1, 1000))
        ->capture_default_str();
  }

  Status run(Session& session) override {
    const bool pictures = is_picture_name(a_);
    if (pictures != is_picture_name(b_)) {
      return usage_error("{} and {} are not of one kind: give two pictures or two .stgs files",
                         player::display_location(a_), player::display_location(b_));
    }
    return pictures ? compare_pictures(session) : compare_scenes(session);
  }

 private:
  Status compare_pictures(Session& session) {
    STGS_ASSIGN(Image a, read_picture(a_));
    STGS_ASSIGN(Image b, read_picture(b_));
    if (a.width != b.width || a.height != b.height) {
      return {StatusCode::kDiffers, fmt::format("{} is {}x{}, {} is {}x{}", a_, a.width, a.height,
                                                b_, b.width, b.height)};
    }
    STGS_TRY(encoder::check_finite(a, a_));
    STGS_TRY(encoder::check_finite(b, b_));
    STGS_ASSIGN(const Difference d, difference(a, b));
    Json json = {{"a", a_}, {"b", b_}, {"kind", "images"}};
    return report(session, json, d);
  }

  Status compare_scenes(Session& session) {
    STGS_ASSIGN(auto first, open_scene(session, a_));
    STGS_ASSIGN(auto second, open_scene(session, b_));
    const auto a = player::Timeline::from_reader(std::move(first), player::display_location(a_));
    const auto b = player::Timeline::from_reader(std::move(second), player::display_location(b_));
    Json json = {{"a", a->name()},
                 {"b", b->name()},
                 {"kind", "scenes"},
                 {"primitives", {a->reader().primitives(), b->reader().primitives()}},
                 {"bytes", {a->reader().file_bytes(), b->reader().file_bytes()}},
                 {"num_frames", moments_}};
    if (std::abs(a->duration_seconds() - b->duration_seconds()) > kSameDuration) {
      return {StatusCode::kDiffers,
              fmt::format("{} lasts {} s, {} lasts {} s", a->name(), a->duration_seconds(),
                          b->name(), b->duration_seconds())};
    }
    STGS_ASSIGN(const encoder::Camera camera, find_camera(*a));
    Difference total;
    for (int i = 0; i < moments_; ++i) {
      const double seconds = a->duration_seconds() * (i + 0.5) / moments_;
      Image pictures[2];
      for (int k = 0; k < 2; ++k) {
        STGS_ASSIGN(pictures[k], draw(session, k == 0 ? *a : *b, seconds, camera));
      }
      STGS_ASSIGN(const Difference d, difference(pictures[0], pictures[1]));
      total.mse += d.mse / moments_;
      total.ssim += d.ssim / moments_;
      total.largest = std::max(total.largest, d.largest);
      if (!session.progress("compare", static_cast<std::size_t>(i) + 1,
                            static_cast<std::size_t>(moments_))) {
        return runtime_error("the comparison is not complete");
      }
    }
    return report(session, json, total);
  }

  Result<encoder::Camera> find_camera(const player::Timeline& timeline) const {
    if (!camera_.empty()) return read_camera(camera_);
    const auto& start = timeline.metadata().start_camera;
    if (!start) return usage_error("{}: has no start camera; give --camera", timeline.name());
    return camera_of(*start, timeline.name());
  }

  static Result<Image> draw(Session& session, player::Timeline& timeline, double seconds,
                            const encoder::Camera& camera) {
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    const float* b = timeline.metadata().background;
    const player::View view{camera.pinhole(timeline.metadata().near_plane), {b[0], b[1], b[2]}};
    std::vector<player::Frame> frames;
    STGS_TRY(at_moment(renderer->render(timeline, seconds, {view}, frames, nullptr),
                       timeline.name(), seconds));
    STGS_TRY(encoder::check_finite(frames[0].colour, moment_name(timeline.name(), seconds)));
    for (float& v : frames[0].colour.data) v = std::clamp(v, 0.0f, 1.0f);
    return std::move(frames[0].colour);
  }

  Status report(Session& session, Json& json, const Difference& d) const {
    const double psnr = encoder::psnr_of(d.mse);
    json["psnr"] = psnr;
    json["ssim"] = d.ssim;
    json["max_difference"] = d.largest;
    std::string text;
    if (json.contains("primitives")) {
      text = fmt::format(
          "primitives {} and {}, bytes {} and {}\n", json["primitives"][0].get<std::uint64_t>(),
          json["primitives"][1].get<std::uint64_t>(), json["bytes"][0].get<std::uint64_t>(),
          json["bytes"][1].get<std::uint64_t>());
    }
    text += fmt::format("psnr {:.3f} dB, ssim {:.5f}, largest difference {:.5f}\n", psnr, d.ssim,
                        d.largest);
    STGS_TRY(session.emit(json, text));
    if (psnr < min_psnr_) {
      return {StatusCode::kDiffers,
              fmt::format("psnr {:.3f} dB is below {:.3f} dB", psnr, min_psnr_)};
    }
    return {};
  }

  std::string a_, b_, camera_;
  double min_psnr_ = 0;
  int moments_ = 5;
};

}  // namespace

std::unique_ptr<Command> make_compare() {
  return std::make_unique<Compare>();
}

}  // namespace stgs::tools
