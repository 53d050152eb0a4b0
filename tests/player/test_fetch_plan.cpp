// SPDX-License-Identifier: Apache-2.0
// The most urgent layers are found without looking at all of them, and are the right ones.
#include <cmath>
#include <limits>
#include <random>

#include "residency_fixture.h"
#include "stream/decode_queue.h"
#include "stream/fetch_scheduler.h"
#include "stream/urgency_tree.h"

namespace stgs::player {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kPrefetch = 1.2;  // seconds: a part of the clip

// Returns the bytes of a clip of many small segments.
std::vector<std::uint8_t> many_segments() {
  WriteSettings settings;
  settings.chunk_seconds = 1.0 / 30;
  auto encoded = encode_scene(testing::random_scene(3000, 1, kFrames, 5), settings);
  REQUIRE(encoded.ok());
  return std::move(*encoded);
}

struct PlanUnits : StoreUnits {
  using StoreUnits::StoreUnits;

  double speed() const { return fetches.bytes_per_second(); }

  bool can_fetch(const SegmentLayer& layer) const {
    const LoadState state = residency.state(layer), base = residency.state({layer.segment, false});
    const bool is_due = state == LoadState::kMissing ||
                        (state == LoadState::kFailed && now >= residency.retry_at(layer));
    return index.info(layer.segment).is_needed() && is_due &&
           (!layer.sh || base == LoadState::kResident || base == LoadState::kInFlight) &&
           deadlines.need(layer.segment).from <= kPrefetch;
  }
  bool in_time(const SegmentLayer& layer) const {
    return index.layer_number(layer) == 0 || speed() == 0 ||
           static_cast<double>(index.stored_bytes(layer)) / speed() <=
               deadlines.need(layer.segment).until;
  }
  // Returns the layer that the next request has to begin with, by looking at all layers.
  std::optional<SegmentLayer> expected() const {
    std::optional<SegmentLayer> best, late;
    const auto is_better = [&](const SegmentLayer& one, const std::optional<SegmentLayer>& than) {
      return !than || deadlines.deadline(one) < deadlines.deadline(*than);
    };
    bool is_exclusive = false;
    for (const FetchRequest* request : requests) {
      is_exclusive |=
          deadlines.deadline(request->layers[0].layer) <= 0 && now < request->started_at + 1;
    }
    for (const SegmentLayer& layer : index.file_order()) {
      if (!can_fetch(layer) || (is_exclusive && deadlines.deadline(layer) > 0)) continue;
      if (in_time(layer) && is_better(layer, best)) best = layer;
      if (is_better(layer, late)) late = layer;
    }
    return best || !requests.empty() ? best : late;
  }
  // Ends the oldest request: complete, given up or failed.
  void end_one(int how) {
    FetchRequest& request = *requests.front();
    requests.erase(requests.begin());
    const auto layers = request.layers;
    while (how == 0) {
      fetches.begin_read(request, now);
      busy += seconds_per_read;
      if (fetches.end_read(request, true, busy) != FetchScheduler::Progress::kMore) break;
    }
    fetches.finish(request, how == 0);
    if (how == 2) {
      for (const LocatedLayer& one : layers) residency.failed(one.layer, one.bytes % 7 == 0, now);
    }
  }

