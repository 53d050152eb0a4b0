// SPDX-License-Identifier: Apache-2.0
// Decides which segment layers to read next, in which pieces, and which reads to give up.
#pragma once

#include <cstdint>
#include <limits>
#include <list>
#include <memory>
#include <optional>
#include <vector>

#include "stream/deadlines.h"
#include "stream/fetch_plan.h"
#include "stream/residency.h"
#include "stream/segment_index.h"
#include "stream/throughput.h"

namespace stgs::player {

// Segment layers that are adjacent in the file and fetched together, in one or several reads.
struct FetchRequest {
  std::uint64_t id = 0;
  std::uint64_t offset = 0, bytes = 0;
  std::vector<LocatedLayer> layers;
  std::uint64_t jumps = 0;  // Deadlines::jumps() when it began
  std::uint64_t generation = 0;
  double started_at = 0;
  std::uint64_t done = 0;                  // bytes that have arrived
  std::uint64_t read_bytes = 0;            // of the read in flight; 0: none
  double read_started_at = 0;              // the read in flight
  bool read_cancelled = false;             // the read in flight is to end early
  std::unique_ptr<std::uint8_t[]> buffer;  // receives the bytes; allocated by the user
  Lease charge;                            // of the buffer
};

// Times are seconds of a monotonic clock. Not thread-safe.
class FetchScheduler {
 public:
  struct Settings {
    double prefetch_seconds = 0;  // layers needed later than this are not fetched yet
    double resume_seconds = 0;    // playback waits for data that is needed within this time
  };
  // Everything given by reference outlives this object.
  FetchScheduler(const SegmentIndex& index, const Deadlines& deadlines, Residency& residency,
                 const Settings& settings)
      : index_(index),
        deadlines_(deadlines),
        residency_(residency),
        settings_(settings),
        plan_(index, deadlines, residency, settings.prefetch_seconds) {
    throughput_.begin(0);
  }

  // The result of next().
  struct Next {
    FetchRequest* request = nullptr;  // in flight from now on; null: none
    // A layer that playback waits for and that does not fit the budget: it counts as failed.
    std::optional<SegmentLayer> too_large;
    // Without a request: when there may be one even if nothing else happens; infinity: never.
    double wake_at = std::numeric_limits<double>::infinity();
  };
  // Returns the most urgent request. If this throws, nothing more is in flight than before.
  Next next(double now);

  // Begins the next read of a request: read_size() bytes after the `done` ones.
  void begin_read(FetchRequest& request, double now);
  enum class Progress {
    kMore,      // another read follows
    kComplete,  // all bytes have arrived
    kGivenUp,   // after a seek, other layers are more urgent
    kFailed
  };
  // Ends the read in flight. `busy_seconds` is AsyncByteSource::Done::busy_seconds; empty: the
  // bytes were in memory.
  Progress end_read(FetchRequest& request, bool ok, std::optional<double> busy_seconds);
  // Returns a request whose read a seek interrupts, and marks it so; null: there is none. Reduces
  // `wake_at` to the time at which there will be one.
  FetchRequest* next_cancelled(double now, double& wake_at);
  // Removes a request from those in flight. Its layers become resident if it is `complete`, else
  // missing.
  std::list<FetchRequest> finish(FetchRequest& request, bool complete) noexcept;

  // Returns the request with an id, which is in flight.
  FetchRequest& find(std::uint64_t id);
  std::size_t in_flight() const { return requests_.size(); }
  double bytes_per_second() const { return throughput_.bytes_per_second(); }
  std::uint64_t fetched_bytes() const { return fetched_bytes_; }
  // Returns the number of layers examined so far to find the most urgent ones.
  std::uint64_t examined_layers() const { return plan_.examined(); }

 private:
  double expected_speed() const;
  double exclusive_until(double now) const;
  std::optional<SegmentLayer> next_layer(double now, double& wake_at);
  void extend(FetchRequest& request, double deadline, double now);
  void cancel(const FetchRequest& request) noexcept;
  std::uint64_t read_size(const FetchRequest& request) const;
  bool is_abandoned(const FetchRequest& request) const;
  bool is_obsolete(const FetchRequest& request) const;

  const SegmentIndex& index_;
  const Deadlines& deadlines_;
  Residency& residency_;
  const Settings settings_;
  FetchPlan plan_;
  std::list<FetchRequest> requests_;  // in flight
  std::uint64_t last_id_ = 0;
  Throughput throughput_;  // its time is the busy time of the link
  std::uint64_t fetched_bytes_ = 0;
};

}  // namespace stgs::player
