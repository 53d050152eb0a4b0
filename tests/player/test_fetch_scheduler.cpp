// SPDX-License-Identifier: Apache-2.0
// The order in which segment layers are read, on a simulated link.
#include <cmath>
#include <limits>

#include "residency_fixture.h"
#include "stream/fetch_scheduler.h"

namespace stgs::player {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
using Progress = FetchScheduler::Progress;

struct SchedulerUnits : StoreUnits {
  using StoreUnits::StoreUnits;

  // Returns the next request with its first read in flight; null: none.
  FetchRequest* begin() {
    next = fetches.next(now);
    if (next.request != nullptr) fetches.begin_read(*next.request, now);
    return next.request;
  }
  // Receives all bytes of a request at `seconds` per read.
  void receive(FetchRequest& request, double seconds = 0) {
    for (;;) {
      now += seconds;
      busy += seconds;
      const Progress progress = fetches.end_read(request, true, busy);
      if (progress == Progress::kMore) {
        fetches.begin_read(request, now);
        continue;
      }
      REQUIRE(progress == Progress::kComplete);
      fetches.finish(request, true);
      return;
    }
  }

  double now = 1000, busy = 0;
  FetchScheduler fetches{index, deadlines, residency, {10, 0.3}};
  FetchScheduler::Next next;
};

TEST_CASE("requests follow the deadlines of their layers, in every direction and around a loop") {
  struct Trace {
    double ticks, rate;
    bool loop, stationary;
  };
  for (const Trace& trace :
       {Trace{0, 1, false, false}, Trace{60, 1, false, true}, Trace{89, -1, false, false},
        Trace{45, -2, true, false}, Trace{70, 1, true, false}, Trace{30, 0.25, false, true}}) {
    CAPTURE(trace.ticks, trace.rate, trace.loop, trace.stationary);
    SchedulerUnits units;
    units.play_at(trace.ticks, trace.rate, trace.loop, trace.stationary);
    std::size_t layers = 0;
    double last = 0;
    while (FetchRequest* request = units.begin()) {
      const double first = units.deadlines.deadline(request->layers[0].layer);
      CHECK(first >= last);
      last = first;
      std::uint64_t end = request->offset;
      for (const LocatedLayer& one : request->layers) {
        ++layers;
        CHECK(one.offset >= end);  // in file order
        end = one.offset + one.bytes;
        // Layers that delay the first one are about as urgent.
        CHECK(units.deadlines.deadline(one.layer) <= (first <= 0 ? 0 : first + 1));
        CHECK(units.deadlines.need(one.layer.segment).from <= 10);
        if (one.layer.sh)
          CHECK(units.residency.state({one.layer.segment, false}) != LoadState::kMissing);
      }
      CHECK(request->offset + request->bytes == end);
      units.receive(*request);
    }
    // Everything within the prefetch horizon, and nothing else.
    std::size_t expected = 0;
    for (const SegmentLayer& layer : units.index.file_order())
      expected += units.deadlines.need(layer.segment).from <= 10 ? 1 : 0;
    CHECK(layers == expected);
    CHECK(units.next.wake_at == kNever);
  }
}

TEST_CASE("nothing is fetched before the position is known") {
  StoreUnits units;
  const Deadlines unknown(units.index, 1.0);
  FetchScheduler fetches(units.index, unknown, units.residency, {10, 0.3});
  CHECK(fetches.next(0).request == nullptr);
  CHECK(fetches.next(0).wake_at == kNever);
}

TEST_CASE("a layer that the viewer waits for has the link to itself for a second") {
  SchedulerUnits units;
  units.play_at(45, 1, false, true);
  std::vector<FetchRequest*> requests;
  while (FetchRequest* request = units.begin()) requests.push_back(request);
  REQUIRE_FALSE(requests.empty());
  for (const FetchRequest* request : requests)
    CHECK(units.deadlines.deadline(request->layers[0].layer) <= 0);
  CHECK(units.next.wake_at == units.now + 1);
  units.now += 1;
  const FetchRequest* later = units.begin();
  REQUIRE(later != nullptr);
  CHECK(units.deadlines.deadline(later->layers[0].layer) > 0);
}

TEST_CASE("after a seek, a read that nobody waits for is interrupted after half a second") {
  SchedulerUnits units;
  units.play_at(0, 1, false, true);
  FetchRequest* request = units.begin();
  while (units.deadlines.need(request->layers[0].layer.segment).from == 0 &&
         units.index.info(request->layers[0].layer.segment).end_ticks > 10) {
    units.receive(*request);
    request = units.begin();
    REQUIRE(request != nullptr);
  }
  double wake_at = kNever;
  CHECK(units.fetches.next_cancelled(units.now + 100, wake_at) == nullptr);  // no seek yet
  CHECK(wake_at == kNever);
  units.play_at(80, 1, false, true);
  CHECK(units.fetches.next_cancelled(units.now + 0.4, wake_at) == nullptr);
  CHECK(wake_at == units.now + 0.5);
  REQUIRE(units.fetches.next_cancelled(units.now + 0.5, wake_at) == request);
  CHECK(units.fetches.next_cancelled(units.now + 0.5, wake_at) == nullptr);  // only once
  const SegmentLayer layer = request->layers[0].layer;
  CHECK(units.fetches.end_read(*request, false, units.busy) == Progress::kGivenUp);
  units.fetches.finish(*request, false);
  CHECK(units.residency.state(layer) == LoadState::kMissing);
  CHECK(units.used() == [&] {
    std::uint64_t sum = 0;
    for (const SegmentLayer& one : units.index.file_order())
      sum += units.residency.charged_bytes(one);
    return sum;
  }());
}

TEST_CASE("a read that fails without a seek fails its layers") {
  SchedulerUnits units;
  FetchRequest* request = units.begin();
  REQUIRE(request != nullptr);
  CHECK(units.fetches.in_flight() == 1);
  CHECK(units.fetches.end_read(*request, false, units.busy) == Progress::kFailed);
  CHECK(units.fetches.bytes_per_second() == 0);
  const std::list<FetchRequest> own = units.fetches.finish(*request, false);
  REQUIRE(own.size() == 1);
  CHECK(units.fetches.in_flight() == 0);
  for (const LocatedLayer& one : own.front().layers) {
    CHECK(units.residency.state(one.layer) == LoadState::kMissing);
    units.residency.failed(one.layer, false, units.now);
  }
  // The other layers, then a wait for the retry.
  while (FetchRequest* other = units.begin()) {
    CHECK(other->offset != own.front().offset);
    units.receive(*other);
  }
  CHECK(units.next.wake_at == units.now + 0.5);
  units.now += 0.5;
  FetchRequest* again = units.begin();
  REQUIRE(again != nullptr);
  CHECK(again->offset == own.front().offset);
}

TEST_CASE("a request is read in parts of a quarter of a second, which add up to it") {
  SchedulerUnits units;
  units.play_at(0, 1, false, true);
  FetchRequest* request = units.begin();
  const std::uint64_t bytes = request->bytes;
  CHECK(request->read_bytes == std::min<std::uint64_t>(bytes, 1 << 20));
  units.receive(*request, 0.1);
  CHECK(units.fetches.fetched_bytes() == bytes);
  // A link of 1 kB/s: reads have at least 64 kB all the same.
  while ((request = units.begin()) != nullptr) {
    CHECK(request->read_bytes == std::min<std::uint64_t>(request->bytes, 64 << 10));
    units.receive(*request, static_cast<double>(request->bytes) / 1000);
    if (units.fetches.fetched_bytes() > 50000) break;
  }
  CHECK(units.fetches.bytes_per_second() > 0);
}

TEST_CASE("the results of an earlier generation change nothing") {
  SchedulerUnits units;
  FetchRequest* request = units.begin();
  REQUIRE(request != nullptr);
  auto other = encode_scene(testing::random_scene(500, 1, kFrames, 9), {});
  REQUIRE(other.ok());
  units.adopt(open_bytes(*other));
  CHECK(units.used() == 0);
  double wake_at = kNever;
  CHECK(units.fetches.next_cancelled(units.now + 1, wake_at) == request);
  (void)units.fetches.end_read(*request, true, units.busy);
  units.fetches.finish(*request, true);
  CHECK(units.used() == 0);
  for (const SegmentLayer& one : units.index.file_order())
    CHECK(units.residency.state(one) == LoadState::kMissing);
}

TEST_CASE("a base that playback waits for and that does not fit is reported") {
  SchedulerUnits units(1000);
  CHECK(units.begin() == nullptr);
  REQUIRE(units.next.too_large);
  CHECK(units.index.layer_number(*units.next.too_large) == 0);
  CHECK(units.residency.is_complete(0));
  units.residency.failed(*units.next.too_large, false, units.now);
  CHECK(units.used() == 0);
}

}  // namespace
}  // namespace stgs::player
