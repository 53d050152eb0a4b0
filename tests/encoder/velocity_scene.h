// SPDX-License-Identifier: Apache-2.0
// Frames with points on a turning, textured ellipsoid, with other samples in each frame.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "catch.h"
#include "init/velocity_match.h"

namespace stgs::testing {

using namespace stgs::encoder;
using namespace stgs::encoder::init;

inline constexpr double kReach = 0.3;  // scene units per frame
// Velocity and angular velocity of the ellipsoid, per frame, and where it starts.
inline const cv::Vec3d kShift(0.05, -0.02, 0.03), kStart(7, -3, 11);
constexpr double kTurn = 0.03;

inline double random_unit(std::uint32_t* state) {
  *state = *state * 1664525u + 1013904223u;
  return double(*state >> 8) / double(1 << 24);
}

// The position of a point of the ellipsoid at rest.
inline cv::Vec3d moved(const cv::Vec3d& p, double frame) {
  const double c = std::cos(kTurn * frame), s = std::sin(kTurn * frame);
  return kStart + frame * kShift + cv::Vec3d(c * p[0] + s * p[2], p[1], c * p[2] - s * p[0]);
}

inline DynamicFrame ellipsoid(int points, int frame) {
  DynamicFrame out;
  std::uint32_t seed = std::uint32_t(7919 * frame + points + 1);
  for (int i = 0; i < points; ++i) {
    const double z = 2 * random_unit(&seed) - 1, angle = 2 * CV_PI * random_unit(&seed);
    const double ring = std::sqrt(1 - z * z);
    const cv::Vec3d p(ring * std::cos(angle), 1.7 * z, 0.6 * ring * std::sin(angle));
    const auto level = [&](double f) {
      return std::uint8_t(128 + 100 * std::sin(f * p[0] + p[1]) * std::cos(f * p[2] - p[1]));
    };
    out.points.push_back({moved(p, frame), {level(5), level(7), level(9)}});
  }
  return out;
}

// Frames with these numbers of points.
inline std::vector<DynamicFrame> ellipsoids(const std::vector<int>& counts) {
  std::vector<DynamicFrame> out;
  for (std::size_t k = 0; k < counts.size(); ++k) out.push_back(ellipsoid(counts[k], int(k)));
  return out;
}

inline Status match(const std::vector<DynamicFrame>& frames, int interval,
                    geometry::VelocityMatcher* gpu, std::vector<Velocities>* out) {
  const ProgressSink progress;
  const LogSink log;
  Work work(progress, log);
  work.stage("velocities");
  return match_frames(frames, interval, kReach, gpu, work, out);
}

inline std::vector<Velocities> matched(const std::vector<DynamicFrame>& frames, int interval,
                                       geometry::VelocityMatcher* gpu) {
  std::vector<Velocities> out;
  const Status status = match(frames, interval, gpu, &out);
  INFO(status.message());
  REQUIRE(status.ok());
  REQUIRE(out.size() == frames.size());
  for (std::size_t k = 0; k < out.size(); ++k) REQUIRE(out[k].size() == frames[k].points.size());
  return out;
}

// Returns how many velocities differ by more than 1e-4 of the reach.
inline std::size_t different(const Velocities& a, const Velocities& b) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    count += cv::norm(a[i] - b[i]) <= 1e-4 * kReach ? 0 : 1;
  return count;
}

}  // namespace stgs::testing
