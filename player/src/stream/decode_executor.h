// SPDX-License-Identifier: Apache-2.0
// Where segments are decoded: on threads, or on the thread that drives the player.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <memory_resource>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "resident_segment.h"
#include "stgs/format/budget.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/task_runner.h"

namespace stgs::player {

// A segment to decode.
struct DecodeJob {
  std::uint32_t segment = 0;
  bool with_sh = false;
  std::shared_ptr<const SceneReader> reader;
  std::uint64_t generation = 0;  // of the segment's number
  bool ahead = false;            // the segment was not needed yet when the job was created
  Lease scratch;                 // working memory
};

// `base` is the error of the complete segment, `sh` that of its spherical harmonics alone.
struct DecodeResult {
  DecodedSegment decoded;
  Status base, sh;
};

// Runs decode jobs. One thread calls it; stop() may be called by another unless poll() decodes.
class DecodeExecutor {
 public:
  // Receives the result of a job, on any thread, or within poll(). Must not throw.
  using Completion = std::function<void(DecodeJob, DecodeResult)>;

  virtual ~DecodeExecutor() = default;
  // Accepts jobs from now on. Call it once.
  virtual void start(Completion completion) = 0;
  // Returns how many jobs may be in flight. Valid after start().
  virtual int max_jobs() const = 0;
  // Returns the working memory for decoding a segment, without the result, bytes.
  virtual std::uint64_t scratch_bytes(const SceneReader& reader, std::uint32_t segment) const;
  // Begins a job, which ends with a call of the completion. Requires fewer than max_jobs() in
  // flight.
  virtual void submit(DecodeJob job) noexcept = 0;
  // Runs at most one job on the calling thread, if this executor has no threads.
  virtual void poll() noexcept {}
  // Drops the jobs that are not running yet.
  virtual void stop() noexcept {}
};

// Decodes a segment with times that are exact enough for rendering. With `with_sh`, `sh` is the
// error of its spherical harmonics alone, which are 0 then.
Result<Gaussians4D> decode_to_render(const SceneReader& reader, std::uint32_t segment, bool with_sh,
                                     Status& sh);

// Decodes into host memory, on the calling thread and those of its TaskRunner.
class SegmentDecoder {
 public:
  // `name` is the name of the file in messages. `memory` allocates the result; null: the heap.
  SegmentDecoder(std::string name, std::shared_ptr<std::pmr::memory_resource> memory)
      : name_(std::move(name)), memory_(std::move(memory)) {}
  DecodeResult decode(const DecodeJob& job) const noexcept;

 private:
  Status decode(const DecodeJob& job, DecodeResult& out) const;

  const std::string name_;
  const std::shared_ptr<std::pmr::memory_resource> memory_;
};

// Decodes on threads of its own, which share loops with those of a TaskRunner or with
// default_thread_pool(). The destructor waits for the jobs that are running.
class CpuExecutor final : public DecodeExecutor {
 public:
  // `runner` outlives this object; null: default_thread_pool().
  CpuExecutor(SegmentDecoder decoder, TaskRunner* runner)
      : decoder_(std::move(decoder)), runner_(runner) {}
  ~CpuExecutor() override;
  void start(Completion completion) override;
  int max_jobs() const override { return static_cast<int>(threads_.size()); }
  void submit(DecodeJob job) noexcept override;
  void stop() noexcept override;

 private:
  void run();

  const SegmentDecoder decoder_;
  TaskRunner* const runner_;
  Completion completion_;
  std::mutex mutex_;  // guards the following members
  std::condition_variable changed_;
  std::vector<DecodeJob> queue_;  // in order of submission
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

// Decodes within poll(), for hosts without threads and for reproducible tests.
class InlineExecutor final : public DecodeExecutor {
 public:
  // As for CpuExecutor.
  InlineExecutor(SegmentDecoder decoder, TaskRunner* runner)
      : decoder_(std::move(decoder)), runner_(runner) {}
  void start(Completion completion) override { completion_ = std::move(completion); }
  int max_jobs() const override { return 1; }
  void submit(DecodeJob job) noexcept override { job_ = std::move(job); }
  void poll() noexcept override;
  void stop() noexcept override { job_.reset(); }

 private:
  const SegmentDecoder decoder_;
  TaskRunner* const runner_;
  Completion completion_;
  std::optional<DecodeJob> job_;
};

}  // namespace stgs::player
