// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/live_encoder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <utility>

#include "live_capture.h"
#include "live_controller.h"
#include "live_queue.h"
#include "plural.h"
#include "train/machine_memory.h"
#include "train/training_choice.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// Static content of the first window is displayed up to here (stream_encoder.cpp).
constexpr int kMaxFrames = 1'000'000;
constexpr double kQueueShare = 0.25;             // of the available memory
constexpr std::size_t kMaxMilliseconds = 60000;  // the largest latency that is recorded

// Runs the task of a thread. `stage` begins the message for an exception.
Status without_exceptions(const char* stage, const std::function<Status()>& task) {
  try {
    return task();
  } catch (const std::exception& error) {
    return runtime_error("{} a live window failed: {}", stage, error.what());
  }
}

}  // namespace

LiveEncoder::LiveEncoder(LivePreparer& preparer, std::string folder, LiveSettings settings,
                         LiveWindowSink windows, LogSink log)
    : preparer_(preparer),
      folder_(std::move(folder)),
      settings_(std::move(settings)),
      windows_(std::move(windows)),
      log_(log ? std::move(log) : [](int, const std::string&) {}),
      latencies_(kMaxMilliseconds + 1, 0) {}

Result<std::unique_ptr<LiveEncoder>> LiveEncoder::open(LivePreparer& preparer,
                                                       const std::string& folder,
                                                       const LiveSettings& settings,
                                                       LiveWindowSink windows, LogSink log) {
  std::uint64_t bytes = settings.queue_bytes;
  if (bytes == 0)
    bytes = static_cast<std::uint64_t>(kQueueShare * static_cast<double>(available_memory()));
  if (settings.stream.train.target_kbps > 0 || settings.stream.train.target_size > 0 ||
      settings.stream.train.target_psnr > 0)
    return usage_error("live encoding does not support targets of rate, size or PSNR; remove them");
  STGS_ASSIGN(const TrainingChoice choice, choose_training(settings.stream.train));
  std::unique_ptr<LiveEncoder> live(
      new LiveEncoder(preparer, folder, settings, std::move(windows), std::move(log)));
  live->queue_ = std::make_unique<LiveQueue>(preparer.cameras().size(), preparer.fps(), bytes);
  live->controller_ = std::make_unique<LiveController>(preparer.fps(), settings.latency,
                                                       choice.parameters.iterations);
  StreamSettings& stream = live->settings_.stream;
  stream.identity = "live\n";
  stream.resumable = false;
  stream.carries_moving = true;
  stream.train.held_out_evaluations = 0;
  const auto is_set = [&](const char* name) {
    return std::any_of(stream.train.overrides.begin(), stream.train.overrides.end(),
                       [name](const auto& entry) { return entry.first == name; });
  };
  const bool compacts = choice.parameters.compact_share > 0;
  live->keeps_chosen_ = !compacts || is_set("compact_keep");
  // Each round takes as long as a hundred steps.
  if (compacts && !is_set("compact_rounds"))
    stream.train.overrides.emplace_back("compact_rounds", "2");
  if (live->keeps_chosen_ && settings.target_kbps > 0) {
    return usage_error("--target-kbps excludes compact_keep and compact_share; remove one of them");
  }
  STGS_ASSIGN(live->encoder_, StreamEncoder::open(folder, stream));
  live->preparing_ = std::thread([encoder = live.get()] { encoder->prepare_windows(); });
  live->training_ = std::thread([encoder = live.get()] { encoder->train_windows(); });
  return live;
}

LiveEncoder::~LiveEncoder() {
  stop();
}

void LiveEncoder::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  handed_.notify_all();
  queue_->end_all();
  if (preparing_.joinable()) preparing_.join();
  if (training_.joinable()) training_.join();
}

void LiveEncoder::push(std::size_t camera, double seconds, Image8 frame) {
  queue_->push(camera, seconds, std::make_shared<const Image8>(std::move(frame)), now());
}

void LiveEncoder::end_camera(std::size_t camera) {
  queue_->end(camera);
}

bool LiveEncoder::ended() const {
  const std::lock_guard lock(mutex_);
  return !error_.ok() || trained_all_;
}

void LiveEncoder::fail(const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (error_.ok()) error_ = status;
    stopped_ = true;
  }
  handed_.notify_all();
  queue_->end_all();
}

void LiveEncoder::prepare_windows() {
  const ScopedTaskRunner use(settings_.tasks);
  const Status status = without_exceptions("preparing", [this] { return prepare_all(); });
  if (!status.ok()) fail(status);
  const std::lock_guard lock(mutex_);
  prepared_all_ = true;
  handed_.notify_all();
}

Status LiveEncoder::prepare_all() {
  const std::vector<bool> takes_part =
      queue_->start(settings_.start_seconds, [this] { return now(); });
  if (takes_part.empty()) {
    return runtime_error(
        "fewer than 2 cameras have delivered a frame; check the sources of the cameras");
  }
  for (std::size_t c = 0; c < takes_part.size(); ++c) {
    if (takes_part[c]) {
      taking_part_.push_back(c);
      continue;
    }
    log_(1, fmt::format("camera '{}' delivers no frames; encoding without it",
                        preparer_.cameras()[c].name));
  }
  STGS_ASSIGN(rig_, preparer_.start(takes_part));
  {
    const std::lock_guard lock(mutex_);
    report_.cameras = static_cast<int>(taking_part_.size());
    controller_->limit_halvings(max_halvings(rig_.cameras));
  }
  for (int index = 0;; ++index) {
    STGS_ASSIGN(const bool has_more, prepare_next(index));
    if (!has_more) return {};
  }
}