  double now = 1000, busy = 0, seconds_per_read = 0.01;
  FetchScheduler fetches{index, deadlines, residency, {kPrefetch, 0.3}};
  std::vector<FetchRequest*> requests;  // in flight
};

TEST_CASE("each request begins with the most urgent layer, whatever has happened before") {
  std::mt19937 random(17);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  std::size_t begun = 0, late = 0;
  for (int run = 0; run < 6; ++run) {
    PlanUnits units(run % 2 == 0 ? kDefaultMemoryBudget : 300'000);
    for (int step = 0; step < 1500; ++step) {
      units.now += below(4) == 0 ? 0.3 : 0;
      units.seconds_per_read = below(3) == 0 ? 30 : 0.01;
      const int action = below(12);
      if (action == 0) {
        const double rates[] = {1, -1, 0.25, -4};
        units.play_at(below(90), rates[below(4)], below(2) == 0, below(2) == 0);
      } else if (action == 1) {
        units.residency.evict_sh(
            static_cast<std::uint32_t>(below(static_cast<int>(units.index.size()))));
      } else if (action < 6 && !units.requests.empty()) {
        units.end_one(below(3));
      } else if (units.requests.size() < 4) {
        const std::optional<SegmentLayer> expected = units.expected();
        const FetchScheduler::Next next = units.fetches.next(units.now);
        if (next.request == nullptr) {
          // Nothing to fetch, or it does not fit.
          CHECK((!expected || run % 2 == 1));
          continue;
        }
        REQUIRE(expected);
        REQUIRE(next.request->layers[0].layer == *expected);
        ++begun;
        late += units.in_time(*expected) ? 0 : 1;
        units.requests.push_back(next.request);
      }
    }
  }
  CHECK(begun > 500);
  CHECK(late > 10);
}

TEST_CASE("finding the layers to fetch takes about linear time") {
  SegmentIndex index;
  Deadlines deadlines{index, 0.001};  // so that few layers share a request
  Budget budget;
  Residency residency{index, deadlines, budget, 0.5, [](std::uint64_t) {}};
  SegmentIndex::Update update = index.prepare(open_bytes(many_segments()));
  residency.reserve(update.reader->segments().size());
  index.adopt(std::move(update));
  residency.extend();
  deadlines.set_playhead({0, 30, index.duration(), false, true}, true);
  FetchScheduler fetches{index, deadlines, residency, {100, 0.3}};
  std::size_t layers = 0, requests = 0;
  double now = 0;
  for (const bool fails : {true, false}) {
    for (now += 100;;) {
      FetchRequest* request = fetches.next(now).request;
      if (request == nullptr) break;
      const auto own = request->layers;
      layers += own.size();
      ++requests;
      fetches.finish(*request, !fails);
      for (const LocatedLayer& one : own) {
        if (fails) residency.failed(one.layer, false, now);
      }
    }
  }
  CAPTURE(layers, index.size());
  CHECK(layers > index.file_order().size());
  REQUIRE(requests > 30);
  CHECK(fetches.examined_layers() < 8 * layers);  // not `requests` times as many
}

TEST_CASE("finding the segments to decode takes about linear time, and finds the most urgent") {
  class Executor final : public DecodeExecutor {
   public:
    void start(Completion) override {}
    int max_jobs() const override { return 1; }
    void submit(DecodeJob) noexcept override {}
  } executor;
  StoreUnits units;
  DecodeQueue decodes(units.index, units.deadlines, units.residency, units.budget, executor);
  for (const SegmentLayer& layer : units.index.file_order()) REQUIRE(units.fetch(layer));
  units.play_at(45, 1, false, true);  // half of the segments are not needed any more
  double last = 0;
  std::size_t count = 0;
  while (const std::optional<DecodeJob> job = decodes.next()) {
    const double own = units.deadlines.deadline({job->segment, false});
    CHECK(own >= last);
    last = own;
    ++count;
    REQUIRE(decodes.finish(*job));
    units.residency.decoded(job->segment, units.decoded_of(job->segment), true);
  }
  CHECK(count == units.index.size());
  CHECK(last == kNever);
  CHECK(decodes.examined_segments() < 6 * count);
}

TEST_CASE("a tournament returns the most urgent of its first slots") {
  std::mt19937 random(3);
  const auto any_deadline = [&] {
    return random() % 3 == 0 ? UrgencyTree::kAbsent : static_cast<double>(random() % 5);
  };
  for (std::size_t slots = 0; slots < 20; ++slots) {
    std::vector<UrgencyTree::Key> keys(slots);
    for (std::size_t i = 0; i < slots; ++i) keys[i] = {any_deadline(), slots - i};
    UrgencyTree tree;
    tree.assign(keys);
    for (int step = 0; step < 50; ++step) {
      if (slots > 0) {
        const std::size_t slot = random() % slots;
        keys[slot].deadline = any_deadline();
        tree.set(slot, keys[slot].deadline);
      }
      for (std::size_t count = 0; count <= slots; ++count) {
        std::size_t best = UrgencyTree::kNone;
        for (std::size_t i = 0; i < count; ++i) {
          if (keys[i].deadline == UrgencyTree::kAbsent) continue;
          if (best == UrgencyTree::kNone || keys[i].comes_before(keys[best])) best = i;
        }
        REQUIRE(tree.first(count) == best);
      }
    }
  }
}

}  // namespace
}  // namespace stgs::player
