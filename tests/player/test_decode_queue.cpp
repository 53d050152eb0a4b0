// SPDX-License-Identifier: Apache-2.0
// Which segments are decoded when, and by what.
#include "residency_fixture.h"
#include "stream/decode_queue.h"

namespace stgs::player {
namespace {

// Accepts jobs; the test ends them.
class CountingExecutor final : public DecodeExecutor {
 public:
  explicit CountingExecutor(int max_jobs) : max_jobs_(max_jobs) {}
  void start(Completion) override {}
  int max_jobs() const override { return max_jobs_; }
  void submit(DecodeJob) noexcept override {}

 private:
  int max_jobs_;
};

struct QueueUnits : StoreUnits {
  explicit QueueUnits(int max_jobs = 4) : executor(max_jobs) {
    for (const SegmentLayer& layer : index.file_order()) REQUIRE(fetch(layer));
  }
  CountingExecutor executor;
  DecodeQueue decodes{index, deadlines, residency, budget, executor};
};

TEST_CASE("segments are decoded by deadline, with their spherical harmonics if resident") {
  QueueUnits units(1);
  double last = 0;
  std::size_t count = 0;
  while (std::optional<DecodeJob> job = units.decodes.next()) {
    CHECK_FALSE(units.decodes.next());  // one at a time
    CHECK(job->with_sh);
    CHECK(job->generation == units.index.generation());
    const double own = units.deadlines.deadline({job->segment, false});
    CHECK(own >= last);
    last = own;
    ++count;
    REQUIRE(units.decodes.finish(*job));
    units.residency.decoded(job->segment, units.decoded_of(job->segment), true);
  }
  CHECK(count == units.index.size());
}

TEST_CASE("segments that are not needed yet leave half of the jobs to those that are") {
  QueueUnits units;
  std::vector<DecodeJob> ahead;
  while (std::optional<DecodeJob> job = units.decodes.next()) {
    if (job->ahead) {
      ahead.push_back(std::move(*job));
      continue;
    }
    REQUIRE(units.decodes.finish(*job));
    units.residency.decoded(job->segment, units.decoded_of(job->segment), true);
  }
  CHECK(ahead.size() == 2);
  // A seek to segments that are needed at once uses the others.
  units.play_at(89, 1, false, true);
  const std::optional<DecodeJob> needed = units.decodes.next();
  REQUIRE(needed);
  CHECK_FALSE(needed->ahead);
}

TEST_CASE("working memory limits the jobs in flight, but never to less than one") {
  QueueUnits units;
  const auto scratch = [&] { return units.budget.usage(Budget::Pool::kDecodeScratch).used; };
  units.budget.set_limit(Budget::Pool::kDecodeScratch, 1);
  std::optional<DecodeJob> job = units.decodes.next();
  REQUIRE(job);
  CHECK(scratch() == units.executor.scratch_bytes(units.index.reader(), job->segment));
  CHECK_FALSE(units.decodes.next());
  REQUIRE(units.decodes.finish(*job));
  job.reset();
  CHECK(scratch() == 0);
  units.budget.set_limit(Budget::Pool::kDecodeScratch, Budget::kNoLimit);
  const std::optional<DecodeJob> first = units.decodes.next(), second = units.decodes.next();
  CHECK(first);
  CHECK(second);
}

TEST_CASE("a job of an earlier generation ends without effect") {
  QueueUnits units;
  const std::optional<DecodeJob> job = units.decodes.next();
  REQUIRE(job);
  auto other = encode_scene(testing::random_scene(500, 1, kFrames, 9), {});
  REQUIRE(other.ok());
  units.adopt(open_bytes(*other));
  units.decodes.reserve(units.index.size());
  CHECK_FALSE(units.decodes.finish(*job));
  REQUIRE(units.fetch({0, false}));
  CHECK(units.decodes.next());  // as many jobs as before
}

TEST_CASE("executors decode the same, on threads or within poll()") {
  const auto reader = open_bytes(clip().bytes);
  const auto make_job = [&](std::uint32_t segment) {
    DecodeJob job;
    job.segment = segment;
    job.with_sh = true;
    job.reader = reader;
    return job;
  };
  std::mutex mutex;
  std::condition_variable done;
  std::vector<DecodeResult> results;
  const auto completion = [&](DecodeJob job, DecodeResult result) {
    const std::lock_guard lock(mutex);
    CHECK(job.reader == reader);
    results.push_back(std::move(result));
    done.notify_all();
  };
  InlineExecutor inline_executor(SegmentDecoder("clip", nullptr), nullptr);
  inline_executor.start(completion);
  inline_executor.submit(make_job(1));
  CHECK(results.empty());
  inline_executor.poll();
  REQUIRE(results.size() == 1);
  inline_executor.poll();  // nothing left
  {
    CpuExecutor threads(SegmentDecoder("clip", nullptr), nullptr);
    threads.start(completion);
    CHECK(threads.max_jobs() >= 1);
    threads.submit(make_job(1));
    std::unique_lock lock(mutex);
    done.wait(lock, [&] { return results.size() == 2; });
  }
  for (const DecodeResult& result : results) {
    CHECK(result.base.ok());
    CHECK(result.sh.ok());
    REQUIRE(result.decoded != nullptr);
  }
  CHECK(testing::fingerprints(results[0].decoded->set) ==
        testing::fingerprints(results[1].decoded->set));
}

}  // namespace
}  // namespace stgs::player
