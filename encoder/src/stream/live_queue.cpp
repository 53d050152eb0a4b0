// SPDX-License-Identifier: Apache-2.0
#include "live_queue.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace stgs::encoder {
namespace {

constexpr auto kPoll = std::chrono::milliseconds(10);  // for the grace time, which nobody signals

std::uint64_t bytes_of(const LiveFrame& frame) {
  std::uint64_t sum = 0;
  for (const auto& image : frame.images) sum += image ? image->data.size() : 0;
  return sum;
}

}  // namespace

LiveQueue::LiveQueue(std::size_t cameras, double fps, std::uint64_t max_bytes)
    : fps_(fps),
      grace_(std::max(kGraceSeconds, 2 / fps)),
      max_bytes_(max_bytes),
      cameras_(cameras) {}

std::int64_t LiveQueue::slot_of(double seconds) const {
  return std::llround((seconds - *origin_) * fps_);
}

void LiveQueue::push(std::size_t camera, double seconds, std::shared_ptr<const Image8> image,
                     double now) {
  const std::lock_guard lock(mutex_);
  CameraState& state = cameras_[camera];
  ++received_;
  if (!state.takes_part || state.ended) return;
  if (!origin_) origin_ = seconds;
  const std::int64_t slot = slot_of(seconds);
  state.arrived = now;
  if (slot < first_slot_) {
    dropped_.late += started_ ? 1 : 0;
    return;
  }
  const auto ahead = static_cast<std::int64_t>(kMaxAheadSeconds * fps_);
  std::int64_t others = first_slot_;
  for (const CameraState& other : cameras_) others = std::max(others, other.latest);
  if (slot > others + ahead) {
    ++dropped_.ahead;
    return;
  }
  if (bytes_ + image->data.size() > max_bytes_) {
    ++dropped_.overflow;
    state.latest = std::max(state.latest, slot);
    return;
  }
  while (first_slot_ + static_cast<std::int64_t>(slots_.size()) <= slot) {
    slots_.emplace_back();
    slots_.back().images.resize(cameras_.size());
  }
  LiveFrame& frame = slots_[static_cast<std::size_t>(slot - first_slot_)];
  state.latest = std::max(state.latest, slot);
  if (frame.images[camera]) {
    ++dropped_.repeated;
    return;
  }
  bytes_ += image->data.size();
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

std::vector<bool> LiveQueue::start(double deadline, const std::function<double()>& now) {
  std::unique_lock lock(mutex_);
  while (true) {
    const bool late = now() >= deadline || all_ended();
    std::size_t best = 0, most = 0;
    for (std::size_t s = 0; s < slots_.size() && most < cameras_.size(); ++s) {
      const auto present = std::count_if(slots_[s].images.begin(), slots_[s].images.end(),
                                         [](const auto& image) { return image != nullptr; });
      if (static_cast<std::size_t>(present) > most)
        best = s, most = static_cast<std::size_t>(present);
    }
    const bool is_full = most == cameras_.size();
    if (is_full || (late && most >= 2)) {
      for (std::size_t s = 0; s < best; ++s) {
        bytes_ -= bytes_of(slots_.front());
        slots_.pop_front();
      }
      first_slot_ += static_cast<std::int64_t>(best);
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
  while (complete(now()) < min && !all_ended()) changed_.wait_for(lock, kPoll);
  LiveFrames out;
  out.first = static_cast<int>(first_slot_ - start_slot_);
  const int count = std::min(complete(now()), max);
  for (int i = 0; i < count; ++i) {
    bytes_ -= bytes_of(slots_.front());
    out.frames.push_back(std::move(slots_.front()));
    slots_.pop_front();
  }
  first_slot_ += count;
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
