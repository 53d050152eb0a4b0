// SPDX-License-Identifier: Apache-2.0
#include "math_parity_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace stgs::test {
namespace {

using namespace stgs::math;

constexpr double kEpsilon = 1.0 / (1 << 23);

class Random {
 public:
  explicit Random(std::uint32_t seed) : bits_(seed) {}
  float operator()(double low, double high) {
    const double fraction = static_cast<double>(bits_()) / 4294967296.0;
    return static_cast<float>(low + (high - low) * fraction);
  }

 private:
  std::mt19937 bits_;
};

Quat random_quat(Random& random) {
  const float w = random(-1, 1), x = random(-1, 1), y = random(-1, 1), z = random(-1, 1);
  const float length = std::sqrt(w * w + x * x + y * y + z * z);
  return length > 0.1f ? Quat{w, x, y, z} : Quat{1, 0, 0, 0};
}

PinholeCamera random_camera(Random& random) {
  PinholeCamera camera{};
  camera.rotation = rotation_of(random_quat(random));
  camera.translation = {random(-5, 5), random(-5, 5), random(-5, 5)};
  camera.width = random(320, 3840);
  camera.height = camera.width * random(0.5, 1.0);
  camera.fx = camera.width * random(0.5, 1.5);
  camera.fy = camera.fx * random(0.9, 1.1);
  camera.cx = camera.width * random(0.4, 0.6);
  camera.cy = camera.height * random(0.4, 0.6);
  camera.near_plane = 0.2f;
  return camera;
}

double norm(Vec3 v) {
  return std::sqrt(static_cast<double>(dot3(v, v)));
}

// Collects one row per quantity, in the order of their first appearance.
class Comparison {
 public:
  // `tolerance` is the largest allowed |expected - actual|. A NaN counts as an infinite difference.
  void add(const char* quantity, std::size_t index, double expected, double actual,
           double tolerance) {
    auto row = std::find_if(rows.begin(), rows.end(),
                            [&](const ParityRow& r) { return r.quantity == quantity; });
    if (row == rows.end()) row = rows.insert(rows.end(), ParityRow{quantity});
    const double difference = expected == actual ? 0.0 : std::abs(expected - actual);
    double relative = difference / tolerance;
    if (!(relative < INFINITY)) relative = INFINITY;
    ++row->compared;
    if (difference > row->worst_difference) row->worst_difference = difference;
    if (relative > row->worst) {
      row->worst = relative;
      row->worst_index = index;
    }
  }
  void add(const char* quantity, std::size_t index, Vec3 expected, Vec3 actual, double tolerance) {
    add(quantity, index, expected.x, actual.x, tolerance);
    add(quantity, index, expected.y, actual.y, tolerance);
    add(quantity, index, expected.z, actual.z, tolerance);
  }
  void add(const char* quantity, std::size_t index, Sym2 expected, Sym2 actual, double tolerance) {
    add(quantity, index, expected.xx, actual.xx, tolerance);
    add(quantity, index, expected.xy, actual.xy, tolerance);
    add(quantity, index, expected.yy, actual.yy, tolerance);
  }

