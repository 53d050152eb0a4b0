// SPDX-License-Identifier: Apache-2.0
// Approximation of flat-top lifespans for formats that have Gaussian fades and hard edges only.
#pragma once

#include "stgs/format/scene_file.h"

namespace stgs {

// Times in ticks.
struct LifespanFit {
  bool never_fades = false;
  double begin = 0, end = 0;  // hard edges, within the displayed range: visible in [begin, end)
  // Of the fade exp(-((t - time) / sigma)^2). Without one, `time` is the middle of the edges.
  double time = 0, sigma = 0;
  // Differences between the two visibilities over the displayed range while either is visible:
  // greatest and integrated squared, and the length of that range.
  double error_max = 0, error_squares = 0, ticks = 0;
};

// Returns the sigma of the Gaussian that minimises the integral over all times of its squared
// difference to the flat top (sigma, radius).
double fitted_sigma(double sigma, double radius);

// Approximates a lifespan at `time` of a part displayed in `displayed`, by a Gaussian or by full
// visibility over the frames at which it is at least half visible, whichever has the smaller
// integrated squared error in the displayed range.
LifespanFit fit_lifespan(double time, double sigma, double radius, const TickRange& displayed);

}  // namespace stgs
