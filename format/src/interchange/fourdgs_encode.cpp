// SPDX-License-Identifier: Apache-2.0
// Quantisation of a scene for .4dgs.
#include <algorithm>
#include <numbers>
#include <numeric>

#include "interchange/fourdgs_write.h"
#include "interchange/import.h"
#include "interchange/lifespan_fit.h"
#include "stgs/format/differences.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs::fourdgs {
namespace {

// Greatest rounding errors.
constexpr double kPositionError = 0.02;  // in middle standard deviations
constexpr double kLogError = 0.005, kRotationError = 0.0005, kColourError = 0.5 / 255;
constexpr double kTimeStep = 1.0 / 64;      // ticks
constexpr double kMinDeviation = 1.0 / 64;  // of a fade, ticks: shorter ones miss all frames
constexpr double kMaxBin = 1 << 30;
// Visibility differences up to this are rounding.
constexpr double kExactFit = 0.002;

// Counts values outside the range of the format.
struct Clipping {
  std::uint64_t count = 0;
  double most = 0;

  double operator()(double v, double low, double high, double tolerance) {
    const double clipped = std::clamp(v, low, high), off = std::abs(v - clipped);
    if (off > tolerance) {
      ++count;
      most = std::max(most, off);
    }
    return clipped;
  }
};

// Rounds to a multiple of a step. Sets `ok` to false if it does not fit in 32 bits.
std::int32_t bin_of(double v, double step, bool& ok) {
  const double bin = std::round(v / step);
  ok = ok && std::abs(bin) < 0x1p31;
  return ok ? static_cast<std::int32_t>(bin) : 0;
}

class Encoder {
 public:
  Encoder(const Scene& scene, double duration)
      : scene_(scene),
        set_(scene.gaussians),
        base_(scene.metadata.time_base),
        duration_(duration) {}

  Result<CodedScene> run(ConversionNotes* notes) {
    fit_all();
    choose_steps();
    for (const std::uint32_t i : visible_) STGS_TRY(add(i));
    add_notes(notes);
    return std::move(out_);
  }

 private:
  // A primitive's lifespan in ticks of the timeline, and where it is displayed.
  struct Lifespan {
    double time = 0;
    TickRange displayed;
  };

  void fit_all() {
    lifespans_.resize(set_.size());
    const auto frames = static_cast<double>(scene_.metadata.frames);
    std::size_t i = 0;
    if (scene_.parts.empty()) {
      for (; i < set_.size(); ++i) lifespans_[i] = {set_.time[i], {0, frames}};
    }
    for (const ScenePart& part : scene_.parts) {
      const TickRange range = part.displayed_range();
      const TickRange displayed = {std::max(0.0, range.begin), std::min(frames, range.end)};
      for (const std::size_t last = i + part.primitives; i < last; ++i) {
        lifespans_[i] = {set_.time[i] + part.begin_ticks, displayed};
      }
    }
    fits_.resize(set_.size());
    parallel_blocks(std::size_t{0}, set_.size(), kPrimitivesPerTask,
                    [&](std::size_t first, std::size_t last) {
                      for (std::size_t k = first; k < last; ++k) {
                        const Lifespan& l = lifespans_[k];
                        fits_[k] = fit_lifespan(l.time, set_.sigma[k], set_.radius[k], l.displayed);
                      }
                    });
    for (std::size_t k = 0; k < set_.size(); ++k) {
      if (is_visible(k)) visible_.push_back(static_cast<std::uint32_t>(k));
    }
  }

  bool is_visible(std::size_t i) const {
    const Lifespan& l = lifespans_[i];
    if (!(l.displayed.begin < l.displayed.end)) return false;
    const double nearest = std::clamp(l.time, l.displayed.begin, l.displayed.end);
    const double beyond =
        std::max(0.0, std::abs(nearest - l.time) - set_.radius[i]) / double{set_.sigma[i]};
    return math::opacity_of(set_.opacity_logit[i]) * std::exp(-beyond * beyond) >=
           double{math::kAlphaThreshold};
  }

  // The position at the time of the fit, scene units.
  double position_at(std::size_t i, std::size_t axis, double ticks) const {
    return set_.position[3 * i + axis] +
           double{set_.velocity[3 * i + axis]} * (ticks - lifespans_[i].time);
  }

  // Returns the middle standard deviation that three quarters of the primitives exceed.
  double small_size() const {
    std::vector<double> sizes;
    for (std::size_t k = 0; k < visible_.size(); k += 1 + visible_.size() / 10'000) {
      std::array<float, 3> s;
      std::copy_n(set_.log_scale.begin() + 3 * static_cast<std::ptrdiff_t>(visible_[k]), 3,
                  s.begin());
      std::sort(s.begin(), s.end());
      sizes.push_back(std::exp(std::clamp(double{s[1]}, -60.0, 60.0)));
    }
    if (sizes.empty()) return 1;
    const auto quarter = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 4);
    std::nth_element(sizes.begin(), quarter, sizes.end());
    return *quarter;
  }

