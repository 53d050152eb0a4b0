// SPDX-License-Identifier: Apache-2.0
// The errors that files state (spec 4.7), and the near-lossless profile.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "catch.h"
#include "fixtures/recording_fixture.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/differences.h"

using namespace stgs;
using stgs::testing::random_scene;
using stgs::testing::TemporaryFolder;

namespace {

using Quat = std::array<double, 4>;

Quat product(const Quat& a, const Quat& b) {
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
          a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

double dot(const Quat& a, const Quat& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

// A rotation that maps the axes onto each other: axis k to axis `to[k]`.
struct Turn {
  Quat rotation{1, 0, 0, 0};
  std::array<std::size_t, 3> to{0, 1, 2};
};

// The 24 of them: all products of quarter turns.
std::vector<Turn> all_turns() {
  const double h = std::sqrt(0.5);
  const std::array<Turn, 3> quarters = {
      {{{h, h, 0, 0}, {0, 2, 1}}, {{h, 0, h, 0}, {2, 1, 0}}, {{h, 0, 0, h}, {1, 0, 2}}}};
  std::vector<Turn> out = {{}};
  for (std::size_t i = 0; i < out.size(); ++i) {
    for (const Turn& quarter : quarters) {
      Turn next{product(quarter.rotation, out[i].rotation), {}};
      for (std::size_t k = 0; k < 3; ++k) next.to[k] = quarter.to[out[i].to[k]];
      const bool known = std::any_of(out.begin(), out.end(), [&](const Turn& turn) {
        return std::abs(dot(turn.rotation, next.rotation)) > 0.99;
      });
      if (!known) out.push_back(next);
    }
  }
  REQUIRE(out.size() == 24);
  return out;
}

Quat rotation_of(const Gaussians4D& set, std::size_t i) {
  Quat q;
  std::copy_n(set.rotation.data() + 4 * i, 4, q.begin());
  const double length = std::sqrt(dot(q, q));
  for (double& v : q) v /= length;
  return q;
}

double visibility(double dt, double sigma, double radius) {
  const double beyond = std::max(0.0, std::abs(dt) - radius) / sigma;
  return std::exp(-beyond * beyond);
}

struct Measured {
  double greatest = 0, squares = 0, count = 0;
  void add(double error) {
    greatest = std::max(greatest, error);
    squares += error * error;
    ++count;
  }
};
using Errors = std::map<Attribute, Measured>;

void add_shape(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
               Errors& errors) {
  static const std::vector<Turn> turns = all_turns();
  const Quat p = rotation_of(a, i), q = rotation_of(b, j);
  // Axis k of a Gaussian with rotation p is axis to[k] of one with rotation p times the inverse.
  const Turn* best = nullptr;
  double nearest = -1;
  for (const Turn& turn : turns) {
    const Quat back{turn.rotation[0], -turn.rotation[1], -turn.rotation[2], -turn.rotation[3]};
    const double near = std::abs(dot(product(p, back), q));
    if (near <= nearest) continue;
    nearest = near;
    best = &turn;
  }
  errors[Attribute::kRotation].add(2.0 * std::acos(std::min(1.0, nearest)));
  for (std::size_t k = 0; k < 3; ++k) {
    errors[Attribute::kLogScale].add(
        std::abs(double{a.log_scale[3 * i + k]} - b.log_scale[3 * j + best->to[k]]));
  }
}

void add_lifespan(const Gaussians4D& a, std::size_t i, const Gaussians4D& b, std::size_t j,
                  double length, Errors& errors) {
  const auto logit = [](double x) { return std::log(x / (1.0 - x)); };
  double opacity = a.opacity_logit[i];
  const bool constant = b.time[j] - b.radius[j] <= 0 && b.time[j] + b.radius[j] >= length;
  if (constant) {
    const double peak =
        visibility(std::clamp<double>(a.time[i], 0, length) - a.time[i], a.sigma[i], a.radius[i]);
    if (peak < 1) opacity = logit(peak / (1.0 + std::exp(-opacity)));
  }
  errors[Attribute::kOpacity].add(std::abs(opacity - b.opacity_logit[j]));
  const auto inside = [length](double time, double radius) {
    const double way = std::clamp(std::clamp(time, 0.0, length) - time, -radius, radius);
    return std::pair(time + way, radius - std::abs(way));
  };
  const auto was = inside(a.time[i], a.radius[i]), is = inside(b.time[j], b.radius[j]);
  errors[Attribute::kTime].add(constant ? 0 : std::abs(was.first - is.first));
  errors[Attribute::kRadius].add(constant ? 0 : std::abs(was.second - is.second));
  errors[Attribute::kSigma].add(constant ? 0 : std::abs(double{a.sigma[i]} - b.sigma[j]));
}

// The errors as spec 4.7 defines them: `coded` has primitive order[j] of the scene at j.
Errors measure(const Scene& scene, const Scene& coded, const std::vector<std::uint32_t>& order) {
  Errors out;
  const Gaussians4D &a = scene.gaussians, &b = coded.gaussians;
  const std::size_t stride = 3 * static_cast<std::size_t>(a.sh_coefficients());
  for_each_in_part(coded, [&](std::size_t j, const TickRange& part) {
    const std::size_t i = order[j];
    double x = 0, u = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double v = a.velocity[3 * i + c];
      const double at = a.position[3 * i + c] + v * (double{b.time[j]} - a.time[i]);
      x += std::pow(at - b.position[3 * j + c], 2);
      u += std::pow(v - b.velocity[3 * j + c], 2);
    }
    out[Attribute::kPosition].add(std::sqrt(x));
    out[Attribute::kVelocity].add(std::sqrt(u));
    add_shape(a, i, b, j, out);
    add_lifespan(a, i, b, j, part.end - part.begin, out);
    for (std::size_t c = 0; c < stride; ++c) {
      const std::size_t band = c < 3 ? 0 : c < 12 ? 1 : c < 27 ? 2 : 3;
      constexpr Attribute kBands[] = {Attribute::kSh0, Attribute::kSh1, Attribute::kSh2,
                                      Attribute::kSh3};
      out[kBands[band]].add(std::abs(double{a.sh[i * stride + c]} - b.sh[j * stride + c]));
    }
  });
  return out;
}

// A random scene with unusual lifespans and opacities, and primitives of a lower SH degree.
Scene unusual_scene(int sh_degree, unsigned seed) {
  constexpr std::uint32_t kFrames = 50;
  Scene scene = random_scene(3000, sh_degree, kFrames, seed);
  Gaussians4D& set = scene.gaussians;
  const std::size_t coefficients = static_cast<std::size_t>(set.sh_coefficients());
  for (std::size_t i = 0; i < set.size(); ++i) {
    if (i % 7 == 0) set.sigma[i] = 0.05f;
    if (i % 11 == 0) set.time[i] -= 40.0f;
    if (i % 11 == 1) set.time[i] += 40.0f, set.radius[i] = 30.0f;
    if (i % 13 == 0) set.sigma[i] = 1e6f;
    if (i % 17 == 0) set.radius[i] = 200.0f;
    if (i % 19 == 0) set.opacity_logit[i] = i % 2 == 0 ? 18.0f : 9.0f;
    if (i % 3 == 0)
      std::fill_n(set.sh.data() + 3 * i * coefficients + 3, 3 * coefficients - 3, 0.0f);
  }
  scene.parts = {{0, 30, 1000}, {20, kFrames, 2000}};
  return scene;
}

struct Coded {
  Scene scene;
  std::vector<std::uint32_t> order;
  std::vector<ErrorBound> bounds;
  std::uint64_t bytes = 0;
};

Coded code(const Scene& scene, const WriteSettings& settings) {
  Coded out;
  const auto bytes = encode_scene(scene, settings, &out.order);
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  out.bytes = bytes->size();
  const auto issues = validate_scene(*memory_source(*bytes));
  REQUIRE(issues.ok());
  for (const Issue& issue : *issues) FAIL_CHECK(issue.message);
  const auto reader = SceneReader::open(memory_source(*bytes));
  REQUIRE(reader.ok());
  CHECK((*reader)->profile() == settings.profile);
  out.bounds = (*reader)->error_bounds();
  auto read = read_scene(memory_source(*bytes));
  REQUIRE(read.ok());
  out.scene = std::move(*read);
  return out;
}

WriteSettings settings_of(Profile profile, double quality = 87) {
  WriteSettings settings;
  settings.profile = profile;
  settings.quality = quality;
  return settings;
}

double greatest(const Coded& coded, Attribute attribute) {
  for (const ErrorBound& bound : coded.bounds) {
    if (bound.attribute == attribute) return bound.greatest;
  }
  FAIL("no bound of attribute " << static_cast<int>(attribute));
  return 0;
}

void check_bounds(const Scene& scene, const WriteSettings& settings) {
  const Coded coded = code(scene, settings);
  REQUIRE(coded.bounds.size() == 9 + static_cast<std::size_t>(scene.gaussians.sh_degree));
  Errors errors = measure(scene, coded.scene, coded.order);
  for (const ErrorBound& bound : coded.bounds) {
    INFO("attribute " << static_cast<int>(bound.attribute) << ", quality " << settings.quality);
    const Measured& found = errors[bound.attribute];
    // The arc cosine of the test is less exact than what the writer uses.
    const double slack = bound.attribute == Attribute::kRotation ? 1e-6 : 1e-9;
    CHECK(found.greatest <= bound.greatest * (1 + 1e-6) + slack);
    CHECK(found.greatest >= bound.greatest * (1 - 1e-6) - slack);
    CHECK(std::sqrt(found.squares / found.count) == Approx(bound.rms).epsilon(1e-4).margin(slack));
    CHECK(bound.rms <= bound.greatest);
  }
}

}  // namespace

TEST_CASE("a file states the errors of all attributes, at every SH degree and quality") {
  for (int sh_degree = 0; sh_degree <= 3; ++sh_degree) {
    const Scene scene = unusual_scene(sh_degree, 5 + static_cast<unsigned>(sh_degree));
    for (const double quality : {30.0, 87.0, 100.0})
      check_bounds(scene, settings_of(Profile::kQuantised, quality));
    check_bounds(scene, settings_of(Profile::kNearLossless));
  }
}

TEST_CASE("errors are stated for every coding of the planes") {
  const Scene scene = unusual_scene(2, 3);
  WriteSettings settings = settings_of(Profile::kQuantised);
  settings.own_layouts = true;
  check_bounds(scene, settings);
  settings.coder = SceneCoder::kBytes;
  check_bounds(scene, settings);
  check_bounds(random_scene(40, 3, 20, 1), settings_of(Profile::kNearLossless));
  if (check_profile(Profile::kDraco).ok()) check_bounds(scene, settings_of(Profile::kDraco));
}

TEST_CASE("an empty scene has errors of 0") {
  const Coded coded = code(random_scene(0, 1, 20, 1), settings_of(Profile::kNearLossless));
  for (const ErrorBound& bound : coded.bounds) CHECK(bound.greatest + bound.rms == 0.0f);
}

TEST_CASE("lossless files and recordings state no errors") {
  CHECK(code(random_scene(100, 1, 20, 1), settings_of(Profile::kLossless)).bounds.empty());
  const TemporaryFolder folder;
  testing::record(folder / "r.stgs", 2, true, Profile::kQuantised);
  CHECK(testing::open_scene(folder / "r.stgs")->error_bounds().empty());
}

TEST_CASE("a near-lossless recording is rejected, naming another profile") {
  const TemporaryFolder folder;
  const std::string path = folder / "r.stgs";
  const auto recorder = SceneRecorder::create(path, testing::recording_metadata(), 1,
                                              testing::recording_settings(Profile::kNearLossless));
  CHECK(recorder.status().code() == StatusCode::kUsage);
  CHECK(recorder.status().message().find("lossless") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(path));
}

TEST_CASE("near-lossless errors are far below those of quality 100") {
  const Scene scene = random_scene(20000, 3, 60, 8);
  const Coded fine = code(scene, settings_of(Profile::kNearLossless));
  const Coded best = code(scene, settings_of(Profile::kQuantised, 100));
  const Coded exact = code(scene, settings_of(Profile::kLossless));
  CHECK(best.bytes < fine.bytes);
  CHECK(2 * fine.bytes < exact.bytes);
  for (const ErrorBound& bound : fine.bounds) {
    INFO("attribute " << static_cast<int>(bound.attribute));
    CHECK(bound.greatest < 0.5f * greatest(best, bound.attribute));
  }
  CHECK(greatest(fine, Attribute::kLogScale) <= 0x1p-9);
  CHECK(greatest(fine, Attribute::kOpacity) <= 0x1p-6);
  CHECK(greatest(fine, Attribute::kTime) <= 0x1p-8);
  for (const Attribute sh : {Attribute::kSh0, Attribute::kSh1, Attribute::kSh2, Attribute::kSh3})
    CHECK(greatest(fine, sh) <= 0x1p-8);
  // Never visible ones are left out, nothing else.
  CHECK(fine.order.size() == best.order.size());
}

TEST_CASE("near-lossless positions of a large scene have 24 bits") {
  Scene scene = random_scene(5000, 0, 30, 4);
  const double before =
      greatest(code(scene, settings_of(Profile::kNearLossless)), Attribute::kPosition);
  for (std::size_t i = 0; i < scene.gaussians.position.size(); ++i)
    scene.gaussians.position[i] *= 250.0f;
  const Coded coded = code(scene, settings_of(Profile::kNearLossless));
  const double extent = coded.scene.metadata.bounds_max[0] - coded.scene.metadata.bounds_min[0];
  CHECK(extent > 900);
  // 21 bits would give steps of 2^-11 units. Floats of this size are multiples of 2^-14.
  CHECK(greatest(coded, Attribute::kPosition) < 0x1p-12);
  CHECK(greatest(coded, Attribute::kPosition) < before + 0x1p-14);
  check_bounds(scene, settings_of(Profile::kNearLossless));
}

TEST_CASE("a near-lossless file keeps a stated position error") {
  const Scene scene = random_scene(2000, 0, 30, 4);
  WriteSettings settings = settings_of(Profile::kNearLossless);
  const Coded usual = code(scene, settings);
  settings.max_error = 0.25 * greatest(usual, Attribute::kPosition);
  const Coded tight = code(scene, settings);
  CHECK(greatest(tight, Attribute::kPosition) <= settings.max_error);
  CHECK(tight.bytes > usual.bytes);
}
