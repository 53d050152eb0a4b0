// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_scene.h"

#include <algorithm>
#include <charconv>
#include <numbers>

#include "interchange/import.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/text.h"

namespace stgs::fourdgs {
namespace {

constexpr std::uint32_t kCameraWidth = 1280, kCameraHeight = 720;  // the file has no image size

double srgb_of(double v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}
double srgb_slope(double v) {
  return v <= 0.0031308 ? 12.92 : 1.055 / 2.4 * std::pow(v, 1 / 2.4 - 1);
}

std::string value_of(const Contents& contents, const char* key) {
  const auto found = contents.metadata.find(key);
  return found == contents.metadata.end() ? std::string() : found->second;
}

// Signs that convert the axes of the file, and the direction of "up" after that; 0: unknown.
struct Axes {
  std::array<int, 3> sign = {1, 1, 1};
  std::array<double, 3> up{};
};

Axes axes_of(const FrameRecord& frame) {
  Axes axes;
  if (frame.up == 1) {
    // y down. A second mirror keeps a right-handed frame right-handed.
    axes.sign = {1, -1, frame.left_handed ? 1 : -1};
  } else if (frame.left_handed) {
    axes.sign[frame.up % 3 == 0 ? 1 : 0] = -1;  // not the axis that points up
  }
  if (frame.up >= 0) {
    const auto axis = static_cast<std::size_t>(frame.up % 3);
    axes.up[axis] = (frame.up < 3 ? 1 : -1) * axes.sign[axis];
  }
  return axes;
}

// Returns the axes that a record or, in older files, an entry of the metadata states.
FrameRecord frame_of(const Contents& contents, ConversionNotes* notes) {
  if (contents.frame) return *contents.frame;
  FrameRecord frame;
  const std::string text = value_of(contents, kAxesKey);
  if (text.empty()) return frame;
  if (text.starts_with("y-up")) frame.up = 1;
  if (text.starts_with("z-up")) frame.up = 2;
  if (frame.up < 0) {
    note(notes, fmt::format("unknown coordinate system {}: axes are unchanged", short_text(text)));
  }
  frame.left_handed = text.ends_with("left-handed");
  return frame;
}

std::array<double, 3> cross(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

bool normalise(std::array<double, 3>& v) {
  const double length = std::hypot(v[0], v[1], v[2]);
  for (double& c : v) c /= length;
  return length > 1e-12 && std::isfinite(length);
}

std::optional<StartCamera> start_camera(const CameraRecord& camera, const Axes& axes) {
  std::array<double, 3> position{}, z{};
  for (std::size_t c = 0; c < 3; ++c) {
    position[c] = axes.sign[c] * camera.position[c];
    z[c] = axes.sign[c] * (camera.target[c] - camera.position[c]);
  }
  const bool known = axes.up != std::array<double, 3>{};
  std::array<double, 3> down = {0, 1, 0};
  for (std::size_t c = 0; c < 3 && known; ++c) down[c] = -axes.up[c];
  if (!normalise(z) || !(camera.fov_y > 0 && camera.fov_y < 180)) return {};
  std::array<double, 3> x = cross(down, z);
  if (!normalise(x)) return {};
  const std::array<std::array<double, 3>, 3> rows = {x, cross(z, x), z};
  StartCamera out;
  for (std::size_t i = 0; i < 3; ++i) {
    double shift = 0;
    for (std::size_t j = 0; j < 3; ++j) {
      out.rotation[3 * i + j] = static_cast<float>(rows[i][j]);
      shift -= rows[i][j] * position[j];
    }
    out.translation[i] = static_cast<float>(shift);
    if (!std::isfinite(out.translation[i])) return {};
  }
  out.width = kCameraWidth;
  out.height = kCameraHeight;
  out.fx = out.fy =
      static_cast<float>(kCameraHeight / 2.0 / std::tan(camera.fov_y * std::numbers::pi / 360));
  out.cx = kCameraWidth / 2.0f;
  out.cy = kCameraHeight / 2.0f;
  return out;
}

void note_omitted(const Contents& contents, ConversionNotes* notes) {
  std::string text;
  const auto add = [&text](std::uint64_t count, const char* what) {
    if (count == 0) return;
    text += fmt::format("{}{} {}{}", text.empty() ? "" : ", ", count, what, count == 1 ? "" : "s");
  };
  add(contents.omitted.audio, "audio source");
  add(contents.omitted.attachments, "attachment");
  add(contents.omitted.provenance, "provenance record");
  add(contents.omitted.objects, "object table");
  add(contents.omitted.unknown, "unknown record");
  if (contents.camera) add(contents.camera->keyframes, "camera keyframe");
  if (!text.empty()) note(notes, "dropped " + text);
}

}  // namespace

Result<ColourConverter> ColourConverter::create(const Contents& contents) {
  const std::string space = value_of(contents, kColourKey);
  if (!space.empty() && space != kDisplayColour && space != kLinearColour) {
    return unsupported("{}: unknown colour space (expected {} or {}, got {})", contents.file,
                       kDisplayColour, kLinearColour, short_text(space));
  }
  ColourConverter out;
  out.linear_ = space == kLinearColour;
  out.degree_ = contents.header.sh_degree;
  out.coefficients_ = static_cast<std::size_t>((out.degree_ + 1) * (out.degree_ + 1));
  return out;
}

void ColourConverter::append(const std::array<double, 3>& rgb, const std::uint8_t* sh,
                             FloatArray& out) {
  const std::size_t begin = out.size();
  for (std::size_t c = 0; c < 3; ++c) {
    const double v = linear_ ? srgb_of(rgb[c]) : rgb[c];
    out.push_back(static_cast<float>((v - 0.5) / math::kSh00));
  }
  for (std::size_t k = 0; k < 3 * (coefficients_ - 1); ++k) {
    const double slope = linear_ ? srgb_slope(rgb[k % 3]) : 1;
    out.push_back(static_cast<float>((kShLow + sh[k] * kShStep) * slope));
  }
  if (linear_ && degree_ > 0) measure(rgb, out.data() + begin);
}

// Compares the converted colour with that of the file, seen along the axes and diagonals.
void ColourConverter::measure(const std::array<double, 3>& rgb, const float* sh) {
  for (int view = 0; view < 27; ++view) {
    const auto coordinate = [](int v) { return static_cast<float>(v % 3 - 1); };
    const float x = coordinate(view), y = coordinate(view / 3), z = coordinate(view / 9);
    const float length = std::sqrt(x * x + y * y + z * z);
    if (length == 0) continue;
    const math::ShBasis basis = math::sh_basis(math::vec3_of(x / length, y / length, z / length));
    for (std::size_t c = 0; c < 3; ++c) {
      double change = 0;
      for (std::size_t k = 1; k < coefficients_; ++k) change += double{basis.v[k]} * sh[3 * k + c];
      const double exact = srgb_of(std::clamp(rgb[c] + change / srgb_slope(rgb[c]), 0.0, 1.0));
      const double got = std::clamp(srgb_of(rgb[c]) + change, 0.0, 1.0);
      error_max_ = std::max(error_max_, std::abs(exact - got));
    }
  }
}

void ColourConverter::add_notes(ConversionNotes* notes) const {
  if (!linear_) return;
  note(notes, fmt::format("linear colours were converted to sRGB: colours that depend on the view "
                          "differ by up to {:.3g}, and primitives blend in sRGB",
                          error_max_));
}

float logit_of(double opacity) {
  const double logit = std::log(opacity) - std::log1p(-opacity);
  return static_cast<float>(std::min(logit, double{kOpaqueLogit}));
}

void append_shape(const Gaussian& g, Gaussians4D& out) {
  for (const double v : g.log_scale) out.log_scale.push_back(static_cast<float>(v));
  for (const double v : g.rotation) out.rotation.push_back(static_cast<float>(v));
  out.opacity_logit.push_back(logit_of(g.opacity));
}

bool is_representable(const Gaussian& g) {
  const auto fits = [](double v) { return std::isfinite(static_cast<float>(v)); };
  return std::all_of(g.position.begin(), g.position.end(), fits) &&
         std::all_of(g.log_scale.begin(), g.log_scale.end(), fits) &&
         std::all_of(g.motion.begin(), g.motion.end(), fits) && fits(g.centre) &&
         !std::isnan(g.opacity) && !std::isnan(g.rgb[0] + g.rgb[1] + g.rgb[2]) &&
         std::isfinite(g.rotation[0] + g.rotation[1] + g.rotation[2] + g.rotation[3]);
}

Status read_sh(const ByteSource& source, const Contents& contents, std::size_t& next,
               const std::vector<std::uint32_t>& rows, ImportMemory& memory, Population& out) {
  const int degree = contents.header.sh_degree;
  const BandRange all = band_range(degree + 1);  // `first` is the number of coefficients
  const std::size_t sh_bytes = out.size() * 3 * all.first;
  if (sh_bytes > out.sh.size()) {
    STGS_ASSIGN(Lease lease, memory.take(sh_bytes, "the SH of Gaussians"));
    out.sh.reserve(sh_bytes);
    out.sh.resize(sh_bytes);
    out.lease.merge(std::move(lease));
  }
  int bands = 0;
  for (; next < contents.body.size() && contents.body[next].opcode == kBand; ++next) {
    const BodyRecord& record = contents.body[next];
    const Place place = place_of(contents, record);
    STGS_ASSIGN(const ChargedBytes content, read_body(source, record, memory));
    int band = 0;
    STGS_ASSIGN(const Stream stream, read_band(content.value, rows.size(), band, memory, place));
    if (band != ++bands || band > degree) {
      return invalid_file("{}: unexpected SH band {} in a file of SH degree {}{}", place.file, band,
                          degree, place.text());
    }
    const BandRange range = band_range(band);
    const std::size_t width = range.last - range.first;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (std::size_t k = 0; k < 3 * width; ++k) {
        out.sh[(rows[i] * all.first + range.first + k % width) * 3 + k / width] =
            static_cast<std::uint8_t>(stream.values[i * 3 * width + k]);
      }
    }
  }
  if (bands == degree || rows.empty()) return {};
  return invalid_file("{}: a chunk has {} SH bands in a file of SH degree {}", contents.file, bands,
                      degree);
}

Result<std::uint32_t> count_frames(const Contents& contents, const TimeBase& base,
                                   std::uint32_t most) {
  const double ticks = base.ticks(contents.header.duration);
  if (!(ticks <= most)) {
    return unsupported(
        "{}: a clip of {:.6g} s has too many frames (at most {} allowed, got {:.6g}); lower the "
        "frame rate",
        contents.file, contents.header.duration, most, ticks);
  }
  return static_cast<std::uint32_t>(std::max(1.0, std::ceil(ticks - 1e-6)));
}

std::optional<TimeBase> stored_frame_time(const Contents& contents) {
  const std::string text = value_of(contents, kFrameKey);
  TimeBase base;
  const char* end = text.data() + text.size();
  const auto numerator = std::from_chars(text.data(), end, base.numerator);
  if (numerator.ec != std::errc() || numerator.ptr == end || *numerator.ptr != '/') return {};
  const auto denominator = std::from_chars(numerator.ptr + 1, end, base.denominator);
  if (denominator.ec != std::errc() || denominator.ptr != end) return {};
  if (base.numerator == 0 || base.denominator == 0) return {};
  return base;
}

void finish_scene(const Contents& contents, Scene& scene, ConversionNotes* notes) {
  const FrameRecord frame = frame_of(contents, notes);
  const Axes axes = axes_of(frame);
  if (axes.sign != std::array<int, 3>{1, 1, 1}) {
    flip_axes(scene.gaussians, axes.sign[0], axes.sign[1], axes.sign[2]);
  }
  SceneMetadata& metadata = scene.metadata;
  metadata.title = value_of(contents, kTitleKey);
  if (!is_utf8(metadata.title)) {
    metadata.title.clear();
    note(notes, "dropped a title that is not UTF-8");
  }
  metadata.metres_per_unit = static_cast<float>(frame.metres_per_unit);
  if (!std::isfinite(metadata.metres_per_unit)) metadata.metres_per_unit = 0;
  if (frame.up >= 0 && axes.up[1] == 0) {
    // Scenes have no rule for the axes, but viewers assume that y points down.
    for (std::size_t c = 0; c < 3; ++c) metadata.up[c] = static_cast<float>(axes.up[c]);
    note(notes, "up is not along y: stored with the scene, with a floor through the origin");
  }
  if (contents.camera) {
    metadata.start_camera = start_camera(*contents.camera, axes);
    if (!metadata.start_camera) note(notes, "dropped an invalid camera");
  }
  note_omitted(contents, notes);
}

}  // namespace stgs::fourdgs
