// SPDX-License-Identifier: Apache-2.0
// The results of training: the scene with its importances, and the report.
#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <new>
#include <utility>

#include "stgs/format/parallel.h"
#include "train/camera_refinement.h"
#include "train/compute_importance.h"
#include "train/persistence.h"
#include "train/set_growth.h"
#include "train/start_camera.h"
#include "train/trainer.h"

namespace stgs::encoder {
namespace {

// Views for the importances of a live window: per frame, and at least. As many as for a complete
// run would take a third of its time.
constexpr int kWindowViews = 2, kMinWindowViews = 32;

std::uint64_t peak_memory_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace

Result<std::vector<float>> Trainer::importance() {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begin = Clock::now();
  const std::string interrupted = clock_.stage();
  clock_.begin("importances");
  const auto seconds = [begin] {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  };
  const auto should_continue = [&](double done) {
    if (!progress_) return true;
    const double eta = done > 0 ? seconds() * (1 - done) / done : -1;
    const std::string detail = fmt::format("importance of {} primitives", state_.size());
    const bool more = progress_(finished() ? Progress{"importance", done, eta, detail}
                                           : Progress{"train", run_progress(), -1, detail});
    return more || ranks_.size() > 1;  // ranks stop together, after a step
  };
  const int count =
      is_live() ? std::clamp(kWindowViews * capture_.frames, kMinWindowViews, kImportanceViews)
                : kImportanceViews;
  const std::vector<ImportanceView> views =
      importance_views(with_refined_cameras(capture_, state_), count, parameters_.kernel);
  std::optional<std::vector<float>> importance =
      compute_importance(*backend_, *make_cpu_backend(), state_, views, should_continue, log_);
  importance_seconds_ += seconds();
  clock_.begin(interrupted);
  if (importance) return *std::move(importance);
  return runtime_error("stopped at iteration {}, before the importances were complete; {}",
                       state_.iteration, resume_hint());
}

void Trainer::find_persistent(PersistentSet& set) {
  // Ascending, then with the stored primitives first.
  const int first = std::max(changes_.settled, 0);
  std::vector<std::uint32_t> persistent = list_persistent(state_, capture_.frames, first);
  std::vector<std::uint32_t> carried;
  if (set.carries_moving()) carried = list_carried(state_, capture_.frames, persistent);
  std::vector<std::uint32_t> found, fixed;
  std::vector<MemberEnd> ends;
  for (const std::uint32_t i : persistent) {
    if (!state_.is_fixed(i)) {
      found.push_back(i);
      continue;
    }
    const std::size_t k = fixed.size() + ends.size();
    if (ends_[k] >= 0) {
      ends.push_back({static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(ends_[k])});
    } else {
      fixed.push_back(i);
    }
  }
  parallel_for(std::size_t{0}, found.size(),
               [&](std::size_t k) { persist(state_, found[k], first, capture_.frames); });
  stored_ = list_still(capture_, state_.set, found);
  // Content that has just changed is stored once it has been visible for a complete window.
  if (first > 0) stored_.clear();
  stored_ = choose_joining(stored_, fixed.size(), state_.compaction.importance, recorded_);
  persistent = fixed;
  persistent.insert(persistent.end(), stored_.begin(), stored_.end());
  std::set_difference(found.begin(), found.end(), stored_.begin(), stored_.end(),
                      std::back_inserter(persistent));
  log_(2, fmt::format("persistent set: {} primitives, {} added, {} ended; the next window starts "
                      "from {} further static and {} moving ones",
                      fixed.size(), stored_.size(), ends.size(), found.size() - stored_.size(),
                      carried.size()));
  set = PersistentSet(std::make_shared<const TrainState>(
                          persistent_state(state_, persistent, carried, stored_, capture_.frames)),
                      set.carries_moving(), {}, changes_.residuals, std::move(ends));
}

Result<Scene> Trainer::result(PersistentSet* persistent) {
  clock_.begin("trained scene");
  if (persistent != nullptr) find_persistent(*persistent);
  Result<Scene> out = scene();
  log_times(clock_.times(), log_);
  return out;
}

Result<Scene> Trainer::scene() {
  Scene scene;
  scene.gaussians = state_.set;
  if (state_.compaction.is_rounding()) {
    scene.importance = state_.compaction.importance;
    scene.quantisation = state_.compaction.quantisation;
  } else if (ranks_.is_first() && state_.size() > fixed_) {
    STGS_ASSIGN(scene.importance, importance());
  }
  SceneMetadata& metadata = scene.metadata;
  metadata.time_base = capture_.time_base;
  metadata.frames = static_cast<std::uint32_t>(capture_.frames);
  metadata.metres_per_unit = capture_.metric ? 1.0f : 0.0f;
  metadata.near_plane = capture_.near_plane;
  metadata.kernel = static_cast<std::uint8_t>(parameters_.kernel);
  std::copy_n(&state_.background.x, 3, metadata.background);
  metadata.start_camera = start_camera(capture_.training_cameras());
  metadata.generator = "stgs " STGS_VERSION;
  if (persistent_ != nullptr) split_window(state_, stored_, scene);
  return scene;
}

TrainReport Trainer::report() const {
  TrainReport report;
  report.iterations = static_cast<int>(state_.iteration);
  report.seconds = state_.seconds;
  report.importance_seconds = importance_seconds_;
  report.primitives = state_.size();
  report.final_loss = state_.mean_loss;
  report.psnr = recent_psnr();
  report.peak_memory = peak_memory_bytes();
  report.held_out = score_;
  report.backend = backend_->name();
  report.perceptual = perceptual_.report();
  report.frames = images_.statistics();
  report.processes = ranks_.size();
  report.cameras = refined_cameras(capture_, state_);
  report.parameters = list_hyper_parameters(growth_);
  return report;
}

Result<Scene> train(const PreparedCapture& capture, const TrainSettings& settings,
                    const ProgressSink& progress, const LogSink& log, TrainReport* report,
                    const WindowState& window) {
  try {
    PersistentSet* const persistent = window.persistent;
    STGS_ASSIGN(const std::unique_ptr<Trainer> trainer,
                Trainer::create(capture, settings, window, progress, log));
    STGS_TRY(trainer->run());
    Result<Scene> scene = trainer->result(persistent);
    if (scene.ok() && report != nullptr) *report = trainer->report();
    if (scene.ok() && window.backend != nullptr) *window.backend = trainer->take_backend();
    return scene;
  } catch (const std::bad_alloc&) {
    return runtime_error(
        "training ran out of memory; use fewer primitives (--max-primitives) or smaller frames");
  } catch (const std::exception& error) {
    return runtime_error("training failed: {}", error.what());
  }
}

}  // namespace stgs::encoder
