// SPDX-License-Identifier: Apache-2.0
#include "fetch/connection_pool.h"

#include <algorithm>
#include <chrono>

namespace stgs::player {

// Waits for the turn of a ticket; kOpen if it has come.
ConnectionPool::Lease::Outcome ConnectionPool::wait(std::uint64_t ticket,
                                                    const std::function<bool()>& is_wanted,
                                                    std::unique_lock<std::mutex>& lock) {
  using Seconds = std::chrono::duration<double>;
  const auto is_turn = [&] {
    return *waiting_.begin() == ticket && (!free_.empty() || opened_ < settings_.max_connections);
  };
  // Bytes that other reads receive extend the wait, but they cannot be saved up: it never has more
  // than request_seconds left.
  auto last = Deadline::Clock::now();
  double left = settings_.request_seconds;
  std::uint64_t received = received_;
  while (!is_turn()) {
    if (settings_.stop.stop_requested()) return Lease::Outcome::kStopped;
    freed_.wait_for(lock, settings_.stop, kPollInterval, is_turn);
    const auto now = Deadline::Clock::now();
    const std::uint64_t arrived = received_ - received;
    received += arrived;
    left += static_cast<double>(arrived) / settings_.min_bytes_per_second -
            Seconds(now - std::exchange(last, now)).count();
    left = std::min(left, settings_.request_seconds);
    lock.unlock();
    const bool is_stopped = !is_wanted();
    lock.lock();
    if (is_stopped) return Lease::Outcome::kStopped;
    if (left <= 0 && !is_turn()) return Lease::Outcome::kTimedOut;
  }
  return settings_.stop.stop_requested() ? Lease::Outcome::kStopped : Lease::Outcome::kOpen;
}

ConnectionPool::Lease::Lease(ConnectionPool& pool, const std::function<bool()>& is_wanted)
    : pool_(pool) {
  std::unique_lock lock(pool.mutex_);
  const std::uint64_t ticket = pool.next_ticket_++;
  pool.waiting_.insert(ticket);
  outcome_ = pool.wait(ticket, is_wanted, lock);
  pool.waiting_.erase(ticket);
  if (outcome_ == Outcome::kOpen && !pool.free_.empty()) {
    connection_ = std::move(pool.free_.back());
    pool.free_.pop_back();
  } else if (outcome_ == Outcome::kOpen) {
    connection_ = Connection::open(pool.url_, pool.settings_, pool.received_);
    if (connection_ != nullptr) ++pool.opened_;
  }
  if (outcome_ == Outcome::kOpen && connection_ == nullptr) outcome_ = Outcome::kOutOfMemory;
  pool.freed_.notify_all();  // the next ticket may have its turn
}

ConnectionPool::Lease::~Lease() {
  if (connection_ == nullptr) return;
  const std::lock_guard lock(pool_.mutex_);
  pool_.free_.push_back(std::move(connection_));
  pool_.freed_.notify_all();
}

}  // namespace stgs::player
