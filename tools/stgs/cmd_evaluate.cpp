// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "allow_outside.h"
#include "camera_file.h"
#include "command.h"
#include "end_after_signal.h"
#include "flicker.h"
#include "image_io.h"
#include "lpips_option.h"
#include "masks_option.h"
#include "memory_option.h"
#include "moving.h"
#include "options.h"
#include "printable.h"
#include "protocol_option.h"
#include "scene_input.h"
#include "stgs/encoder/metrics.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/image_drift.h"
#include "stgs/format/parallel.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {
namespace {

struct Scores {
  double mse = 0, psnr = 0, psnr_cc = 0, ssim = 0, ssim_2 = 0;
  double lpips = 0;          // with a network
  ErrorSum moving;           // summed, never averaged
  std::uint64_t pixels = 0;  // tested for motion; 0 without a background
  ErrorSum masked;           // summed; with masks
  Flicker flicker;           // summed; of this frame and the one before
};

// Returns the means over frames; `moving` and `pixels` are sums.
Scores mean_of(const std::vector<Scores>& all) {
  Scores mean;
  for (const Scores& s : all) {
    mean.mse += s.mse;
    mean.psnr += s.psnr;
    mean.psnr_cc += s.psnr_cc;
    mean.ssim += s.ssim;
    mean.ssim_2 += s.ssim_2;
    mean.lpips += s.lpips;
    mean.moving += s.moving;
    mean.pixels += s.pixels;
    mean.masked += s.masked;
    mean.flicker += s.flicker;
  }
  const auto n = static_cast<double>(all.size());
  for (double* v : {&mean.mse, &mean.psnr, &mean.psnr_cc, &mean.ssim, &mean.ssim_2, &mean.lpips})
    *v /= n;
  return mean;
}

double psnr_moving(const Scores& s) {
  return encoder::psnr_of(s.moving.mean());
}

double moving_share(const Scores& s) {
  return static_cast<double>(s.moving.pixels) / static_cast<double>(s.pixels);
}

Json to_json(const Scores& s) {
  return {{"psnr", s.psnr},
          {"psnr_cc", s.psnr_cc},
          {"psnr_pooled", encoder::psnr_of(s.mse)},
          {"ssim", s.ssim},
          {"ssim_2", s.ssim_2},
          {"psnr_moving", s.moving.pixels > 0 ? Json(psnr_moving(s)) : Json(nullptr)},
          {"moving_share", s.pixels > 0 ? Json(moving_share(s)) : Json(nullptr)},
          {"flicker", s.flicker.json()}};
}

Json to_json(const ImageDrift& d) {
  if (d.primitives == 0) return nullptr;
  return {{"primitives", d.primitives},
          {"mean_px", d.mean},
          {"opacity_weighted_px", d.opacity_weighted},
          {"median_px", d.median},
          {"bound_px", kStaticDrift},
          {"within_bound", d.within_bound}};
}

Json to_json(const CameraCoverage& c) {
  return {{"by_none", c.by_none}, {"by_one", c.by_one}, {"by_more", c.by_more}};
}

Result<Scores> score(const Image& image, const encoder::Image8& loaded,
                     const encoder::Image8& background) {
  const Image ground_truth = encoder::to_float(loaded);
  STGS_ASSIGN(const encoder::Ssim similarity, encoder::ssim(image, ground_truth));
  Scores s;
  s.mse = encoder::mean_squared_error(image, ground_truth);
  s.psnr = encoder::psnr_of(s.mse);
  s.psnr_cc = encoder::psnr_of(encoder::colour_corrected_error(image, ground_truth));
  s.ssim = similarity.range_1;
  s.ssim_2 = similarity.range_2;
  if (!background.data.empty()) {
    s.moving = moving_error(image, loaded, background);
    s.pixels = static_cast<std::uint64_t>(loaded.width) * loaded.height;
  }
  return s;
}

// A rendered frame of one camera, to be scored.
struct Job {
  std::size_t camera = 0;
  int frame = 0;
  Image image;
  encoder::Image8 ground_truth;
  Scores scores;
};

class Evaluate final : public Command {
 public:
  Help help() const override {
    return {
        "evaluate", "Measure the quality of a .stgs file against a prepared capture",
        "Renders the selected cameras at every frame of the capture and compares with its\n"
        "images. Renders are clamped to [0,1] and not rounded to 8 bits. psnr: mean PSNR of the\n"
        "images; psnr_pooled: PSNR of the mean squared error of all images; psnr_cc: PSNR after\n"
        "the best affine colour map (3x4, render to ground truth) of each image; ssim: 11x11\n"
        "Gaussian window with sigma 1.5, mean over RGB and over the windows inside the image,\n"
        "data range 1; ssim_2: the same with data range 2; psnr_moving: PSNR of the mean squared\n"
        "error over the moving pixels of all frames, those where a channel of the ground truth\n"
        "differs by more than 20 of 255 from the background of the camera, the median of at most\n"
        "15 evaluated frames (none with fewer than 5). static drift: pixels that the centre of a\n"
        "primitive whose support covers the clip moves from the first to the last frame, mean\n"
        "over the training cameras to which it is visible, then over the primitives, unweighted\n"
        "and weighted by opacity. coverage: number of primitives whose centre is visible to no\n"
        "training camera, to one, or to several; the depth of those visible to fewer than two is\n"
        "not constrained. A training window is measured at its own frames. In a file of several\n"
        "windows, the window of a primitive stands for the clip. lpips, with --lpips: mean LPIPS\n"
        "(version 0.1) of the images as they are; smaller is better. psnr_masked, with --masks:\n"
        "PSNR of the mean squared error within the masks of all frames. flicker: root mean square\n"
        "change from each evaluated frame to the next, of 255, over pixels that move in neither;\n"
        "that of the ground truth is its noise.",
        "  stgs evaluate scene.stgs --against prepared/\n"
        "  stgs evaluate scene.stgs --against prepared/ --cameras 0,10 --every 5 --format json"};
  }