  void choose_steps() {
    Grid& grid = out_.grid;
    grid.cutoff = 1.0 / 255;
    std::array<double, 3> low{}, high{};
    double fastest = 0;
    for (std::size_t k = 0; k < visible_.size(); ++k) {
      const std::uint32_t i = visible_[k];
      for (std::size_t c = 0; c < 3; ++c) {
        const double p = position_at(i, c, fits_[i].time);
        low[c] = k == 0 ? p : std::min(low[c], p);
        high[c] = k == 0 ? p : std::max(high[c], p);
        fastest = std::max(fastest, std::abs(double{set_.velocity[3 * i + c]}));
      }
    }
    grid.origin = low;
    const double error = kPositionError * small_size();
    grid.position = 2 * error;
    for (std::size_t c = 0; c < 3; ++c) {
      grid.position = std::max(grid.position, (high[c] - low[c]) / kMaxBin);
    }
    grid.log_scale = grid.log_sigma = 2 * std::log1p(kLogError);
    grid.rotation = 2 * kRotationError;
    grid.colour = grid.opacity = 2 * kColourError;
    // Velocities are stored up to four times finer than this. A wrong one moves its primitive by at
    // most the error of positions over the clip.
    grid.motion = grid.position * std::min(2.0, 4 / duration_);
    grid.motion = std::max(grid.motion, 4 * fastest / base_.seconds(1) / kMaxBin);
    grid.time = base_.seconds(kTimeStep);
  }

  std::int32_t window_of(const LifespanFit& fit) {
    // Windows of 0 and the duration are exact, so that they compare equal to these.
    const double end = fit.end >= scene_.metadata.frames ? duration_ : base_.seconds(fit.end);
    const std::pair<double, double> key = {base_.seconds(fit.begin), end};
    const auto [found, is_new] = window_numbers_.emplace(key, out_.windows.size());
    if (is_new) out_.windows.push_back({key.first, key.second});
    return static_cast<std::int32_t>(found->second);
  }

  Status add(std::uint32_t i) {
    const LifespanFit& fit = fits_[i];
    Population& set = out_.set;
    const Grid& grid = out_.grid;
    bool ok = true;
    const std::int32_t window = window_of(fit);
    const Window& times = out_.windows[static_cast<std::size_t>(window)];
    const double deviation =
        base_.seconds(std::max(fit.sigma / std::numbers::sqrt2, kMinDeviation));
    const std::int32_t sigma =
        fit.never_fades ? 0 : bin_of(std::log(deviation), grid.log_sigma, ok);
    const double time_step = grid.time_step(sigma, fit.never_fades);
    const double motion_step = grid.motion_step(sigma, fit.never_fades, times.end - times.begin);
    const std::int32_t time = bin_of(base_.seconds(fit.time), time_step, ok);
    set.bins[kTime].push_back(time);
    set.bins[kSigma].push_back(sigma);
    set.bins[kFlags].push_back(fit.never_fades ? kNeverFades : 0);
    set.bins[kWindow].push_back(window);
    // The rounded time, so that the rounding moves nothing.
    const double ticks = base_.ticks(time * time_step);
    for (std::size_t c = 0; c < 3; ++c) {
      set.bins[kPosition].push_back(
          bin_of(position_at(i, c, ticks) - grid.origin[c], grid.position, ok));
      set.bins[kMotion].push_back(
          bin_of(set_.velocity[3 * i + c] / base_.seconds(1), motion_step, ok));
      set.bins[kScale].push_back(bin_of(set_.log_scale[3 * i + c], grid.log_scale, ok));
    }
    const double opacity = math::opacity_of(set_.opacity_logit[i]);
    set.bins[kOpacity].push_back(std::max(1, bin_of(opacity, grid.opacity, ok)));
    add_rotation(i);
    add_colour(i);
    if (!ok) {
      return unsupported(
          "primitive {} has a position, velocity, size or time beyond the range of "
          "the format",
          i);
    }
    finish(i, times);
    return {};
  }

  void add_rotation(std::size_t i) {
    std::array<double, 4> q;  // x y z w
    for (std::size_t c = 0; c < 4; ++c) q[c] = set_.rotation[4 * i + (c + 1) % 4];
    const auto largest = static_cast<std::size_t>(
        std::max_element(q.begin(), q.end(),
                         [](double a, double b) { return std::abs(a) < std::abs(b); }) -
        q.begin());
    double length = 0;
    for (const double v : q) length += v / q[largest] * (v / q[largest]);
    length = std::sqrt(length) * q[largest];  // with the sign of the largest component
    out_.set.bins[kRotationIndex].push_back(static_cast<std::int32_t>(largest));
    bool ok = true;
    for (std::size_t c = 0; c < 4; ++c) {
      if (c == largest) continue;
      out_.set.bins[kRotation].push_back(bin_of(q[c] / length, out_.grid.rotation, ok));
    }
  }