  std::vector<ParityRow> rows;
};

// ln(O / o_th) that the half width implies; 0 for a negative half width, which marks an invisible
// primitive.
double exponent_of(double half_width, double unit) {
  return half_width < 0.0 ? 0.0 : half_width * half_width / (unit * unit);
}

void compare_lifespan(const ParityInput& g, const ParityResult& e, const ParityResult& a,
                      std::size_t i, Comparison* out) {
  out->add("modulation f", i, e.modulation, a.modulation, 4 * kEpsilon * e.modulation);
  const double path = norm(g.velocity) / e.modulation * std::abs(g.dt);
  out->add("position X_t", i, e.position, a.position, 4 * kEpsilon * (norm(g.position) + path));
  out->add("visibility l(t)", i, e.visibility, a.visibility, 8 * kEpsilon);
  out->add("opacity O", i, e.opacity, a.opacity, 8 * kEpsilon);
  // Compares exponents, because a half width near 0 magnifies the smallest error.
  out->add("support ln(O/o_th)", i, exponent_of(e.support - g.radius, g.sigma),
           exponent_of(a.support - g.radius, g.sigma),
           64 * kEpsilon * (1.0 + g.radius / g.sigma) * (1.0 + std::abs(g.opacity_logit)));
}

// Compares the box and the exponent of the splat. `conic_tolerance` and `mean_tolerance` are
// absolute.
void compare_splat(const ParityInput& g, const ParityResult& e, const ParityResult& a,
                   std::size_t i, double conic_tolerance, double mean_tolerance, Comparison* out) {
  const auto form = [](Falloff f) { return Sym2{f.xx, f.xy, f.yy}; };
  out->add("falloff, 1/px^2", i, form(e.falloff), form(a.falloff), 1.5 * conic_tolerance);
  out->add("peak", i, e.peak, a.peak, 1.5e-4);
  const Projection& p = e.projection;
  const Vec2 extent = e.box.extent;
  // By how far the box meets the image; the other value of `visible` is right too at its edge.
  const double overlap =
      std::min({p.mean.x + extent.x, p.mean.y + extent.y, g.camera.width - (p.mean.x - extent.x),
                g.camera.height - (p.mean.y - extent.y)});
  const double edge = mean_tolerance + 1e-2 * (extent.x + extent.y);
  if (std::abs(overlap) > edge) out->add("box visible", i, e.box.visible, a.box.visible, 0.5);
  if (!e.box.visible || !a.box.visible) return;
  const double elongation = elongation_of(p);
  const double tolerance = 1e-4 + 8 * kEpsilon * elongation;
  out->add("box", i, exponent_of(extent.x, std::sqrt(2.0 * p.covariance.xx)),
           exponent_of(a.box.extent.x, std::sqrt(2.0 * a.projection.covariance.xx)),
           tolerance * kReachMax);
}

void compare_projection(const ParityInput& g, const ParityResult& e, const ParityResult& a,
                        std::size_t i, Comparison* out) {
  const Projection& p = e.projection;
  // p_camera = R p + t loses digits by cancellation; `reach` bounds the magnitudes in a depth.
  const double reach = norm(e.position) + norm(g.camera.translation);
  out->add("depth", i, p.depth, a.projection.depth, 8 * kEpsilon * reach);
  const bool at_near_plane = std::abs(p.depth - g.camera.near_plane) <= 8 * kEpsilon * reach;
  if (!at_near_plane) out->add("visible", i, p.visible, a.projection.visible, 0.5);
  if (!p.visible || !a.projection.visible) return;
  const double eta = kEpsilon * (1.0 + reach / p.depth);
  const double focal = std::max(g.camera.fx, g.camera.fy);
  const double slope = 1.0 + std::hypot(p.mean.x - g.camera.cx, p.mean.y - g.camera.cy) / focal;
  out->add("mean, px", i, p.mean.x, a.projection.mean.x, 8 * eta * focal * slope);
  out->add("mean, px", i, p.mean.y, a.projection.mean.y, 8 * eta * focal * slope);
  const double trace = static_cast<double>(p.covariance.xx) + p.covariance.yy;
  out->add("screen covariance, px^2", i, p.covariance, a.projection.covariance, 32 * eta * trace);
  const double determinant = static_cast<double>(p.covariance.xx) * p.covariance.yy -
                             static_cast<double>(p.covariance.xy) * p.covariance.xy;
  const double condition = trace * trace / determinant;
  const double conic_trace = static_cast<double>(p.conic.xx) + p.conic.yy;
  const double conic_tolerance = 32 * eta * condition;  // relative to the conic's trace
  out->add("conic, 1/px^2", i, p.conic, a.projection.conic, conic_tolerance * conic_trace);

  // Its square is 1 - (b tr V - b^2) / det V, with the rounding errors of V.
  const double coverage_tolerance = 32 * eta * condition;
  out->add("coverage^2", i, double{e.coverage} * e.coverage, double{a.coverage} * a.coverage,
           coverage_tolerance);

  out->add("extent ln(O_t/o_th)", i, exponent_of(e.extent.x, std::sqrt(2.0 * p.covariance.xx)),
           exponent_of(a.extent.x, std::sqrt(2.0 * a.projection.covariance.xx)), 1e-4);
  compare_splat(g, e, a, i, conic_tolerance * conic_trace, 8 * eta * focal * slope, out);
  const double dx = g.offset.x * std::max(e.extent.x, 0.0f);
  const double dy = g.offset.y * std::max(e.extent.y, 0.0f);
  const double power_tolerance = 1e-5 + conic_tolerance * conic_trace * (dx * dx + dy * dy);
  out->add("power", i, e.power, a.power, power_tolerance);
  // Alpha is cut to 0 at the threshold, so either side of it is correct.
  const double alpha_tolerance = 8 * kEpsilon + e.opacity * e.visibility * power_tolerance;
  const double expected_alpha = e.alpha, actual_alpha = a.alpha;
  const bool cut = (expected_alpha == 0.0) != (actual_alpha == 0.0);
  out->add("alpha", i, cut ? kAlphaThreshold : expected_alpha,
           cut ? std::max(expected_alpha, actual_alpha) : actual_alpha, alpha_tolerance);
}

void compare_colour(const ParityInput& g, const ParityResult& e, const ParityResult& a,
                    std::size_t i, Comparison* out) {
  const Vec3 centre = camera_centre(g.camera);
  const Vec3 d = {e.position.x - centre.x, e.position.y - centre.y, e.position.z - centre.z};
  const double direction =
      kEpsilon * (1.0 + (norm(e.position) + norm(g.camera.translation)) / norm(d));
  double weight = 0.5;
  for (float c : g.sh) weight += std::abs(c);
  for (int k = 0; k < 16; ++k) out->add("SH basis", i, e.basis[k], a.basis[k], 16 * direction);
  out->add("colour", i, e.colour, a.colour, 16 * direction * weight);
}

void compare_surface(const ParityInput& g, const ParityResult& e, const ParityResult& a,
                     std::size_t i, Comparison* out) {
  out->add("flatness", i, e.flatness, a.flatness, 8 * kEpsilon);
  const double reach = norm(e.position) + norm(g.camera.translation);
  const double distance = std::abs(e.plane.distance);
  // For a nearly edge-on plane either side is correct.
  if (!e.projection.visible || !a.projection.visible || distance <= 1e-3 * reach) return;
  out->add("plane normal", i, e.plane.normal, a.plane.normal, 32 * kEpsilon);
  out->add("plane distance", i, e.plane.distance, a.plane.distance, 32 * kEpsilon * reach);
  const Vec3 ray = pixel_ray(g.camera, e.projection.mean.x, e.projection.mean.y);
  const double slope = norm(ray), facing = -dot3(e.plane.normal, ray);
  if (facing < 1.1 * kSurfaceFacing) return;
  const double eta = 32 * kEpsilon * (1.0 + reach / e.projection.depth) * slope;
  out->add("plane depth", i, e.plane_depth, a.plane_depth,
           e.plane_depth * (eta / facing + 32 * kEpsilon * reach / distance));
  const double across = std::sqrt(std::max(slope * slope - facing * facing, 0.0));
  if (across > 1e-2)
    out->add("surface normal", i, e.surface_normal, a.surface_normal, eta / across);
}

}  // namespace

