// SPDX-License-Identifier: Apache-2.0
// Accounts for the memory of a player or a reader, by purpose.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>

namespace stgs {

class Lease;

// Limits and counts memory by pool. Does not allocate. Thread-safe; outlives its leases.
class Budget {
 public:
  // The purposes of memory, each with a limit of its own.
  enum class Pool {
    kSegments,       // fetched and decoded segments
    kDecodeScratch,  // working memory of decoders
    kTransfers,      // bytes in flight, and bytes read that no segment has taken over yet
    kIndex,          // the opened index, and cached bytes of it
    kImport,         // everything that reading another format takes
    kRenderer,       // images and working memory of renderers, in host and device memory
    kDeviceCopies,   // copies of segments in device memory
    kCount
  };
  static constexpr std::uint64_t kNoLimit = std::numeric_limits<std::uint64_t>::max();

  // The memory of a pool, bytes.
  struct Usage {
    std::uint64_t used = 0;
    std::uint64_t peak = 0;  // largest value of `used` so far
    std::uint64_t limit = kNoLimit;
  };

  Budget() = default;
  Budget(const Budget&) = delete;
  Budget& operator=(const Budget&) = delete;

  // Sets the limit of a pool. Charges beyond it stay. Call it before other threads use the budget.
  void set_limit(Pool pool, std::uint64_t bytes) noexcept { account(pool).limit = bytes; }
  // Charges `bytes`, or returns nothing if they exceed the limit of the pool.
  std::optional<Lease> try_charge(Pool pool, std::uint64_t bytes) noexcept;
  // Charges `bytes` that are needed in any case, even beyond the limit.
  Lease charge(Pool pool, std::uint64_t bytes) noexcept;
  // Returns whether try_charge() would accept `bytes` now.
  bool fits(Pool pool, std::uint64_t bytes) const noexcept { return bytes <= available(pool); }
  // Returns the bytes that can still be charged.
  std::uint64_t available(Pool pool) const noexcept;
  // Returns the memory of a pool.
  Usage usage(Pool pool) const noexcept;

 private:
  friend class Lease;
  struct Account {
    std::atomic<std::uint64_t> used{0}, peak{0};
    std::uint64_t limit = kNoLimit;
  };

  Account& account(Pool pool) noexcept { return accounts_[static_cast<std::size_t>(pool)]; }
  const Account& account(Pool pool) const noexcept {
    return accounts_[static_cast<std::size_t>(pool)];
  }
  void add(Pool pool, std::uint64_t bytes) noexcept;
  void subtract(Pool pool, std::uint64_t bytes) noexcept { account(pool).used -= bytes; }

  std::array<Account, static_cast<std::size_t>(Pool::kCount)> accounts_;
};

// A charge to a budget, which ends with this object. One thread at a time.
class Lease {
 public:
  // Charges nothing.
  Lease() = default;
  Lease(Lease&& other) noexcept;
  Lease& operator=(Lease&& other) noexcept;
  ~Lease() { resize(0); }

  // Returns the bytes charged.
  std::uint64_t bytes() const noexcept { return bytes_; }
  // Changes the bytes charged, even beyond the limit of the pool. A default lease stays empty.
  void resize(std::uint64_t bytes) noexcept;
  // Takes over the charge of another lease of the same pool and budget.
  void merge(Lease other) noexcept;

 private:
  friend class Budget;
  Lease(Budget& budget, Budget::Pool pool, std::uint64_t bytes) noexcept
      : budget_(&budget), pool_(pool), bytes_(bytes) {}

  Budget* budget_ = nullptr;
  Budget::Pool pool_ = Budget::Pool::kSegments;
  std::uint64_t bytes_ = 0;
};

// Memory that an object charges step by step, and retains between uses. Thread-safe, except use().
class WorkingMemory {
 public:
  // Charges to a pool from now on, including the present charge, even beyond the limit. Until the
  // first call, the memory is counted but not limited.
  void use(std::shared_ptr<Budget> budget, Budget::Pool pool);
  // Charges `bytes`, or returns false if they exceed the limit of the pool.
  bool try_charge(std::uint64_t bytes) noexcept;
  // Ends the charge of `bytes`.
  void release(std::uint64_t bytes) noexcept;
  // Returns the bytes charged.
  std::uint64_t bytes() const noexcept;
  // Returns the limit of the pool.
  std::uint64_t limit() const noexcept;

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<Budget> budget_;  // outlives `lease_`
  Budget::Pool pool_ = Budget::Pool::kRenderer;
  Lease lease_;  // of `bytes_`, if there is a budget
  std::uint64_t bytes_ = 0;
};

}  // namespace stgs
