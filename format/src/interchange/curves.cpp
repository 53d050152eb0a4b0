// SPDX-License-Identifier: Apache-2.0
#include "interchange/curves.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "interchange/import.h"
#include "stgs/format/math/blend.h"

namespace stgs {
namespace {

constexpr double kThreshold = 1.0 / 255;  // opacity below which a primitive is not rendered
constexpr double kMaxPiecesPerFrame = 15;
constexpr double kMaxPieces = 4096;  // of a primitive

// The path, and the opacity over time, of one primitive. Times are ticks.
struct Curve {
  std::array<double, 3> acceleration;
  double magnitude;     // |acceleration|
  double middle_scale;  // middle standard deviation
  double opacity, time, sigma;
  double begin, end;  // the visible times in the clip; begin > end: none

  double opacity_at(double ticks) const {
    const double x = (ticks - time) / sigma;
    return opacity * std::exp(-x * x);
  }
  // Distance between the path over `duration` ticks and the line nearest to it.
  double distance(double duration) const { return magnitude * duration * duration / 8; }
};

Curve curve_of(const Gaussians4D& set, const std::vector<float>& acceleration, std::size_t i,
               double frames) {
  Curve curve;
  std::array<float, 3> log_scale;
  double square = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    curve.acceleration[c] = acceleration[3 * i + c];
    square += curve.acceleration[c] * curve.acceleration[c];
    log_scale[c] = set.log_scale[3 * i + c];
  }
  std::sort(log_scale.begin(), log_scale.end());
  curve.magnitude = std::sqrt(square);
  curve.middle_scale = std::exp(double{log_scale[1]});
  curve.opacity = 1 / (1 + std::exp(-double{set.opacity_logit[i]}));
  curve.time = set.time[i];
  curve.sigma = set.sigma[i];
  const double reach = curve.sigma * std::sqrt(std::log(std::max(1.0, curve.opacity * 255)));
  curve.begin = std::max(0.0, curve.time - reach);
  curve.end = std::min(frames, curve.time + reach);
  if (!(curve.opacity >= kThreshold)) curve.end = -1;
  return curve;
}

// A line for the times [begin, end), of constant opacity.
struct Piece {
  double begin, end;
  double opacity, opacity_error;
};

// The opacities of a curve at the frames, or fractions of frames, that a piece represents.
struct OpacityRange {
  double low, high;
};
OpacityRange opacities(const Curve& curve, double first, double last) {
  first = std::clamp(first, curve.begin, curve.end);
  last = std::clamp(last, curve.begin, curve.end);
  return {std::min(curve.opacity_at(first), curve.opacity_at(last)),
          curve.opacity_at(std::clamp(curve.time, first, last))};
}

// The cells into which the time of a curve is divided: frames, or an odd fraction of them so that
// the time of a frame is the middle of a cell. A piece has from `least` to `most` cells.
struct Cells {
  double per_frame, first, end;
  double least, most;

