// SPDX-License-Identifier: Apache-2.0
// Decodes in workers of the host. The decoded primitives stay there, packed for the GPU; here is an
// id for each decoded segment.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stream/decode_executor.h"

namespace stgs::web {

// One thread, one object at a time: the ids of its jobs are those of the host.
class WorkerExecutor final : public player::DecodeExecutor {
 public:
  // `source` has the encoded bytes of every segment that is submitted.
  WorkerExecutor(std::shared_ptr<const ByteSource> source, int max_jobs)
      : source_(std::move(source)), max_jobs_(max_jobs) {}

  void start(Completion completion) override { completion_ = std::move(completion); }
  int max_jobs() const override { return max_jobs_; }
  void submit(player::DecodeJob job) noexcept override;
  void poll() noexcept override;
  void stop() noexcept override;

  // Called by the host: the job has ended. If `base` is an error, the host has nothing of it.
  void done(std::uint32_t id, double time_origin, Status base, Status sh);
  // Returns the id of a segment that done() has completed and that is still in use, else 0.
  std::uint32_t id_of(const Gaussians4D& set) const;
  // Returns an id that is no longer in use, once; 0: there is none.
  std::uint32_t take_released();

 private:
  struct Decoded {
    std::map<const Gaussians4D*, std::uint32_t> ids;
    std::vector<std::uint32_t> released;  // has capacity for all of `ids`
  };

  // Reads the records of a job and passes them to the host.
  Status pass_on(std::uint32_t id, const player::DecodeJob& job);
  // Returns a segment without primitives, which stands for those that the host has.
  player::DecodedSegment stand_in(std::uint32_t id, double time_origin);

  const std::shared_ptr<const ByteSource> source_;
  const int max_jobs_;
  Completion completion_;
  std::map<std::uint32_t, player::DecodeJob> jobs_;  // by id
  std::vector<std::pair<player::DecodeJob, Status>> failed_;
  std::shared_ptr<Decoded> decoded_ = std::make_shared<Decoded>();
  std::uint32_t next_ = 1;
};

}  // namespace stgs::web
