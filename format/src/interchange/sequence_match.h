// SPDX-License-Identifier: Apache-2.0
// Runs of splats over successive frames: which splat of a frame continues which primitive.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "stgs/format/ply_sequence.h"

namespace stgs {

// Turns frames, given one after the other, into primitives. A primitive has the attributes of the
// first splat of its run; a splat continues the run where it has them within the tolerances and a
// velocity exists at which the run passes every position so far within the tolerance. Those
// velocities are an interval an axis, which each frame narrows, so nothing else need be kept.
class SequenceMatcher {
 public:
  explicit SequenceMatcher(const SequenceTolerances& tolerances) : tolerances_(tolerances) {}

  // The next frame; its sh_degree is that of the first.
  void add(const Gaussians4D& frame);
  // Ends all runs; the primitives have lifespans in ticks of a frame. Nothing may be added then.
  Gaussians4D finish(SequenceReport& report);

  std::uint64_t primitives() const { return set_.size(); }

 private:
  // What a splat of the last frame belongs to.
  struct Run {
    std::uint32_t primitive = 0;
    std::array<double, 3> least{}, greatest{};  // velocity, scene units a frame
    double tolerance = 0;                       // of the position, scene units
    double farthest = 0;                        // from the first position, scene units
  };
  // A splat that continues a run, and what that costs.
  struct Step {
    Run run;
    SequenceTolerances difference;
    double surprise = 0;  // distance from where the run was expected, scene units
  };

  double age(const Run& run) const;  // frames from its first to the one being added
  std::array<double, 3> expected(const Run& run) const;
  bool same_attributes(const Gaussians4D& frame, std::size_t splat, std::uint32_t primitive,
                       SequenceTolerances& difference) const;
  bool continues(const Gaussians4D& frame, std::size_t splat, const Run& run, double widest,
                 Step& step) const;
  std::size_t match_in_order(const Gaussians4D& frame);
  void match_nearby(const Gaussians4D& frame, double cell, bool starting);
  void take(std::size_t splat, std::size_t run, const Step& step);
  void begin_run(const Gaussians4D& frame, std::size_t splat);
  void end_run(const Run& run);

  SequenceTolerances tolerances_;
  Gaussians4D set_;  // up to finish(), `time` is the first frame and `radius` the number of frames
  std::uint32_t frames_ = 0;
  std::vector<Run> runs_;  // of the splats of the last frame, in its order
  SequenceReport report_;

  // Of the frame that is being added.
  std::vector<Run> next_;
  std::vector<std::uint8_t> splat_done_, run_done_;
};

}  // namespace stgs