  double begin_of(double cell) const { return cell / per_frame - 0.5; }
  double middle_of(double cell) const { return (cell + 0.5) / per_frame - 0.5; }
};
Cells cells_of(const Curve& curve, double position_bound) {
  const double longest = std::sqrt(8 * position_bound / curve.magnitude);  // ticks
  Cells cells;
  cells.per_frame = 1;
  while (cells.per_frame * longest < 1 && cells.per_frame < kMaxPiecesPerFrame) {
    cells.per_frame += 2;
  }
  cells.first = std::floor((curve.begin + 0.5) * cells.per_frame);
  cells.end = std::floor((curve.end + 0.5) * cells.per_frame) + 1;
  cells.least = std::max(1.0, std::ceil((cells.end - cells.first) / kMaxPieces));
  cells.most = std::max(cells.least, std::floor(longest * cells.per_frame));
  return cells;
}

// Returns the end of the longest piece that begins at cell `first`.
double end_of_piece(const Curve& curve, const Cells& cells, double first, double opacity_bound) {
  const auto fits = [&](double end) {
    const OpacityRange range = opacities(curve, cells.middle_of(first), cells.middle_of(end - 1));
    return range.high - range.low <= 2 * opacity_bound;
  };
  const double limit = std::min(cells.end, first + cells.most);
  double good = std::min(limit, first + cells.least), bad = limit + 1;
  while (bad - good > 1) {
    const double middle = std::floor((good + bad) / 2);
    (fits(middle) ? good : bad) = middle;
  }
  return good;
}

// Calls body(piece) for the pieces of a curve in the order of time.
template <typename Body>
void each_piece(const Curve& curve, double position_bound, double opacity_bound, const Body& body) {
  const Cells cells = cells_of(curve, position_bound);
  for (double first = cells.first; first < cells.end;) {
    const double end = end_of_piece(curve, cells, first, opacity_bound);
    const OpacityRange range = opacities(curve, cells.middle_of(first), cells.middle_of(end - 1));
    const double opacity = std::max((range.low + range.high) / 2, 1.0001 * kThreshold);
    const double error = std::max(range.high - opacity, opacity - range.low);
    body(Piece{cells.begin_of(first), cells.begin_of(end), opacity, error});
    first = end;
  }
}

// Whether the best line for the complete lifespan is within the bound.
bool fits_one_line(const Curve& curve, double bound) {
  return !(curve.begin <= curve.end) || curve.distance(curve.end - curve.begin) <= bound;
}

// The line nearest to the path in [begin, end], in terms of dt = t - T: a dt^2 is approximated by
// a (2 m dt - m^2 + h^2 / 2), with m the middle and h the half length.
struct Line {
  double offset, slope;  // times a
};
Line line_for(double begin, double end, double time) {
  const double middle = (begin + end) / 2 - time, half = (end - begin) / 2;
  return {half * half / 2 - middle * middle, 2 * middle};
}

class Divider {
 public:
  Divider(const Gaussians4D& set, const std::vector<float>& acceleration, std::uint32_t frames,
          const CurveSettings& settings, CurveReport& report)
      : set_(set),
        acceleration_(acceleration),
        frames_(frames),
        settings_(settings),
        report_(report) {}

  // Returns the number of primitives that add() appends for primitive i.
  std::uint64_t count(std::size_t i) const {
    const std::optional<Curve> curve = divided(i);
    if (!curve) return 1;
    std::uint64_t pieces = 0;
    each_piece(*curve, bound(*curve), settings_.opacity, [&](const Piece&) { ++pieces; });
    return pieces;
  }

  void add(std::size_t i, Gaussians4D& out) {
    ++report_.primitives;
    const Curve curve = curve_of(set_, acceleration_, i, frames_);
    out.append(set_, i);
    if (curve.magnitude == 0) return;
    ++report_.curved;
    if (!std::isfinite(curve.magnitude)) {
      out.position[3 * (out.size() - 1)] = NAN;  // dropped with the others that are not finite
      return;
    }
    if (fits_one_line(curve, bound(curve))) {
      if (!(curve.begin <= curve.end)) return;  // never visible
      set_line(curve, i, line_for(curve.begin, curve.end, curve.time), out);
      measure(curve, curve.distance(curve.end - curve.begin));
      return;
    }
    out.resize(out.size() - 1);
    ++report_.divided;
    double farthest = 0;
    each_piece(curve, bound(curve), settings_.opacity, [&](const Piece& piece) {
      out.append(set_, i);
      set_line(curve, i, line_for(piece.begin, piece.end, curve.time), out);
      set_lifespan(curve, piece, out);
      farthest = std::max(farthest, curve.distance(piece.end - piece.begin));
      report_.opacity_max = std::max(report_.opacity_max, piece.opacity_error);
      ++report_.pieces;
    });
    if (farthest > bound(curve) * (1 + 1e-9)) ++report_.above_bound;
    measure(curve, farthest);
  }

 private:
  double bound(const Curve& curve) const { return settings_.position * curve.middle_scale; }

  std::optional<Curve> divided(std::size_t i) const {
    const Curve curve = curve_of(set_, acceleration_, i, frames_);
    if (curve.magnitude == 0 || !std::isfinite(curve.magnitude)) return {};
    if (fits_one_line(curve, bound(curve))) return {};
    return curve;
  }

