// SPDX-License-Identifier: Apache-2.0
#include "stream/decode_executor.h"

#include <algorithm>
#include <exception>
#include <system_error>
#include <utility>

#include "stgs/format/parallel.h"
#include "stream/no_memory.h"

namespace stgs::player {
namespace {

// Returns the number of segments to decode at once. Each one already uses all cores; several
// overlap the parts that run on a single core.
int max_jobs_for(TaskRunner* runner) {
  constexpr int kMaxJobs = 8;
  const ScopedTaskRunner use(runner);
  const int threads = std::max(concurrency(), 1);
  return std::clamp(threads / 2, std::min(threads, 2), kMaxJobs);
}

}  // namespace

// Decoding needs about as much working memory as its result, and the encoded bytes.
std::uint64_t DecodeExecutor::scratch_bytes(const SceneReader& reader,
                                            std::uint32_t segment) const {
  const SegmentInfo& info = reader.segments()[segment];
  return info.bytes + decoded_segment_bytes(info.primitives, reader.sh_degree());
}

Result<Gaussians4D> decode_to_render(const SceneReader& reader, std::uint32_t segment, bool with_sh,
                                     Status& sh) {
  const TimeOrigin origin = reader.render_origin(segment);
  return with_sh ? reader.decode_intact(segment, sh, origin)
                 : reader.decode(segment, false, origin);
}

Status SegmentDecoder::decode(const DecodeJob& job, DecodeResult& out) const {
  Result<Gaussians4D> set = decode_to_render(*job.reader, job.segment, job.with_sh, out.sh);
  STGS_TRY(set.status());
  out.decoded = std::make_shared<const ResidentSegment>(std::move(set).value(), memory_);
  return {};
}

DecodeResult SegmentDecoder::decode(const DecodeJob& job) const noexcept {
  DecodeResult out;
  try {
    out.base = decode(job, out);
  } catch (const std::exception& e) {
    out.base = failure(e, [&] {
      return fmt::format("{}: cannot decode segment {}: {}", name_, job.segment, e.what());
    });
  }
  return out;
}

CpuExecutor::~CpuExecutor() {
  stop();
  for (std::thread& thread : threads_) thread.join();
}

void CpuExecutor::start(Completion completion) {
  completion_ = std::move(completion);
  const int count = max_jobs_for(runner_);
  queue_.reserve(static_cast<std::size_t>(count));
  threads_.reserve(static_cast<std::size_t>(count));
  threads_.emplace_back([this] { run(); });
  // As many further threads as the system has; one is sufficient.
  try {
    while (static_cast<int>(threads_.size()) < count) threads_.emplace_back([this] { run(); });
  } catch (const std::system_error&) {
  }
}

void CpuExecutor::submit(DecodeJob job) noexcept {
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(std::move(job));
  }
  changed_.notify_one();
}

void CpuExecutor::stop() noexcept {
  std::vector<DecodeJob> dropped;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    dropped.swap(queue_);
  }
  changed_.notify_all();
}

void CpuExecutor::run() {
  const ScopedTaskRunner use(runner_);
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return stopping_ || !queue_.empty(); });
    if (stopping_) return;
    DecodeJob job = std::move(queue_.front());
    queue_.erase(queue_.begin());
    lock.unlock();
    DecodeResult result;
    run_as_task([&] { result = decoder_.decode(job); });
    completion_(std::move(job), std::move(result));
    lock.lock();
  }
}

void InlineExecutor::poll() noexcept {
  if (!job_) return;
  const ScopedTaskRunner use(runner_);
  DecodeJob job = std::move(*job_);
  job_.reset();
  DecodeResult result = decoder_.decode(job);
  completion_(std::move(job), std::move(result));
}

}  // namespace stgs::player
