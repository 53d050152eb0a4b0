// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/budget.h"

#include <utility>

namespace stgs {
namespace {

void raise(std::atomic<std::uint64_t>& peak, std::uint64_t to) noexcept {
  std::uint64_t before = peak.load();
  while (before < to && !peak.compare_exchange_weak(before, to)) {
  }
}

}  // namespace

std::optional<Lease> Budget::try_charge(Pool pool, std::uint64_t bytes) noexcept {
  Account& own = account(pool);
  std::uint64_t used = own.used.load();
  do {
    if (used > own.limit || bytes > own.limit - used) return std::nullopt;
  } while (!own.used.compare_exchange_weak(used, used + bytes));
  raise(own.peak, used + bytes);
  return Lease(*this, pool, bytes);
}

Lease Budget::charge(Pool pool, std::uint64_t bytes) noexcept {
  add(pool, bytes);
  return Lease(*this, pool, bytes);
}

void Budget::add(Pool pool, std::uint64_t bytes) noexcept {
  Account& own = account(pool);
  raise(own.peak, own.used += bytes);
}

std::uint64_t Budget::available(Pool pool) const noexcept {
  const Account& own = account(pool);
  const std::uint64_t used = own.used.load();
  return used < own.limit ? own.limit - used : 0;
}

Budget::Usage Budget::usage(Pool pool) const noexcept {
  const Account& own = account(pool);
  return {own.used.load(), own.peak.load(), own.limit};
}

Lease::Lease(Lease&& other) noexcept
    : budget_(std::exchange(other.budget_, nullptr)),
      pool_(other.pool_),
      bytes_(std::exchange(other.bytes_, 0)) {}

Lease& Lease::operator=(Lease&& other) noexcept {
  if (this == &other) return *this;
  resize(0);
  budget_ = std::exchange(other.budget_, nullptr);
  pool_ = other.pool_;
  bytes_ = std::exchange(other.bytes_, 0);
  return *this;
}

void Lease::resize(std::uint64_t bytes) noexcept {
  if (budget_ == nullptr) return;
  if (bytes > bytes_) budget_->add(pool_, bytes - bytes_);
  if (bytes < bytes_) budget_->subtract(pool_, bytes_ - bytes);
  bytes_ = bytes;
}

void Lease::merge(Lease other) noexcept {
  if (budget_ == nullptr) {
    *this = std::move(other);
    return;
  }
  bytes_ += std::exchange(other.bytes_, 0);
}

void WorkingMemory::use(std::shared_ptr<Budget> budget, Budget::Pool pool) {
  if (budget == budget_ && pool == pool_) return;
  lease_ = budget != nullptr ? budget->charge(pool, bytes_) : Lease();
  budget_ = std::move(budget);
  pool_ = pool;
}

bool WorkingMemory::try_charge(std::uint64_t bytes) noexcept {
  const std::lock_guard lock(mutex_);
  if (budget_ != nullptr) {
    std::optional<Lease> more = budget_->try_charge(pool_, bytes);
    if (!more) return false;
    lease_.merge(std::move(*more));
  }
  bytes_ += bytes;
  return true;
}

void WorkingMemory::release(std::uint64_t bytes) noexcept {
  const std::lock_guard lock(mutex_);
  bytes_ -= bytes;
  lease_.resize(bytes_);
}

std::uint64_t WorkingMemory::bytes() const noexcept {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

std::uint64_t WorkingMemory::limit() const noexcept {
  return budget_ != nullptr ? budget_->usage(pool_).limit : Budget::kNoLimit;
}

}  // namespace stgs