  Shared shared() const override {
    return {.progress = true, .backend = "Renderer", .threads = true, .urls = true};
  }
  void declare(Arguments& app) override {
    app.add_option("FILE", file_, "The .stgs file: a path, a URL, or - for standard input")
        ->required();
    app.add_option("--against", folder_, "Prepared capture to compare with")->required();
    add_allow_outside(app, allow_outside_);
    auto* cameras =
        app.add_option("--cameras", which_, "Cameras: test, train, all, or comma-separated names")
            ->capture_default_str();
    auto* every = app.add_option("--every", every_, "Evaluate every Nth frame, from the first")
                      ->check(number_between(1, 1e9))
                      ->capture_default_str();
    add_protocol(app, protocol_,
                 "Measure by a protocol of the paper a capture that was prepared by it")
        ->excludes(cameras)
        ->excludes(every);
    lpips_.declare(app);
    masks_.declare(app);
    memory_.declare(app);
  }

  Status run(Session& session) override {
    const EndAfterSignal end(session, "the evaluation is not complete");
    STGS_TRY(lpips_.open());
    STGS_ASSIGN(auto reader, open_scene(session, file_, memory_.limits()));
    const auto timeline = player::Timeline::from_reader(std::move(reader), shown_file());
    STGS_ASSIGN(const auto capture, encoder::read_prepared_capture(folder_, allow_outside_));
    STGS_ASSIGN(capture_, encoder::capture_for_scene(capture, timeline->metadata(), shown_file()));
    if (const encoder::Protocol* protocol = encoder::find_protocol(protocol_))
      STGS_TRY(encoder::check_protocol(*protocol, capture_));
    STGS_TRY(encoder::check_same_times(capture_, timeline->metadata(), shown_file()));
    masks_.apply(timeline->metadata(), capture_);
    encoder::warn_if_other_capture(capture_, timeline->metadata(), shown_file(),
                                   session.log_sink());
    STGS_ASSIGN(cameras_, choose_cameras(capture_, which_));
    STGS_TRY(encoder::check_frame_files(capture_, cameras_));
    for (const encoder::Camera& camera : cameras_)
      STGS_TRY(lpips_.check(camera.width, camera.height, memory_.bytes(), camera.name));
    STGS_ASSIGN(auto renderer, player::make_renderer(session.options.backend));
    STGS_TRY(find_backgrounds(session));
    STGS_TRY(measure(session, *timeline, *renderer));
    STGS_TRY(measure_static(session));
    return report(session);
  }

 private:
  std::string shown_file() const { return display_name(file_); }

  Status find_backgrounds(Session& session) {
    std::vector<int> frames;
    for (int i = 0; i < capture_.frames; i += every_) frames.push_back(i);
    backgrounds_.clear();
    for (const encoder::Camera& camera : cameras_) {
      STGS_ASSIGN(encoder::Image8 background, median_background(capture_, camera, frames));
      backgrounds_.push_back(std::move(background));
      if (!session.progress("background", backgrounds_.size(), cameras_.size())) {
        return runtime_error("the evaluation is not complete");
      }
    }
    return {};
  }

