// SPDX-License-Identifier: Apache-2.0
// Accounting of memory.
#include <atomic>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "catch.h"
#include "stgs/format/budget.h"

namespace stgs {
namespace {

using Pool = Budget::Pool;

TEST_CASE("a budget limits each pool separately") {
  Budget budget;
  budget.set_limit(Pool::kSegments, 100);
  std::optional<Lease> first = budget.try_charge(Pool::kSegments, 60);
  REQUIRE(first);
  CHECK(budget.available(Pool::kSegments) == 40);
  CHECK_FALSE(budget.try_charge(Pool::kSegments, 41));
  CHECK(budget.try_charge(Pool::kSegments, 40));  // and ends at once
  CHECK(budget.usage(Pool::kSegments).used == 60);
  CHECK(budget.usage(Pool::kSegments).peak == 100);
  CHECK(budget.usage(Pool::kSegments).limit == 100);
  CHECK(budget.try_charge(Pool::kIndex, 1u << 30));
  CHECK(budget.usage(Pool::kIndex).used == 0);
  first.reset();
  CHECK(budget.usage(Pool::kSegments).used == 0);
}

TEST_CASE("memory that is needed in any case is charged beyond the limit") {
  Budget budget;
  budget.set_limit(Pool::kDecodeScratch, 10);
  const Lease large = budget.charge(Pool::kDecodeScratch, 50);
  CHECK(budget.usage(Pool::kDecodeScratch).used == 50);
  CHECK(budget.available(Pool::kDecodeScratch) == 0);
  CHECK_FALSE(budget.try_charge(Pool::kDecodeScratch, 0));
  CHECK_FALSE(budget.fits(Pool::kDecodeScratch, 1));
}

TEST_CASE("a lease is charged once, wherever it is moved") {
  Budget budget;
  const auto used = [&] { return budget.usage(Pool::kTransfers).used; };
  Lease lease = budget.charge(Pool::kTransfers, 8);
  Lease other = std::move(lease);
  CHECK(lease.bytes() == 0);
  CHECK(other.bytes() == 8);
  CHECK(used() == 8);
  other.resize(20);
  CHECK(used() == 20);
  other.resize(5);
  CHECK(used() == 5);
  other = budget.charge(Pool::kTransfers, 3);
  CHECK(used() == 3);
  other = Lease();
  CHECK(used() == 0);
  other.resize(100);  // charges nothing: it belongs to no budget
  CHECK(used() == 0);
  CHECK(budget.usage(Pool::kTransfers).peak == 20);
}

TEST_CASE("working memory is charged in steps, and moves to another budget") {
  const auto one = std::make_shared<Budget>(), other = std::make_shared<Budget>();
  one->set_limit(Pool::kRenderer, 100);
  other->set_limit(Pool::kRenderer, 50);
  {
    WorkingMemory memory;
    CHECK(memory.try_charge(30));  // not limited yet
    CHECK(memory.limit() == Budget::kNoLimit);
    memory.use(one, Pool::kRenderer);
    CHECK(one->usage(Pool::kRenderer).used == 30);
    CHECK_FALSE(memory.try_charge(71));
    CHECK(memory.try_charge(70));
    CHECK(memory.bytes() == 100);
    CHECK(memory.limit() == 100);
    memory.release(20);
    memory.use(other, Pool::kRenderer);  // beyond its limit
    CHECK(one->usage(Pool::kRenderer).used == 0);
    CHECK(other->usage(Pool::kRenderer).used == 80);
    CHECK_FALSE(memory.try_charge(1));
    memory.release(40);
    CHECK(memory.try_charge(10));
  }
  CHECK(other->usage(Pool::kRenderer).used == 0);
}

TEST_CASE("threads that charge one pool never exceed its limit together") {
  Budget budget;
  constexpr std::uint64_t kLimit = 10;
  budget.set_limit(Pool::kSegments, kLimit);
  std::atomic<int> charged{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int k = 0; k < 2000; ++k) {
        if (budget.try_charge(Pool::kSegments, 1 + static_cast<std::uint64_t>(k) % 4)) ++charged;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  CHECK(charged > 0);
  CHECK(budget.usage(Pool::kSegments).peak <= kLimit);
  CHECK(budget.usage(Pool::kSegments).used == 0);
}

}  // namespace
}  // namespace stgs