bool LiveEncoder::log_overflow() {
  const std::uint64_t overflow = queue_->dropped().overflow, before = overflow_;
  overflow_ = overflow;
  if (overflow == before) return false;
  const bool is_smallest = controller_->halvings() == controller_->max_halvings();
  log_(1, fmt::format("encoding is too slow: {} dropped{}", plural(overflow - before, "image"),
                      is_smallest ? "; use fewer cameras or smaller images (--scale)" : ""));
  return true;
}

int LiveEncoder::choose_halvings(int first_frame, int ready, bool overflowed) {
  std::unique_lock lock(mutex_);
  const int before = controller_->halvings();
  const int halvings = controller_->choose_halvings(ready, overflowed);
  lock.unlock();
  if (halvings != before) {
    constexpr const char* kSizes[] = {"the full", "half the", "a quarter of the"};
    static_assert(std::size(kSizes) == kMaxHalvings + 1);
    const bool is_smaller = halvings > before;
    log_(is_smaller ? 1 : 2,
         fmt::format("encoding is {}: images have {} size from frame {} on",
                     is_smaller ? "too slow" : "fast enough", kSizes[halvings], first_frame));
  }
  return halvings;
}

// Returns whether there was a window.
Result<bool> LiveEncoder::prepare_next(int index) {
  const auto clock = [this] { return now(); };
  const int least = controller_->window(), ready = queue_->ready(now());
  const int most = index == 0 ? least : controller_->frames(ready);
  const LiveFrames frames = queue_->take(least, most, clock);
  const bool overflowed = log_overflow();
  if (frames.frames.empty()) return false;
  if (frames.first + static_cast<int>(frames.frames.size()) > kMaxFrames) {
    log_(1, fmt::format("the recording has its maximum length, {} frames; start another one",
                        frames.first));
    return false;
  }
  Prepared prepared;
  LiveWindow& window = prepared.window;
  window.first_frame = frames.first;
  window.frames = static_cast<int>(frames.frames.size());
  window.missing = count_missing(frames, taking_part_);
  for (const LiveFrame& frame : frames.frames) prepared.arrived.push_back(frame.arrived);
  if (index > 0) prepared.halvings = choose_halvings(frames.first, ready, overflowed);
  window.scale = 1.0 / (1 << prepared.halvings);
  const double begin = now();
  prepared.capture = live_capture(rig_, taking_part_, frames, prepared.halvings);
  prepared.capture.folder = fmt::format("{}/window-{}", folder_, index % 3);
  fs::create_directories(prepared.capture.folder);
  const bool has_images = window.missing < taking_part_.size() * frames.frames.size();
  if (has_images) {
    prepare(prepared, index == 0, begin, frames.waiting);
    // Without the first window there is no static content.
    if (index == 0) STGS_TRY(prepared.status);
  } else {
    prepared.status = runtime_error("frames {}:{}: no camera has delivered an image", frames.first,
                                    frames.first + window.frames);
  }
  std::unique_lock lock(mutex_);
  handed_.wait(lock, [this] { return !next_ || stopped_; });
  if (stopped_) return false;
  next_ = std::move(prepared);
  handed_.notify_all();
  return true;
}

void LiveEncoder::prepare(Prepared& prepared, bool is_first, double begin, int waiting) {
  LiveWindow& window = prepared.window;
  if (!is_first) {
    const std::lock_guard lock(mutex_);
    window.point_interval = controller_->point_interval(window.frames, waiting);
  }
  const ProgressSink progress = [this](const Progress&) {
    const std::lock_guard lock(mutex_);
    return !stopped_;
  };
  prepared.status = preparer_.prepare(prepared.capture, window.point_interval, progress, log_);
  window.prepare_seconds = now() - begin;
  if (is_first) return;
  const std::lock_guard lock(mutex_);
  controller_->prepared(prepared.halvings, window.frames, window.point_interval,
                        window.prepare_seconds);
}

void LiveEncoder::train_windows() {
  const ScopedTaskRunner use(settings_.tasks);
  const Status status = without_exceptions("training", [this] { return train_all(); });
  if (!status.ok()) fail(status);
  const std::lock_guard lock(mutex_);
  trained_all_ = true;
}

LiveReport LiveEncoder::report() const {
  const std::lock_guard lock(mutex_);
  LiveReport out = report_;
  out.received = queue_->received();
  const LiveDropped dropped = queue_->dropped();
  out.dropped = dropped.total();
  out.late = dropped.late;
  out.repeated = dropped.repeated;
  out.ahead = dropped.ahead;
  out.overflow = dropped.overflow;
  std::uint64_t total = 0, below = 0;
  for (const std::uint32_t count : latencies_) total += count;
  for (std::size_t ms = 0; ms < latencies_.size(); ++ms) {
    if (latencies_[ms] == 0) continue;
    const double seconds = 1e-3 * static_cast<double>(ms);
    if (2 * below < total) out.latency_median = seconds;
    if (20 * below < 19 * total) out.latency_p95 = seconds;
    out.latency_max = seconds;
    below += latencies_[ms];
  }
  return out;
}

Status LiveEncoder::finish(const std::string& output) {
  queue_->end_all();
  if (preparing_.joinable()) preparing_.join();
  if (training_.joinable()) training_.join();
  Status error;
  {
    const std::lock_guard lock(mutex_);
    error = error_;
  }
  if (!error.ok() && !has_first_) {  // a recording without content
    encoder_.reset();
    std::error_code ignored;
    fs::remove(settings_.stream.recording, ignored);
  }
  STGS_TRY(error);
  STGS_TRY(recover());
  if (output != settings_.stream.recording) STGS_TRY(encoder_->close());
  return output.empty() ? Status() : encoder_->finish(output);
}

}  // namespace stgs::encoder