  // Renders a batch of frames one by one, each on all threads, then scores them in parallel. A
  // batch has one frame per thread.
  Status measure(Session& session, player::Timeline& timeline, player::Renderer& renderer) {
    const auto frames = static_cast<std::size_t>((capture_.frames + every_ - 1) / every_);
    const std::size_t total = frames * cameras_.size();
    const auto batch = static_cast<std::size_t>(concurrency());
    scores_.assign(cameras_.size(), std::vector<Scores>(frames));
    flicker_.begin(cameras_, memory_.bytes(), session.log_sink());
    std::vector<Job> jobs;
    for (std::size_t next = 0; next < total;) {
      jobs.clear();
      while (jobs.size() < batch && next < total) {
        // All cameras of a frame together, so that its segments are decoded once.
        Job& job = jobs.emplace_back();
        job.camera = next % cameras_.size();
        job.frame = static_cast<int>(next / cameras_.size()) * every_;
        ++next;
        STGS_TRY(render_job(timeline, renderer, job));
        if (!session.progress("evaluate", next, total)) {
          return runtime_error("the evaluation is not complete");
        }
      }
      STGS_TRY(score_jobs(session, jobs));
    }
    return {};
  }

  // Returns the error of the first job that has one.
  Status score_jobs(Session& session, std::vector<Job>& jobs) {
    std::vector<Status> scoring(jobs.size());
    parallel_for(std::size_t{0}, jobs.size(),
                 [&](std::size_t i) { scoring[i] = score_job(jobs[i]); });
    for (const Status& status : scoring) STGS_TRY(status);
    for (Job& job : jobs) {
      if (lpips_.network() != nullptr) STGS_TRY(measure_lpips(session, job));
      job.scores.flicker = flicker_.add(job.camera, std::move(job.image),
                                        std::move(job.ground_truth), backgrounds_[job.camera]);
      scores_[job.camera][static_cast<std::size_t>(job.frame / every_)] = job.scores;
    }
    return {};
  }

  Status score_job(Job& job) const {
    STGS_ASSIGN(job.ground_truth, encoder::load_frame(capture_, cameras_[job.camera], job.frame));
    STGS_ASSIGN(job.scores, score(job.image, job.ground_truth, backgrounds_[job.camera]));
    if (masks_.given()) {
      STGS_ASSIGN(job.scores.masked,
                  masks_.error(cameras_[job.camera].name, job.frame + capture_.frame_offset(),
                               job.image, job.ground_truth));
    }
    return {};
  }

  // Uses all threads for one image, because a network needs much memory.
  Status measure_lpips(Session& session, Job& job) {
    STGS_ASSIGN(job.scores.lpips,
                lpips_.network()->distance(job.image, encoder::to_float(job.ground_truth)));
    const std::size_t total = scores_.size() * scores_[0].size();
    if (session.progress("lpips", ++measured_, total)) return {};
    return runtime_error("the evaluation is not complete");
  }

  // Measures the drift and the coverage, by the training cameras.
  Status measure_static(Session& session) {
    STGS_ASSIGN(const Scene scene, load_scene(session, file_, memory_.limits()));
    std::vector<math::PinholeCamera> training;
    for (const encoder::Camera& camera : capture_.cameras) {
      if (!camera.test) training.push_back(camera.pinhole(scene.metadata.near_plane));
    }
    drift_ = image_drift(scene, training);
    coverage_ = camera_coverage(scene, training);
    return {};
  }