  void add_colour(std::size_t i) {
    const auto coefficients = static_cast<std::size_t>(set_.sh_coefficients());
    const float* sh = set_.sh.data() + 3 * coefficients * i;
    std::array<std::int32_t, 3> rgb{};
    bool ok = true;
    for (std::size_t c = 0; c < 3; ++c) {
      const double v = colours_(0.5 + math::kSh00 * double{sh[c]}, 0, 1, kColourError);
      rgb[c] = bin_of(v, out_.grid.colour, ok);
    }
    auto& bins = out_.set.bins[kColour];
    bins.insert(bins.end(), {rgb[1], rgb[0] - rgb[1], rgb[2] - rgb[1]});
    for (std::size_t k = 3; k < 3 * coefficients; ++k) {
      const double v = harmonics_(sh[k], kShLow, -kShLow, kShStep / 2);
      out_.set.sh.push_back(static_cast<std::uint8_t>(std::lround((v - kShLow) / kShStep)));
    }
  }

  // Removes the Gaussian again if its rounded form is never visible.
  void finish(std::uint32_t i, const Window& times) {
    Population& set = out_.set;
    const std::size_t last = set.size() - 1;
    const Gaussian g = dequantise(set, last, out_.grid, times);
    if (is_never_visible(g, times, duration_, out_.grid.cutoff)) {
      for (std::size_t a = 0; a < kAttributes; ++a) set.bins[a].resize(last * kChannels[a]);
      set.sh.resize(last * 3 * static_cast<std::size_t>(set_.sh_coefficients() - 1));
      return;
    }
    const double reach = fits_[i].never_fades ? duration_ : 1.001 * out_.grid.reach() * g.deviation;
    out_.support.push_back({std::max({0.0, times.begin, g.centre - reach}),
                            std::min({duration_, times.end, g.centre + reach})});
    for (std::size_t c = 0; c < 3; ++c) {
      double& low = out_.bounds[c];
      double& high = out_.bounds[c + 3];
      low = last == 0 ? g.position[c] : std::min(low, g.position[c]);
      high = last == 0 ? g.position[c] : std::max(high, g.position[c]);
    }
    out_.source.push_back(i);
    const LifespanFit& fit = fits_[i];
    if (fit.error_max > kExactFit) ++(fit.never_fades ? hard_ : soft_);
    error_max_ = std::max(error_max_, fit.error_max);
    squares_ += fit.error_squares;
    ticks_ += fit.ticks;
  }

  void add_notes(ConversionNotes* notes) const {
    const std::size_t kept = out_.source.size();
    if (kept < set_.size()) {
      note(notes, fmt::format("dropped {} of {} primitives that are never visible",
                              set_.size() - kept, set_.size()));
    }
    if (soft_ + hard_ > 0) {
      note(notes,
           fmt::format("approximated the lifespans of {} of {} primitives by a Gaussian and of {} "
                       "by hard edges: visibility differs by up to {:.2g}, {:.2g} rms",
                       soft_, kept, hard_, error_max_, std::sqrt(squares_ / ticks_)));
    }
    if (colours_.count > 0) {
      note(notes, fmt::format("clipped {} of {} colours to the range from 0 to 1, by up to {:.2g}",
                              colours_.count, 3 * kept, colours_.most));
    }
    if (harmonics_.count > 0) {
      note(notes,
           fmt::format("clipped {} of {} SH coefficients to the range from -4 to 4, by up to "
                       "{:.2g}",
                       harmonics_.count, out_.set.sh.size(), harmonics_.most));
    }
  }

  const Scene& scene_;
  const Gaussians4D& set_;
  TimeBase base_;
  double duration_;
  std::vector<Lifespan> lifespans_;
  std::vector<LifespanFit> fits_;
  std::vector<std::uint32_t> visible_;
  std::map<std::pair<double, double>, std::size_t> window_numbers_;
  CodedScene out_;
  Clipping colours_, harmonics_;
  std::uint64_t soft_ = 0, hard_ = 0;
  double error_max_ = 0, squares_ = 0, ticks_ = 0;
};

}  // namespace

Result<CodedScene> encode_set(const Scene& scene, double duration, ConversionNotes* notes) {
  return Encoder(scene, duration).run(notes);
}

}  // namespace stgs::fourdgs
