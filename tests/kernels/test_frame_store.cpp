// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <chrono>
#include <random>
#include <thread>

#include "catch.h"
#include "half_size.h"
#include "train/frame_store.h"
#include "train/view_order.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

constexpr int kWidth = 20, kHeight = 18;
constexpr std::uint64_t kFull = 3 * kWidth * kHeight, kHalf = kFull / 4;

Image8 image_of(std::size_t view) {
  Image8 image{kWidth, kHeight, 3, {}};
  std::mt19937 random(static_cast<unsigned>(view));
  for (std::uint64_t i = 0; i < kFull; ++i) image.data.push_back(random() & 0xFF);
  return image;
}

// A source of views that counts how often each is decoded.
struct Views {
  explicit Views(std::size_t count) : decoded(count) {}

  FrameStore::Source source() {
    FrameStore::Source source;
    source.views.assign(decoded.size(), {kWidth, kHeight});
    source.decode = [this](std::size_t view) -> Result<FrameStore::ImagePtr> {
      if (slow) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      ++decoded[view];
      if (view == broken) return invalid_file("frames/{}.png: is damaged", view);
      return std::make_shared<const Image8>(image_of(view));
    };
    return source;
  }
  int total() const {
    int sum = 0;
    for (const auto& count : decoded) sum += count;
    return sum;
  }

  std::vector<std::atomic<int>> decoded;
  std::size_t broken = ~std::size_t{0};
  bool slow = false;
};

std::vector<std::uint64_t> order_of(std::size_t views, int epochs, int level) {
  ViewOrder order(5, views);
  std::vector<std::uint64_t> ids;
  for (std::uint64_t i = 0; i < views * static_cast<std::uint64_t>(epochs); ++i) {
    ids.push_back(FrameStore::id_of(order.at(i), level));
  }
  return ids;
}

void check_image(const Result<TrainingImage>& image, std::uint64_t id) {
  REQUIRE(image.ok());
  CHECK(image->id == id);
  const Image8 full = image_of(id / 2);
  CHECK(image->pixels->data == (id % 2 == 1 ? half_size(full) : full).data);
}

// Misses of Belady's algorithm with a cache of `capacity` images that need not retain the image it
// reads.
int min_misses(const std::vector<std::uint64_t>& ids, std::size_t capacity) {
  std::vector<std::size_t> cached;  // positions of the next use
  int misses = 0;
  const auto next_use = [&](std::size_t i) {
    const auto next =
        std::find(ids.begin() + static_cast<std::ptrdiff_t>(i) + 1, ids.end(), ids[i]);
    return static_cast<std::size_t>(next - ids.begin());
  };
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const auto hit = std::find(cached.begin(), cached.end(), i);
    if (hit != cached.end()) {
      cached.erase(hit);
    } else {
      ++misses;
    }
    cached.push_back(next_use(i));
    if (cached.size() > capacity) cached.erase(std::max_element(cached.begin(), cached.end()));
  }
  return misses;
}

}  // namespace

TEST_CASE("acquire() returns the image of each step, whatever the budget") {
  constexpr std::size_t kViews = 40;
  for (const std::uint64_t budget :
       {std::uint64_t{1}, kHalf, kFull, 3 * kFull, 20 * kFull, 49 * kFull, 50 * kFull}) {
    Views views(kViews);
    FrameStore store(views.source(), budget, 3);
    REQUIRE(store.start().ok());
    std::vector<std::uint64_t> ids = order_of(kViews, 3, 1);
    const std::vector<std::uint64_t> fine = order_of(kViews, 3, 0);
    // The resolution changes within an epoch.
    std::copy(fine.begin() + 60, fine.end(), ids.begin() + 60);
    store.announce(ids);
    for (std::size_t i = 0; i < ids.size(); ++i) {
      REQUIRE(store.announced() == ids.size() - i);
      CHECK(store.next() == ids[i]);
      check_image(store.acquire(ids[i]), ids[i]);
    }
    const FrameStatistics statistics = store.statistics();
    CHECK(statistics.budget == budget);
    // The peak may exceed the budget by the image of the caller and those that four threads are
    // decoding.
    CHECK(statistics.peak <= budget + 9 * kFull);
    CHECK(statistics.resident == (budget == 50 * kFull));
    if (statistics.resident) CHECK(views.total() == kViews);
    CHECK(statistics.decoded == static_cast<std::uint64_t>(views.total()));
  }
}

