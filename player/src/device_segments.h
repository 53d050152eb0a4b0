// SPDX-License-Identifier: Apache-2.0
// Decides which segments are resident on a backend's device, within the timeline's memory budget.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/player/timeline.h"

namespace stgs::player {

// Base class of the segment caches of the GPU backends, which implement upload and eviction. One
// thread.
//
// Segments that the timeline has decoded are uploaded in parts of at most kMaxUploadPrimitives.
// During playback, the upload of a large segment is spread over several frames, which render the
// previous version of the segment until the upload is complete. Segments that are needed soon are
// uploaded in advance.
//
// The segments are charged to Budget::Pool::kDeviceCopies of the timeline, and what the CPU decodes
// for them to kRenderer.
class DeviceSegments {
 public:
  virtual ~DeviceSegments() = default;
  // Makes the segments that are active at `seconds` resident, evicts the least recently used ones
  // if the budget requires it, and returns those to render: all active ones that are resident,
  // ascending, with `ticks` that count as the times on the device. Segments of another timeline are
  // evicted. Work that uses segments must have completed, or precede this call's work in the
  // device's queue. Errors: those of Timeline::at(), and of the device.
  Result<std::vector<Timeline::SegmentRef>> make_resident(Timeline& timeline, double seconds);
  // Returns the number of primitives in the resident segments.
  std::uint64_t stored_primitives() const { return primitives_; }
  // Returns the number of decoded primitives that the last make_resident() left to later calls.
  std::uint64_t pending_primitives() const { return pending_; }
  // Counts at the time of the timeline with the most active primitives and segments, limited by the
  // budget. Buffers allocated for them need not grow during playback.
  struct Peak {
    std::uint64_t primitives = 0, segments = 0;
  };
  const Peak& peak() const { return peak_; }
  // Sets the peak to 0 for this timeline. Call it if the device cannot allocate buffers for it.
  void forget_peak() {
    peak_ = {};
    peak_does_not_fit_ = true;
  }

 protected:
  int sh_degree() const { return sh_degree_; }
  // Returns the memory budget of the timeline, bytes.
  std::uint64_t memory_budget() const { return memory_budget_; }
  // Primitives per upload.
  static constexpr std::size_t kMaxUploadPrimitives = std::size_t{1} << 16;
  // Registers a segment as resident with its size in bytes and its Gaussians4D::time_origin.
  // Replaces its previous version.
  void insert(std::uint32_t segment, std::uint64_t primitives, std::uint64_t bytes,
              double time_origin);
  // Charges primitives that the CPU decodes, for as long as the lease exists, or returns kLimit.
  Result<Lease> charge_decoded(std::uint64_t primitives) const;
  // Decodes a segment on the CPU and uploads it. Applies the timeline's damage policy.
  Status decode_on_cpu(Timeline& timeline, std::uint32_t segment);
  // Uploads all of a decoded segment.
  Status upload_all(std::uint32_t segment, const Gaussians4D& set);
  // Evicts all segments. Derived classes call it before they free their memory.
  void clear();
  using Clock = std::chrono::steady_clock;
  // Returns the time for the limit on uploads per frame during playback.
  virtual Clock::time_point now() const { return Clock::now(); }

 private:
  struct UploadProgress {
    std::weak_ptr<const Gaussians4D> set;
    std::size_t done = 0;  // primitives
  };
  // Segments used in the latest call are evicted last, and among them those with the highest
  // priority.
  enum class Priority {
    kPrefetched,
    kOutdated,  // active, until a better version is uploaded
    kActive
  };
  struct Use {
    std::uint64_t call = 0;
    Priority priority = Priority::kPrefetched;
    bool operator<(const Use& other) const {
      return std::tie(call, priority) < std::tie(other.call, other.priority);
    }
  };
  struct Resident {
    std::uint64_t bytes = 0, primitives = 0;
    double time_origin = 0;                // of the times on the device, ticks of the part
    Use used;                              // last
    std::weak_ptr<const Gaussians4D> set;  // SegmentRef::set, if it had one
    std::uint64_t version = 0;             // SegmentRef::version
  };
  using Segments = std::map<std::uint32_t, Resident>;

  // Prepares for another timeline. No segment is resident.
  virtual Status begin(const SceneReader& reader) = 0;
  // Allocates memory for segments of `bytes` together, if the device has it. Called while no
  // segment is resident.
  virtual void reserve(std::uint64_t bytes) = 0;
  // Returns the device memory of a segment, bytes.
  virtual std::uint64_t bytes_of(std::uint64_t primitives) const = 0;
  // Decodes segments. Calls insert() for each intact one and decode_on_cpu() for the others.
  virtual Status decode(Timeline& timeline, std::span<const std::uint32_t> segments) = 0;
  // Uploads up to kMaxUploadPrimitives primitives of a set from `first` on. Those before `first`
  // are uploaded already; 0 restarts the upload. Once the set is complete, replaces the previous
  // version of the segment and calls insert().
  virtual Status upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) = 0;
  // Frees the memory of an incomplete upload.
  virtual void cancel_upload(std::uint32_t segment) = 0;
  // Frees the memory of a resident segment.
  virtual void release(std::uint32_t segment) = 0;

  Status switch_to(const Timeline& timeline);
  void find_peak(const Timeline& timeline);
  // Records the use of a segment. Returns whether the resident version is the requested one.
  bool mark_used(const Timeline::SegmentRef& ref, bool is_active);
  void evict(Segments::iterator segment);
  // Evicts segments whose last use is below `limit`, least recently used first, until `bytes` more
  // fit the budget.
  void evict_for(const Timeline& timeline, std::uint64_t bytes, const Use& limit);
  // Truncates `ahead` to the segments that fit the budget next to `bytes` for active segments, and
  // evicts segments for them.
  void fit_prefetch(const Timeline& timeline, std::uint64_t bytes,
                    std::vector<const Timeline::SegmentRef*>& ahead);
  void cancel_uploads_except(std::span<const Timeline::SegmentRef* const> these);
  Status upload_decoded(const Timeline& timeline,
                        std::span<const Timeline::SegmentRef* const> decoded,
                        std::span<const Timeline::SegmentRef* const> ahead);
  // Uploads the next part of a set. Returns whether more parts follow.
  Result<bool> upload_next(const Timeline::SegmentRef& ref);
  Clock::duration upload_time(bool playing);
  Status upload_missing(Timeline& timeline, std::span<const Timeline::SegmentRef> refs,
                        double seconds);
  Status decode_batches(Timeline& timeline, std::span<const std::uint32_t> segments);

  std::shared_ptr<Budget> budget_;  // outlives `charge_`
  Lease charge_;                    // of the segments and uploads of the last call
  std::string name_;                // of the timeline
  std::uint64_t memory_budget_ = 0;
  std::weak_ptr<const void> timeline_;  // its identity
  int sh_degree_ = 0;
  Peak peak_;
  bool peak_does_not_fit_ = false;  // the device's memory
  std::size_t segment_count_ = 0;   // of the timeline when peak_ was computed
  Segments resident_;
  std::map<std::uint32_t, UploadProgress> uploads_;  // incomplete
  std::uint64_t bytes_ = 0, primitives_ = 0, pending_ = 0, call_ = 0;
  Clock::time_point last_call_;
  bool was_playing_ = false;  // at the last call
};

}  // namespace stgs::player
