// SPDX-License-Identifier: Apache-2.0
// Matching of splats over successive frames: which splat of a frame continues which primitive.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "interchange/import_memory.h"
#include "stgs/format/ply_sequence.h"

namespace stgs {

// Converts frames, added one after the other, into primitives. A primitive has the attributes of
// the first splat of its run. A splat continues a run if its attributes match within the tolerances
// and some velocity passes through all positions of the run within the tolerance. The possible
// velocities are an interval per axis, which each frame narrows; no other history is kept.
class SequenceMatcher {
 public:
  // `memory` must outlive the object. It is charged for the primitives and for the matching.
  SequenceMatcher(const SequenceTolerances& tolerances, ImportMemory& memory)
      : tolerances_(tolerances), memory_(memory) {}

  // Adds the next frame, which must have the SH degree of the first one. `ids`: identities of its
  // splats, ascending; then a splat continues only the run of its identity, however far it moved.
  // Either all frames have identities or none. kUnsupported if the memory does not suffice.
  Status add(const Gaussians4D& frame, std::span<const std::uint32_t> ids = {});
  // Ends all runs and returns the primitives, with lifespans in ticks of one frame. Call it last.
  // The object still charges their memory.
  Gaussians4D finish(SequenceReport& report);

 private:
  // A run that includes a splat of the last frame.
  struct Run {
    std::uint32_t primitive = 0;
    std::array<double, 3> min_velocity{}, max_velocity{};  // scene units per frame
    double tolerance = 0;                                  // of the position, scene units
    double farthest = 0;  // distance from the first position, scene units
  };
  // The continuation of a run by a splat, and its error.
  struct Step {
    Run run;
    SequenceTolerances difference;
    double surprise = 0;  // distance from the expected position, scene units
  };

  double age(const Run& run) const;  // frames from its first one to the one being added
  std::array<double, 3> expected(const Run& run) const;
  bool same_attributes(const Gaussians4D& frame, std::size_t splat, std::uint32_t primitive,
                       SequenceTolerances& difference) const;
  bool continues(const Gaussians4D& frame, std::size_t splat, const Run& run, double max_step,
                 Step& step) const;
  std::size_t match_in_order(const Gaussians4D& frame);
  void match_by_place(const Gaussians4D& frame);
  void match_by_identity(const Gaussians4D& frame, std::span<const std::uint32_t> ids);
  void match_nearby(const Gaussians4D& frame, double cell, bool starting);
  void assign(std::size_t splat, std::size_t run, const Step& step);
  void begin_run(const Gaussians4D& frame, std::size_t splat);
  void end_run(const Run& run);

  SequenceTolerances tolerances_;
  ImportMemory& memory_;
  Lease set_lease_, runs_lease_;
  Gaussians4D set_;  // until finish(), `time` is the first frame and `radius` the number of frames
  std::uint32_t frames_ = 0;
  std::vector<Run> runs_;           // of the splats of the last frame, in its order
  std::vector<std::uint32_t> ids_;  // of the last frame; empty: unknown
  SequenceReport report_;

  // State of the frame being added.
  std::vector<Run> next_;
  std::vector<std::uint8_t> splat_done_, run_done_;
};

}  // namespace stgs