TEST_CASE("the image that is needed last is evicted first") {
  constexpr std::size_t kViews = 60;
  for (const std::size_t capacity : {10, 30, 45}) {
    Views views(kViews);
    FrameStore store(views.source(), capacity * kFull, 2);
    REQUIRE(store.start().ok());
    const std::vector<std::uint64_t> ids = order_of(kViews, 8, 0);
    store.announce(ids);
    for (const std::uint64_t id : ids) check_image(store.acquire(id), id);
    // Prefetching takes capacity from the cache and so costs some hits.
    const int fewest_possible = min_misses(ids, capacity);
    INFO(capacity << ": " << views.total() << " of " << ids.size() << ", at least "
                  << fewest_possible);
    CHECK(views.total() >= fewest_possible);
    CHECK(views.total() <= 1.25 * fewest_possible);
    CHECK(views.total() < static_cast<int>(ids.size()));
  }
}

TEST_CASE("an acquired image outlives its eviction from the store") {
  Views views(8);
  FrameStore store(views.source(), 2 * kFull, 1);
  REQUIRE(store.start().ok());
  const std::vector<std::uint64_t> ids = order_of(8, 3, 0);
  store.announce(ids);
  std::vector<Result<TrainingImage>> acquired;
  for (const std::uint64_t id : ids) acquired.push_back(store.acquire(id));
  for (std::size_t i = 0; i < ids.size(); ++i) check_image(acquired[i], ids[i]);
  CHECK(store.statistics().peak >= 8 * kFull);  // all eight images at once, whatever the budget
}

TEST_CASE("images that were not announced can be acquired too") {
  Views views(6);
  FrameStore store(views.source(), 3 * kFull, 2);
  REQUIRE(store.start().ok());
  check_image(store.acquire(4), 4);
  CHECK(store.next() == kNeverUsed);
  store.announce({0, 2, 4, 6});
  check_image(store.acquire(11), 11);
  CHECK(store.next() == 0);
  for (const std::uint64_t id : {0, 2, 4, 6}) check_image(store.acquire(id), id);
}

TEST_CASE("a frame that cannot be read fails the step that needs it") {
  for (const std::uint64_t budget : {2 * kFull, 1000 * kFull}) {
    Views views(10);
    views.broken = 7;
    FrameStore store(views.source(), budget, 2);
    const Status started = store.start();
    if (budget > 10 * kFull) {
      CHECK(started.message() == "frames/7.png: is damaged");
      continue;
    }
    REQUIRE(started.ok());
    store.announce({0, 2, 4, 14, 6});
    for (const std::uint64_t id : {0, 2, 4}) check_image(store.acquire(id), id);
    const Result<TrainingImage> broken = store.acquire(14);
    CHECK(broken.status().code() == StatusCode::kInvalidFile);
    CHECK(broken.status().message() == "frames/7.png: is damaged");
    check_image(store.acquire(6), 6);
  }
}

TEST_CASE("loading all frames reports its progress and can be stopped") {
  constexpr std::size_t kViews = 100;
  Views views(kViews);
  FrameStore store(views.source(), 1000 * kFull, 3);
  const std::thread::id caller = std::this_thread::get_id();
  std::vector<std::size_t> progress;
  REQUIRE(store
              .start([&](std::size_t loaded) {
                CHECK(std::this_thread::get_id() == caller);
                CHECK(views.total() == static_cast<int>(loaded));
                progress.push_back(loaded);
                return true;
              })
              .ok());
  CHECK(progress.size() > 5);
  CHECK(std::is_sorted(progress.begin(), progress.end()));
  CHECK(progress.back() == kViews);

  Views others(kViews);
  FrameStore stopped(others.source(), 1000 * kFull, 3);
  const Status status = stopped.start([](std::size_t loaded) { return loaded < 20; });
  CHECK(status.code() == StatusCode::kRuntime);
  CHECK(status.message().find("of 100 frames were loaded") != std::string::npos);
  CHECK(others.total() < 40);
}

TEST_CASE("a store can be destroyed while it is decoding") {
  for (int i = 0; i < 20; ++i) {
    Views views(30);
    views.slow = true;
    FrameStore store(views.source(), 10 * kFull, 4);
    REQUIRE(store.start().ok());
    const std::vector<std::uint64_t> ids = order_of(30, 1, 0);
    store.announce(ids);
    for (int k = 0; k < i; ++k) check_image(store.acquire(ids[k]), ids[k]);
    if (i % 3 == 0) store.announce(order_of(30, 2, 1));
  }
}
