// SPDX-License-Identifier: Apache-2.0
// The training thread of a live encoder: trains the prepared windows and writes them.
#include <algorithm>
#include <utility>

#include "live_controller.h"
#include "live_queue.h"
#include "stgs/encoder/live_encoder.h"

namespace stgs::encoder {
namespace {

constexpr int kMaxFailures = 20;  // windows in a row that are not written, other than by the disk

}  // namespace

Status LiveEncoder::train_all() {
  while (true) {
    std::unique_lock lock(mutex_);
    handed_.wait(lock, [this] { return next_ || prepared_all_ || stopped_; });
    if (stopped_ || !next_) return {};
    Prepared prepared = *std::exchange(next_, std::nullopt);
    lock.unlock();
    handed_.notify_all();
    STGS_TRY(train(prepared));
    count(prepared);
    if (windows_) windows_(prepared.window);
  }
}

Status LiveEncoder::train(Prepared& prepared) {
  Status status = prepared.status;
  if (status.ok()) status = write(prepared);
  LiveWindow& window = prepared.window;
  if (status.ok()) {
    failures_ = 0;
    return {};
  }
  // Without the first window there is nothing to continue.
  if (!has_first_) return status;
  window.written = false;
  lost_ += window.frames;
  log_(1, fmt::format("frames {}:{} contain static content only: {}", window.first_frame,
                      window.first_frame + window.frames, status.message()));
  const bool has_images = window.missing < taking_part_.size() * prepared.arrived.size();
  failures_ += has_images && status.code() != StatusCode::kIo ? 1 : 0;
  return failures_ >= kMaxFailures ? status : Status();
}

Status LiveEncoder::write(Prepared& prepared) {
  STGS_TRY(recover());
  LiveWindow& window = prepared.window;
  const bool is_first = !has_first_;
  const int waiting = queue_->ready(now());
  WindowWork work;
  // Before static content is stored, removing primitives would remove it, too.
  const bool removes = !keeps_chosen_ && encoder_->persistent() > 0;
  if (!keeps_chosen_) work.keep = removes ? controller_->keep() : 1.0;
  if (is_first) {
    work.max_seconds = settings_.first_seconds;
  } else {
    const std::lock_guard lock(mutex_);
    work.iterations = controller_->iterations(window.frames, waiting);
  }
  const double begin = now();
  const ProgressSink progress = [this](const Progress&) {
    const std::lock_guard lock(mutex_);
    return !stopped_;
  };
  STGS_ASSIGN(const StreamWindow written, encoder_->encode(prepared.capture, progress, log_, work));
  has_first_ = true;
  const double end = now();
  window.iterations = written.training.iterations;
  window.primitives = written.primitives;
  window.persistent = written.persistent;
  window.bytes = written.bytes;
  window.loss = written.training.final_loss;
  window.psnr = written.training.psnr;
  window.step_seconds = written.training.seconds;
  window.train_seconds = end - begin;
  for (const double arrived : prepared.arrived)
    if (arrived > 0) window.latency = std::max(window.latency, end - arrived);
  window.waiting = queue_->ready(end);
  if (removes && settings_.target_kbps > 0) follow_rate(window);
  const std::lock_guard lock(mutex_);
  if (is_first)
    controller_->first_trained(window.iterations, window.step_seconds);
  else
    controller_->trained(prepared.halvings, window.frames, window.iterations, window.train_seconds);
  const auto longest = static_cast<double>(latencies_.size() - 1);
  for (const double arrived : prepared.arrived) {
    if (arrived == 0) continue;  // no camera has delivered it
    const double milliseconds = std::clamp(1e3 * (end - arrived), 0.0, longest);
    ++latencies_[static_cast<std::size_t>(milliseconds)];
  }
  return {};
}

void LiveEncoder::follow_rate(const LiveWindow& window) {
  const auto bytes = static_cast<double>(window.bytes);
  if (controller_->wrote(window.frames, bytes, settings_.target_kbps) || is_over_rate_) return;
  is_over_rate_ = true;
  log_(1, fmt::format("the bit rate exceeds the limit of {:g} kbit/s with a tenth of the "
                      "primitives; use fewer primitives (--max-primitives) or a longer --latency",
                      settings_.target_kbps));
}

Status LiveEncoder::recover() {
  if (lost_ == 0) return {};
  // The error may have closed the recording.
  Status status = encoder_->reopen();
  if (status.ok()) status = encoder_->skip(lost_);
  if (status.ok()) lost_ = 0;
  return status;
}

void LiveEncoder::count(const Prepared& prepared) {
  const LiveWindow& window = prepared.window;
  const std::lock_guard lock(mutex_);
  ++report_.windows;
  report_.frames += window.frames;
  report_.missing += window.missing;
  if (!window.written) report_.lost_frames += window.frames;
  report_.primitives += window.primitives;
  report_.persistent = window.written ? window.persistent : report_.persistent;
  report_.bytes += window.bytes;
  report_.scale += (window.scale - report_.scale) * window.frames / report_.frames;
  if (window.psnr == 0) return;
  measured_frames_ += window.frames;
  report_.psnr += (window.psnr - report_.psnr) * window.frames / measured_frames_;
}

}  // namespace stgs::encoder
