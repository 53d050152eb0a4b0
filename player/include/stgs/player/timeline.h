// SPDX-License-Identifier: Apache-2.0
// What is alive when: decoded segments of an open file, and the candidates at a moment.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::player {

inline constexpr std::uint64_t kDefaultMemoryBudget = std::uint64_t{4} << 30;  // bytes

// What to do at a moment of which segments are damaged, missing or of a later version.
enum class DamagePolicy {
  kReject,  // an error
  kSkip,    // what is sound of them is alive; an error where all of a moment is lost
};

// What damage took of a segment.
struct SegmentDamage {
  std::uint32_t segment = 0;
  bool sh_only = false;  // they are 0; else nothing of it is drawn
  Status reason;
};

// Decodes the segments that a moment needs and keeps them within a memory budget: those needed
// least recently go first. Not thread-safe; decodes missing segments in parallel (TBB).
class Timeline {
 public:
  // `place` is a path or a URL. `memory_budget` bounds the bytes of decoded segments, see
  // memory_bytes().
  static Result<std::unique_ptr<Timeline>> open(const std::string& place,
                                                std::uint64_t memory_budget = kDefaultMemoryBudget,
                                                DamagePolicy damaged = DamagePolicy::kReject);
  // The same over a reader that is already open. `name` is for messages.
  static std::unique_ptr<Timeline> from_reader(std::unique_ptr<SceneReader> reader,
                                               const std::string& name = "the scene",
                                               std::uint64_t memory_budget = kDefaultMemoryBudget,
                                               DamagePolicy damaged = DamagePolicy::kReject);
  virtual ~Timeline() = default;

  // Of a recording that a player follows (player.h) all is as of the last at() or
  // visible_segments(), and what was given before is void.

  // For messages: the path or URL.
  virtual const std::string& name() const = 0;
  virtual const SceneMetadata& metadata() const = 0;
  virtual double duration_seconds() const = 0;
  // What was wrong with the file when it was opened, and could be read past.
  virtual const std::vector<Issue>& damage() const = 0;
  // Up to which moment nothing of the file is missing.
  virtual double complete_seconds() const = 0;
  // What at() and decode() have passed over so far, each segment once.
  virtual const std::vector<SegmentDamage>& segment_damage() const = 0;

  // The decoded segments alive at a moment.
  struct Active {
    // A set with its candidate primitives, ascending: every one whose opacity at this moment
    // reaches the drawing threshold 1/255 (a rounding error's width beyond included).
    struct Segment {
      std::uint32_t segment;
      const Gaussians4D* set;
      const std::vector<std::uint32_t>* candidates;
      double ticks;  // the moment from where the set's time counts: the beginning of its part
      // The file's primitives counted in the order of its segments: index of the set's first.
      std::uint32_t id_base;
    };
    std::vector<Segment> segments;  // ascending in segment and in id_base
    double ticks = 0;
  };
  // What is alive at `seconds`, which may lie outside the duration. The pointers stay valid until
  // the next call. Errors: a segment that cannot be read or decoded, or that a damaged index no
  // longer tells (SceneReader::lost_fragments), with kPassOver only where none of the moment's can
  // be, or the source fails; a moment whose segments together exceed the memory budget (kRuntime).
  virtual Result<Active> at(double seconds) = 0;

  // A segment that may have something alive, for a backend that holds segments by itself.
  struct SegmentRef {
    std::uint32_t segment;
    double ticks;           // as Segment's
    std::uint32_t id_base;  // as Segment's
    // Null: not decoded, which is left to the caller. Another one than before: the segment has
    // changed.
    std::shared_ptr<const Gaussians4D> set;
  };
  // The segments of at(), ascending, and those that turn out to have no candidates, without
  // decoding any; without those that are lost as far as it is known. Errors: as at()'s.
  virtual Result<std::vector<SegmentRef>> visible_segments(double seconds) = 0;
  virtual const SceneReader& reader() const = 0;
  // A segment as at() decodes it, for such a backend where it cannot; it is not held. Nothing where
  // it is passed over, which segment_damage() tells, or has not come.
  virtual Result<std::optional<Gaussians4D>> decode(std::uint32_t segment) = 0;
  virtual std::uint64_t memory_budget() const = 0;
  // Whether each picture is soon followed by one of another moment: what makes a picture better,
  // but would keep it waiting, may then come with the next ones.
  virtual bool is_playing() const { return false; }
  // What is decoded of what follows soon after `seconds` while it plays, soonest first and without
  // what is alive then, so that it can be brought before it is needed. `ticks` is of no use.
  virtual std::vector<SegmentRef> prefetch_segments(double /*seconds*/) { return {}; }
  // No other timeline's while somebody keeps it, and the same as long as this one lives; but
  // another where the index of a recording lists again what damage had hidden, which changes the
  // numbers of segments.
  virtual const std::shared_ptr<const void>& identity() const = 0;

  // Bytes of the decoded segments held now; never more than the budget.
  virtual std::uint64_t memory_bytes() const = 0;
  // Primitives of the decoded segments held now.
  virtual std::uint64_t stored_primitives() const = 0;
};

}  // namespace stgs::player
