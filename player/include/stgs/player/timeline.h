// SPDX-License-Identifier: Apache-2.0
// The segments of a scene over time: which are active, and their candidate primitives.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/scene_file.h"

namespace stgs::player {

inline constexpr std::uint64_t kDefaultMemoryBudget = std::uint64_t{4} << 30;  // bytes

// How to treat segments that are damaged, missing, or of a later version of the format.
enum class DamagePolicy {
  kReject,  // fail at times that need them
  kSkip,    // use the intact data; fail only at times for which no data is intact
};

// Damage to a segment.
struct SegmentDamage {
  std::uint32_t segment = 0;
  bool sh_only = false;  // true: only its spherical harmonics, which are 0; false: all of it
  Status reason;
};

// Decodes the segments that are active at a time and caches them within a memory budget, evicting
// the least recently used first. Not thread-safe; decodes missing segments in parallel.
//
// If a player follows a growing recording (player.h), everything here is as of the last at() or
// visible_segments(), which invalidates earlier results.
class Timeline {
 public:
  // Opens a path or URL. `memory_budget` bounds the bytes of decoded segments, see memory_bytes().
  static Result<std::unique_ptr<Timeline>> open(const std::string& location,
                                                std::uint64_t memory_budget = kDefaultMemoryBudget,
                                                DamagePolicy policy = DamagePolicy::kReject);
  // Creates a timeline over an open reader. `name` is used in messages.
  static std::unique_ptr<Timeline> from_reader(std::unique_ptr<SceneReader> reader,
                                               const std::string& name = "the scene",
                                               std::uint64_t memory_budget = kDefaultMemoryBudget,
                                               DamagePolicy policy = DamagePolicy::kReject);
  virtual ~Timeline() = default;

  // Returns the path or URL, for messages.
  virtual const std::string& name() const = 0;
  // Returns the metadata of the scene.
  virtual const SceneMetadata& metadata() const = 0;
  // Returns the duration, seconds.
  virtual double duration_seconds() const = 0;
  // Returns the recoverable issues that were found when the file was opened.
  virtual const std::vector<Issue>& damage() const = 0;
  // Returns the time in seconds up to which no data of the file is missing.
  virtual double complete_seconds() const = 0;
  // Returns the damage that at() and decode() have skipped so far, once per segment.
  virtual const std::vector<SegmentDamage>& segment_damage() const = 0;

  // The decoded segments that are active at a time.
  struct Active {
    // A segment and its candidate primitives, ascending: those whose opacity at this time reaches
    // the rendering threshold of 1/255, within a rounding error.
    struct Segment {
      std::uint32_t segment;
      const Gaussians4D* set;
      const std::vector<std::uint32_t>* candidates;
      double ticks;  // the time, counted as set->time
      // Index of the first primitive of `set`, counting all primitives in segment order.
      std::uint32_t id_base;
    };
    std::vector<Segment> segments;  // ascending in `segment` and in `id_base`
    double ticks = 0;               // the time
  };
  // Returns the active segments at `seconds`, which may lie outside the duration. The pointers are
  // valid until the next call. Errors:
  // - a segment that cannot be read or decoded, or that a damaged index no longer lists
  //   (SceneReader::lost_fragments); with kSkip only if no segment is usable, or the source fails,
  // - kRuntime if the active segments together exceed the memory budget.
  virtual Result<Active> at(double seconds) = 0;

  // A segment that may be active, for backends that cache segments themselves.
  struct SegmentRef {
    std::uint32_t segment;
    double ticks;           // the time relative to the beginning of the segment's part
    std::uint32_t id_base;  // as in Active::Segment
    // Null: not decoded; the caller decodes it. Differs from an earlier call if the segment has
    // changed.
    std::shared_ptr<const Gaussians4D> set;
    // Without `set`: differs from an earlier call if the segment must be decoded again.
    std::uint64_t version = 0;
  };
  // Returns the segments of at(), ascending, without decoding any. Includes segments that turn out
  // to have no candidates, excludes those known to be unusable. Errors as for at().
  virtual Result<std::vector<SegmentRef>> visible_segments(double seconds) = 0;
  // Returns the reader of the file.
  virtual const SceneReader& reader() const = 0;
  // Decodes a segment as at() does, without caching it, for backends that cannot decode it
  // themselves. Times count as render_origin() of the reader states. Empty if the segment is
  // skipped, which segment_damage() lists, or has not arrived.
  virtual Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) = 0;
  // Returns the memory budget, bytes.
  virtual std::uint64_t memory_budget() const = 0;
  // Returns what the memory of the timeline and of its renderers is charged to. The pools kSegments
  // and kDeviceCopies may hold memory_budget(), kRenderer as much and at least 1 GiB.
  virtual const std::shared_ptr<Budget>& budget() const = 0;
  // Returns whether frames of successive times follow each other closely. A backend may then defer
  // uploads that improve a frame but would delay it.
  virtual bool is_playing() const { return false; }
  // Returns decoded segments that become active soon after `seconds` during playback, soonest
  // first, without those that are active at `seconds`, so that they can be uploaded in advance.
  // Their `ticks` are meaningless.
  virtual std::vector<SegmentRef> prefetch_segments(double /*seconds*/) { return {}; }
  // Returns a token that no other timeline has for as long as a reference to it exists. It stays
  // the same for the lifetime of the timeline, unless the index of a recording lists segments again
  // that damage had hidden, which renumbers the segments.
  virtual const std::shared_ptr<const void>& identity() const = 0;

  // Returns the bytes of the decoded segments that are resident; never more than the budget.
  virtual std::uint64_t memory_bytes() const = 0;
  // Returns the number of primitives in the decoded segments that are resident.
  virtual std::uint64_t stored_primitives() const = 0;
};

}  // namespace stgs::player