std::vector<ParityInput> random_parity_inputs(std::size_t count, std::uint32_t seed) {
  Random random(seed);
  std::vector<ParityInput> inputs(count);
  for (ParityInput& g : inputs) {
    g.camera = random_camera(random);
    g.rotation = random_quat(random);
    g.log_scale = {random(-6, -0.5), random(-6, -0.5), random(-6, -0.5)};
    g.opacity_logit = random(-7, 8);
    g.sigma = std::exp(random(-1, 6));
    g.radius = random(0, 1) < 0.3f ? 1e-6f : std::exp(random(-2, 5));
    g.dt = random(-1.5, 1.5) * (g.radius + 2 * g.sigma);
    g.velocity = {random(-10, 10), random(-10, 10), random(-10, 10)};
    g.offset = {random(-1.2, 1.2), random(-1.2, 1.2)};
    for (float& c : g.sh) c = random(-0.4, 0.4);
    // The position in the camera frame at time t, from which X follows.
    const float z = random(0, 1) < 0.05f ? random(-5, 0.3) : std::exp(random(-1.5, 3));
    const Vec3 in_camera = {random(-1, 1) * z, random(-1, 1) * z, z};
    const Vec3 from_centre = mat3_transpose_mul(g.camera.rotation, in_camera);
    const Vec3 centre = camera_centre(g.camera);
    const float s = g.dt / lifespan_modulation(g.sigma, g.radius);
    g.position = {centre.x + from_centre.x - g.velocity.x * s,
                  centre.y + from_centre.y - g.velocity.y * s,
                  centre.z + from_centre.z - g.velocity.z * s};
  }
  return inputs;
}

std::vector<ParityRow> compare_parity(const std::vector<ParityInput>& inputs,
                                      const std::vector<ParityResult>& results) {
  Comparison comparison;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const ParityInput& g = inputs[i];
    const ParityResult expected = evaluate_parity(g);
    compare_lifespan(g, expected, results[i], i, &comparison);
    const Sym3 e = expected.covariance;
    const Sym3 a = results[i].covariance;
    const double trace = static_cast<double>(e.xx) + e.yy + e.zz;
    const double tolerance = 32 * kEpsilon * trace;
    comparison.add("covariance", i, Vec3{e.xx, e.yy, e.zz}, Vec3{a.xx, a.yy, a.zz}, tolerance);
    comparison.add("covariance", i, Vec3{e.xy, e.xz, e.yz}, Vec3{a.xy, a.xz, a.yz}, tolerance);
    compare_projection(g, expected, results[i], i, &comparison);
    compare_colour(g, expected, results[i], i, &comparison);
    compare_surface(g, expected, results[i], i, &comparison);
  }
  return comparison.rows;
}

std::string parity_table(const std::vector<ParityRow>& rows) {
  std::string table =
      fmt::format("{:<26}{:>10}{:>14}{:>16}\n", "quantity", "values", "worst", "of tolerance");
  for (const ParityRow& row : rows)
    table += fmt::format("{:<26}{:>10}{:>14.3g}{:>15.1f}%\n", row.quantity, row.compared,
                         row.worst_difference, 100.0 * row.worst);
  return table;
}

}  // namespace stgs::test