  // Sets the motion of the last primitive, which is a copy of primitive i.
  void set_line(const Curve& curve, std::size_t i, const Line& line, Gaussians4D& out) const {
    const std::size_t at = 3 * (out.size() - 1);
    for (std::size_t c = 0; c < 3; ++c) {
      const double a = curve.acceleration[c];
      out.position[at + c] = static_cast<float>(set_.position[3 * i + c] + a * line.offset);
      out.velocity[at + c] = static_cast<float>(set_.velocity[3 * i + c] + a * line.slope);
    }
  }

  // Sets the lifespan of the last primitive, and moves it along its line to its new centre.
  void set_lifespan(const Curve& curve, const Piece& piece, Gaussians4D& out) const {
    const std::size_t i = out.size() - 1;
    const double end = piece.end - kEdgeWidth, middle = (piece.begin + end) / 2;
    for (std::size_t c = 0; c < 3; ++c) {
      out.position[3 * i + c] = static_cast<float>(
          out.position[3 * i + c] + double{out.velocity[3 * i + c]} * (middle - curve.time));
    }
    out.time[i] = static_cast<float>(middle);
    out.radius[i] = static_cast<float>((end - piece.begin) / 2);
    out.sigma[i] = static_cast<float>(kEdgeSigma);
    out.opacity_logit[i] = static_cast<float>(std::log(piece.opacity / (1 - piece.opacity)));
  }

  void measure(const Curve& curve, double distance) {
    report_.position_max = std::max(report_.position_max, distance);
    report_.position_relative_max =
        std::max(report_.position_relative_max, distance / curve.middle_scale);
  }

  const Gaussians4D& set_;
  const std::vector<float>& acceleration_;
  std::uint32_t frames_;
  const CurveSettings& settings_;
  CurveReport& report_;
};

}  // namespace

Result<Charged<Gaussians4D>> divide_curves(const Gaussians4D& set,
                                           const std::vector<float>& acceleration,
                                           std::uint32_t frames, const CurveSettings& settings,
                                           ImportMemory& memory, CurveReport& report) {
  Divider divider(set, acceleration, frames, settings, report);
  const std::uint64_t most =
      std::min(memory.limits().max_primitives, memory.available() / import_bytes(1, set.sh_degree));
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < set.size() && total <= most; ++i) total += divider.count(i);
  if (const Status fits = memory.check_count(total); !fits.ok()) {
    return Status(fits.code(),
                  fits.message() + " after the division of curved paths; raise the tolerance");
  }
  Charged<Gaussians4D> out;
  STGS_ASSIGN(out.lease,
              memory.take(import_bytes(total, set.sh_degree),
                          fmt::format("{}{} primitives after the division of curved paths",
                                      total > most ? "more than " : "", std::min(total, most))));
  out.value.sh_degree = set.sh_degree;
  out.value.reserve(static_cast<std::size_t>(total));
  for (std::size_t i = 0; i < set.size(); ++i) divider.add(i, out.value);
  return out;
}

void note_curves(const CurveReport& report, const CurveSettings& settings, ConversionNotes* notes) {
  if (report.curved == 0) return;
  note(notes, fmt::format("approximated {} curved paths by lines: error {:.3g} scene units at most "
                          "({:.3g} of the splat's size; bound {:.3g})",
                          report.curved, report.position_max, report.position_relative_max,
                          settings.position));
  if (report.divided > 0) {
    note(notes, fmt::format("divided {} of {} primitives into {} pieces that fade in steps: error "
                            "of the opacity at a frame {:.3g} at most (bound {:.3g})",
                            report.divided, report.primitives, report.pieces, report.opacity_max,
                            settings.opacity));
  }
  if (report.above_bound > 0) {
    note(notes, fmt::format("{} paths exceed the bound of the position: they would need more than "
                            "{} pieces per frame, or {} in total",
                            report.above_bound, kMaxPiecesPerFrame, kMaxPieces));
  }
}

}  // namespace stgs
