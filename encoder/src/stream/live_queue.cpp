// SPDX-License-Identifier: Apache-2.0
#include "live_queue.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace stgs::encoder {
namespace {

constexpr auto kPoll = std::chrono::milliseconds(10);  // for the grace time, which nobody signals

}  // namespace

LiveQueue::LiveQueue(std::size_t cameras, double fps, std::uint64_t max_bytes)
    : fps_(fps),
      grace_(std::max(kGraceSeconds, 2 / fps)),
      max_images_(static_cast<std::size_t>(static_cast<double>(cameras) *
                                           std::ceil(kMaxWaitingSeconds * fps))),
      max_bytes_(max_bytes),
      cameras_(cameras) {}

std::int64_t LiveQueue::accept(std::size_t camera, double seconds, double now) {
  if (std::isfinite(seconds) && !origin_) {
    origin_ = seconds;
    origin_now_ = now;
  }
  // In frames after slot 0. Also false for a time that is not a number.
  const double exact = origin_ ? (seconds - *origin_) * fps_ : 0;
  auto latest = static_cast<std::int64_t>((now - origin_now_) * fps_);
  for (std::size_t c = 0; c < cameras_.size(); ++c)
    if (c != camera) latest = std::max(latest, cameras_[c].latest);
  if (!(exact <= static_cast<double>(latest) + kMaxAheadSeconds * fps_)) {
    ++dropped_.ahead;
    return -1;
  }
  if (exact < static_cast<double>(first_slot_) - 0.5) {
    dropped_.late += started_ ? 1 : 0;
    return -1;
  }
  std::int64_t slot = std::llround(exact);
  const std::int64_t end = first_slot_ + static_cast<std::int64_t>(slots_.size());
  const std::int64_t pause = slot - end - static_cast<std::int64_t>(kMaxPauseSeconds * fps_);
  if (pause > 0) {
    *origin_ += static_cast<double>(pause) / fps_;
    origin_now_ += static_cast<double>(pause) / fps_;
    slot -= pause;
  }
  return std::max(slot, first_slot_);
}

bool LiveQueue::fits(std::size_t bytes) const {
  return images_ < max_images_ && bytes_ + bytes <= max_bytes_;
}

void LiveQueue::drop_first() {
  for (const auto& image : slots_.front().images) {
    if (!image) continue;
    bytes_ -= image->data.size();
    --images_;
  }
  slots_.pop_front();
  ++first_slot_;
}

void LiveQueue::push(std::size_t camera, double seconds, std::shared_ptr<const Image8> image,
                     double now) {
  const std::lock_guard lock(mutex_);
  if (camera >= cameras_.size()) return;
  CameraState& state = cameras_[camera];
  ++received_;
  if (!state.takes_part || state.ended) return;
  const std::int64_t slot = accept(camera, seconds, now);
  if (slot < 0) return;
  state.arrived = now;
  state.latest = std::max(state.latest, slot);
  const std::size_t bytes = image->data.size();
  while (!started_ && !fits(bytes) && first_slot_ < slot && !slots_.empty()) drop_first();
  if (!fits(bytes)) {
    ++dropped_.overflow;
    is_full_ = true;
    changed_.notify_all();
    return;
  }
  while (first_slot_ + static_cast<std::int64_t>(slots_.size()) <= slot) {
    LiveFrame empty;
    empty.images.resize(cameras_.size());
    slots_.push_back(std::move(empty));
  }
  LiveFrame& frame = slots_[static_cast<std::size_t>(slot - first_slot_)];
  if (frame.images[camera]) {
    ++dropped_.repeated;
    return;
  }
  bytes_ += bytes;
  ++images_;
  frame.images[camera] = std::move(image);
  frame.arrived = now;
  changed_.notify_all();
}

void LiveQueue::end(std::size_t camera) {
  const std::lock_guard lock(mutex_);
  cameras_[camera].ended = true;
  changed_.notify_all();
}

void LiveQueue::end_all() {
  const std::lock_guard lock(mutex_);
  for (CameraState& camera : cameras_) camera.ended = true;
  changed_.notify_all();
}

bool LiveQueue::all_ended() const {
  return std::all_of(cameras_.begin(), cameras_.end(),
                     [](const CameraState& c) { return c.ended || !c.takes_part; });
}

std::vector<bool> LiveQueue::start(double wait, const std::function<double()>& now) {
  std::unique_lock lock(mutex_);
  while (true) {
    const bool is_late = all_ended() || (origin_ && now() >= origin_now_ + wait);
    const auto expected = std::count_if(cameras_.begin(), cameras_.end(), [](const CameraState& c) {
      return !c.ended || c.latest >= 0;
    });
    std::ptrdiff_t largest = 1;
    std::size_t best = slots_.size();
    for (std::size_t s = 0; s < slots_.size(); ++s) {
      const auto present = std::count_if(slots_[s].images.begin(), slots_[s].images.end(),
                                         [](const auto& image) { return image != nullptr; });
      // The first one with all cameras; else the latest with most.
      if (present < largest || (present == largest && present == expected)) continue;
      if (present < 2) continue;
      largest = present;
      best = s;
    }
    const bool is_full = best < slots_.size() && largest == expected;
    if (is_full || (is_late && best < slots_.size())) {
      for (std::size_t s = 0; s < best; ++s) drop_first();
      start_slot_ = first_slot_;
      started_ = true;
      std::vector<bool> out;
      for (std::size_t c = 0; c < cameras_.size(); ++c) {
        cameras_[c].takes_part = slots_.front().images[c] != nullptr;
        out.push_back(cameras_[c].takes_part);
      }
      return out;
    }
    if (all_ended()) return {};
    changed_.wait_for(lock, kPoll);
  }
}

int LiveQueue::complete(double now) const {
  std::int64_t end = first_slot_ + static_cast<std::int64_t>(slots_.size());
  for (const CameraState& camera : cameras_) {
    if (!camera.takes_part || camera.ended || now - camera.arrived > grace_) continue;
    end = std::min(end, camera.latest + 1);
  }
  return static_cast<int>(std::max<std::int64_t>(0, end - first_slot_));
}

int LiveQueue::ready(double now) const {
  const std::lock_guard lock(mutex_);
  return complete(now);
}

LiveFrames LiveQueue::take(int min, int max, const std::function<double()>& now) {
  std::unique_lock lock(mutex_);
  const auto is_ready = [&] {
    const int complete = this->complete(now());
    return complete >= min || all_ended() || (is_full_ && complete > 0);
  };
  while (!is_ready()) changed_.wait_for(lock, kPoll);
  is_full_ = false;
  LiveFrames out;
  out.first = static_cast<int>(first_slot_ - start_slot_);
  const int count = std::min(complete(now()), max);
  for (int i = 0; i < count; ++i) {
    out.frames.push_back(slots_.front());
    drop_first();
  }
  out.waiting = complete(now());
  return out;
}

LiveDropped LiveQueue::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

std::uint64_t LiveQueue::received() const {
  const std::lock_guard lock(mutex_);
  return received_;
}

}  // namespace stgs::encoder