  Status render_job(player::Timeline& timeline, player::Renderer& renderer, Job& job) {
    const SceneMetadata& metadata = timeline.metadata();
    const float* b = metadata.background;
    const player::View view{cameras_[job.camera].pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
    std::vector<player::Frame> frames;
    const double ticks = capture_.time_of(cameras_[job.camera], job.frame);
    const double seconds =
        metadata.time_base.seconds(std::clamp(ticks, 0.0, static_cast<double>(metadata.frames)));
    STGS_TRY(with_render_time(renderer.render(timeline, seconds, {view}, frames, nullptr),
                              shown_file(), seconds));
    STGS_TRY(encoder::check_finite(frames[0].colour, name_at_time(shown_file(), seconds)));
    job.image = std::move(frames[0].colour);
    for (float& v : job.image.data) v = std::clamp(v, 0.0f, 1.0f);
    return {};
  }

  // The row of the paper's table.
  std::string protocol_text(const Scores& mean, std::size_t images) const {
    if (protocol_.empty()) return "";
    const std::string lpips =
        lpips_.network() == nullptr ? ", no lpips (--lpips)" : lpips_.text(mean.lpips);
    return fmt::format("protocol {}: camera {}, {}: psnr {:.2f} dB, ssim_2 {:.4f}{}\n", protocol_,
                       one_line(cameras_.front().name), plural(images, "image"), mean.psnr,
                       mean.ssim_2, lpips);
  }

  Status report(Session& session) const {
    std::vector<Scores> all;
    Json views = Json::array();
    std::string text =
        fmt::format("{:<16} {:>9} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8}  {}\n", "camera", "size",
                    "frames", "psnr", "psnr_cc", "ssim", "ssim_2", "moving", "pixels");
    const auto row = [&text](const std::string& name, const std::string& size, std::size_t frames,
                             const Scores& s) {
      text += fmt::format("{:<16} {:>9} {:>7} {:>8.3f} {:>8.3f} {:>8.4f} {:>8.4f} {:>8}  {}\n",
                          name, size, frames, s.psnr, s.psnr_cc, s.ssim, s.ssim_2,
                          s.moving.pixels > 0 ? fmt::format("{:.3f}", psnr_moving(s)) : "-",
                          s.pixels > 0 ? fmt::format("{:.2f} %", 100 * moving_share(s)) : "-");
    };
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
      const encoder::Camera& camera = cameras_[c];
      const Scores mean = mean_of(scores_[c]);
      all.insert(all.end(), scores_[c].begin(), scores_[c].end());
      Json view = {{"camera", camera.name},
                   {"width", camera.width},
                   {"height", camera.height},
                   {"frames", scores_[c].size()}};
      view.update(to_json(mean));
      masks_.add(mean.masked, view);
      lpips_.add(mean.lpips, view);
      views.push_back(view);
      row(one_line(camera.name), fmt::format("{}x{}", camera.width, camera.height),
          scores_[c].size(), mean);
    }
    const Scores mean = mean_of(all);
    row("mean", "", all.size(), mean);
    text += fmt::format(
        "static drift {:.4f} px over the clip (opacity-weighted {:.4f}, median {:.4f}), {} "
        "primitives "
        "that cover the clip, {} of them within {} px\n",
        drift_.mean, drift_.opacity_weighted, drift_.median, drift_.primitives, drift_.within_bound,
        kStaticDrift);
    text += fmt::format("primitives visible to no training camera {}, to one {}, to several {}\n",
                        coverage_.by_none, coverage_.by_one, coverage_.by_more);
    text += mean.flicker.text();
    text += fmt::format("psnr of the pooled error {:.3f} dB{}{}, peak memory {}\n",
                        encoder::psnr_of(mean.mse), masks_.text(mean.masked),
                        lpips_.text(mean.lpips), human_bytes(peak_memory()));
    text += protocol_text(mean, all.size());
    Json json = {{"file", shown_file()},
                 {"against", folder_},
                 {"protocol", protocol_.empty() ? Json(nullptr) : Json(protocol_)},
                 {"cameras", which_},
                 {"every", every_},
                 {"foreground", masks_.foreground()},
                 {"images", all.size()}};
    json.update(to_json(mean));
    masks_.add(mean.masked, json);
    lpips_.add(mean.lpips, json);
    json["static_drift"] = to_json(drift_);
    json["coverage"] = to_json(coverage_);
    json["views"] = views;
    json["peak_memory"] = peak_memory();
    return session.emit(json, text);
  }

  MemoryOption memory_;
  LpipsOption lpips_;
  MasksOption masks_;
  FlickerMeter flicker_;
  std::string file_, folder_, which_ = "test", protocol_;
  bool allow_outside_ = false;
  int every_ = 1;
  encoder::PreparedCapture capture_;
  std::vector<encoder::Camera> cameras_;
  std::vector<encoder::Image8> backgrounds_;  // per camera; empty images without a median
  std::vector<std::vector<Scores>> scores_;   // [camera][frame]
  ImageDrift drift_;
  CameraCoverage coverage_;
  std::size_t measured_ = 0;  // images, with LPIPS
};

}  // namespace

std::unique_ptr<Command> make_evaluate() {
  return std::make_unique<Evaluate>();
}

}  // namespace stgs::tools
