// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/splatv.h"
#include "stgs/format/math/sh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/bytes.h"
#include "interchange/import.h"
#include "interchange/json_fields.h"
#include "stgs/format/camera.h"

namespace stgs {
namespace {

using nlohmann::json;
using Vector = std::array<double, 3>;
using Quaternion = std::array<double, 4>;

constexpr std::uint32_t kMagic = 0x674B;
constexpr std::size_t kHeaderBytes = 8;  // magic, size of the JSON
constexpr std::size_t kRecordBytes = 64;
constexpr std::size_t kPixelBytes = 16;  // the records are stored as an image of such pixels
constexpr std::uint32_t kMaxHeaderBytes = 64 << 20;
constexpr std::size_t kBlockRecords = 1 << 16;
constexpr int kSamples = 17;  // times at which a path is evaluated

float half_to_float(std::uint32_t half) {
  const float sign = half & 0x8000 ? -1.0f : 1.0f;
  const int exponent = static_cast<int>(half >> 10 & 31);
  const auto mantissa = static_cast<float>(half & 1023);
  if (exponent == 31) return mantissa != 0 ? NAN : sign * INFINITY;
  if (exponent == 0) return sign * std::ldexp(mantissa, -24);
  return sign * std::ldexp(1024 + mantissa, exponent - 25);
}

// One record, in the units of the file: time 0 to 1.
struct Record {
  Vector position;
  Quaternion rotation;
  std::array<float, 3> scale;  // standard deviations
  std::array<std::uint8_t, 4> rgba;
  std::array<Vector, 3> motion;  // factors of dt, dt^2, dt^3
  Quaternion rotation_rate;      // factor of dt
  double centre, width;          // of its visibility exp(-((t - centre) / width)^2)
};

Record parse_record(std::span<const std::uint8_t> bytes) {
  ByteReader reader(bytes);
  Record r;
  for (double& v : r.position) v = reader.f32();
  const auto halves = [&reader] {
    const std::uint32_t both = reader.u32();
    return std::array<float, 2>{half_to_float(both & 0xFFFF), half_to_float(both >> 16)};
  };
  const auto four = [&halves](Quaternion& q) {
    for (std::size_t c = 0; c < 4; c += 2) {
      const auto pair = halves();
      q[c] = pair[0];
      q[c + 1] = pair[1];
    }
  };
  four(r.rotation);
  const auto xy = halves(), z = halves();
  r.scale = {xy[0], xy[1], z[0]};
  for (std::uint8_t& v : r.rgba) v = reader.u8();
  std::array<float, 10> motion;
  for (std::size_t i = 0; i < 10; i += 2) {
    const auto pair = halves();
    motion[i] = pair[0];
    motion[i + 1] = pair[1];
  }
  for (std::size_t i = 0; i < 9; ++i) r.motion[i / 3][i % 3] = motion[i];
  four(r.rotation_rate);
  const auto time = halves();
  r.centre = time[0];
  r.width = std::abs(time[1]);
  return r;
}

// A time within a primitive's lifespan, and its weight.
struct Sample {
  double dt, weight;
};

// Returns times spread over the interval in which a primitive of that opacity is visible; none if
// it never is.
std::vector<Sample> samples_of(const Record& r, double opacity) {
  const double margin = std::log(opacity * 255);
  if (!(margin >= 0) || !(r.width > 0) || !std::isfinite(r.centre)) return {};
  const double reach = r.width * std::sqrt(margin);
  const double begin = std::max(0.0, r.centre - reach), end = std::min(1.0, r.centre + reach);
  if (!(begin <= end)) return {};
  std::vector<Sample> out;
  for (int i = 0; i < kSamples; ++i) {
    const double dt = begin + (end - begin) * i / (kSamples - 1) - r.centre;
    out.push_back({dt, std::exp(-dt * dt / (r.width * r.width))});
  }
  return out;
}

Vector path_at(const Record& r, double dt) {
  Vector out;
  for (std::size_t c = 0; c < 3; ++c) {
    out[c] = dt * (r.motion[0][c] + dt * (r.motion[1][c] + dt * r.motion[2][c]));
  }
  return out;
}

// The line offset + dt * velocity.
struct Line {
  Vector offset{}, velocity{};
};

// Returns the least-squares line of a path.
Line fit_line(const Record& r, const std::vector<Sample>& samples) {
  double weight = 0, mean = 0, variance = 0;
  for (const Sample& s : samples) {
    weight += s.weight;
    mean += s.weight * s.dt;
  }
  mean /= weight;
  Line line;
  Vector at_mean{}, covariance{};
  for (const Sample& s : samples) {
    const Vector p = path_at(r, s.dt);
    variance += s.weight * (s.dt - mean) * (s.dt - mean);
    for (std::size_t c = 0; c < 3; ++c) {
      at_mean[c] += s.weight * p[c] / weight;
      covariance[c] += s.weight * (s.dt - mean) * p[c];
    }
  }
  for (std::size_t c = 0; c < 3; ++c) {
    line.velocity[c] = variance > 0 ? covariance[c] / variance : r.motion[0][c];
    line.offset[c] = at_mean[c] - mean * line.velocity[c];
  }
  return line;
}

Quaternion rotation_at(const Record& r, double dt) {
  Quaternion q;
  double square = 0;
  for (std::size_t c = 0; c < 4; ++c) {
    q[c] = r.rotation[c] + dt * r.rotation_rate[c];
    square += q[c] * q[c];
  }
  // A rotation of length 0 gives NaN: the primitive is dropped as invalid.
  const double length = square > 0 ? std::sqrt(square) : std::numeric_limits<double>::quiet_NaN();
  for (double& v : q) v /= length;
  return q;
}

double degrees_between(const Quaternion& a, const Quaternion& b) {
  double dot = 0;
  for (std::size_t c = 0; c < 4; ++c) dot += a[c] * b[c];
  return 2 * std::acos(std::min(1.0, std::abs(dot))) * 180 / std::numbers::pi;
}

// Location of the records, and the start camera.
struct Layout {
  std::uint64_t offset = 0, records = 0;
  std::optional<StartCamera> camera;
};

std::optional<StartCamera> start_camera(const json& cameras) {
  if (!cameras.is_array() || cameras.empty()) return {};
  const json& c = cameras[0];
  const json& rows = member(c, "rotation");
  if (!rows.is_array() || rows.size() != 3) return {};
  StartCamera out;
  const auto position = number_list(member(c, "position"), 3, "");
  float to_world[9];
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = number_list(rows[i], 3, "");
    if (!row.ok()) return {};
    for (std::size_t j = 0; j < 3; ++j) to_world[3 * i + j] = static_cast<float>((*row)[j]);
  }
  for (const char* name : {"width", "height", "fx", "fy"}) {
    if (!member(c, name).is_number()) return {};  // lists are not copied
  }
  const auto size = number_list({member(c, "width"), member(c, "height")}, 2, "");
  const auto focal = number_list({member(c, "fx"), member(c, "fy")}, 2, "");
  if (!position.ok() || !size.ok() || !focal.ok() || !is_rotation(to_world)) return {};
  for (double side : *size) {
    if (!(side >= 1 && side <= kMaxImageSide)) return {};
  }
  if (!((*focal)[0] > 0 && (*focal)[1] > 0)) return {};
  for (std::size_t i = 0; i < 3; ++i) {
    double t = 0;
    for (std::size_t j = 0; j < 3; ++j) {
      out.rotation[3 * i + j] = to_world[3 * j + i];
      t -= double{to_world[3 * j + i]} * (*position)[j];
    }
    out.translation[i] = static_cast<float>(t);
  }
  out.width = static_cast<std::uint32_t>((*size)[0]);
  out.height = static_cast<std::uint32_t>((*size)[1]);
  out.fx = static_cast<float>((*focal)[0]);
  out.fy = static_cast<float>((*focal)[1]);
  out.cx = static_cast<float>(out.width) / 2;
  out.cy = static_cast<float>(out.height) / 2;
  return out;
}

// Reads the list of chunks. The chunks follow the JSON in the order of the list.
Result<Layout> read_layout(const ByteSource& source, ImportMemory& memory) {
  std::array<std::uint8_t, kHeaderBytes> header;
  STGS_TRY(source.read(0, header));
  ByteReader reader(header);
  if (reader.u32() != kMagic) return invalid_file("{}: not a .splatv file", source.name());
  const std::uint32_t json_bytes = reader.u32();
  if (json_bytes > kMaxHeaderBytes || json_bytes > source.size() - kHeaderBytes) {
    return invalid_file("{}: JSON of {} bytes exceeds the remaining {} bytes (byte 4)",
                        source.name(), json_bytes, source.size() - kHeaderBytes);
  }
  STGS_ASSIGN(const Lease lease, memory.take(json_bytes, "the bytes of the list of chunks"));
  std::vector<std::uint8_t> text(json_bytes);
  STGS_TRY(source.read(kHeaderBytes, text));
  STGS_ASSIGN(const Charged<json> parsed,
              parse_json(text, source.name() + ": the list of chunks", memory));
  const json& chunks = parsed.value;
  if (!chunks.is_array()) return invalid_file("{}: JSON is not a list of chunks", source.name());
  std::optional<Layout> found;
  std::uint64_t at = kHeaderBytes + json_bytes;
  for (const json& chunk : chunks) {
    const json& size_field = member(chunk, "size");
    if (!size_field.is_number_unsigned()) {
      return invalid_file("{}: chunk without a size", source.name());
    }
    const auto size = size_field.get<std::uint64_t>();
    if (size > source.size() - at) {
      return invalid_file("{}: the file is truncated (chunk of {} bytes at byte {}, {} bytes left)",
                          source.name(), size, at, source.size() - at);
    }
    if (member(chunk, "type") == "splat") {
      if (found) return unsupported("{}: several chunks of splats", source.name());
      const json &width = member(chunk, "texwidth"), &height = member(chunk, "texheight");
      const std::uint64_t pixels = size / kPixelBytes;
      const auto columns = width.is_number_unsigned() ? width.get<std::uint64_t>() : 0;
      if (columns == 0 || !height.is_number_unsigned() || size % kRecordBytes != 0 ||
          pixels % columns != 0 || pixels / columns != height.get<std::uint64_t>()) {
        return invalid_file("{}: texwidth, texheight and size of a chunk do not match",
                            source.name());
      }
      found = Layout{at, size / kRecordBytes, start_camera(member(chunk, "cameras"))};
    }
    at += size;
  }
  if (!found) return invalid_file("{}: no chunk of type \"splat\"", source.name());
  return *found;
}

// Converts records to primitives and measures the error.
class Importer {
 public:
  Importer(const SplatvSettings& settings, Gaussians4D& set) : settings_(settings), set_(set) {}

  void add(const Record& r) {
    if (r.rgba[3] == 0) {
      ++empty_;  // the unused end of the image is zero
      return;
    }
    const float logit = logit_of_byte(r.rgba[3]);
    const std::vector<Sample> samples = samples_of(r, 1 / (1 + std::exp(-double{logit})));
    if (samples.empty()) {
      ++never_visible_;
      return;
    }
    const Line line = fit_line(r, samples);
    double mean_time = 0, weight = 0;
    for (const Sample& s : samples) {
      mean_time += s.weight * s.dt;
      weight += s.weight;
    }
    const Quaternion q = rotation_at(r, mean_time / weight);
    append(r, line, q, logit);
    measure(r, samples, line, q);
  }

  // Writes report and notes. Call it after invalid primitives have been dropped.
  void finish(const Layout& layout, SplatvReport* report, ConversionNotes* notes) {
    report_.primitives = set_.size();
    report_.path_rms = std::sqrt(squares_ / std::max<double>(1, static_cast<double>(measured_)));
    if (never_visible_ > 0) {
      note(notes, fmt::format("dropped {} of {} primitives that are never visible between times 0 "
                              "and 1",
                              never_visible_, layout.records - empty_));
    }
    if (report_.path_max > 0) {
      note(notes,
           fmt::format("approximated paths by lines: error {:.3g} scene units at most, {:.3g} "
                       "rms; {} of {} deviate by more than {} of their size",
                       report_.path_max, report_.path_rms, report_.bent, report_.primitives,
                       settings_.bend));
    }
    if (report_.rotation_max > 0.1) {
      note(notes, fmt::format("approximated rotating primitives by a constant rotation: error "
                              "{:.3g} degrees at most",
                              report_.rotation_max));
    }
    if (report != nullptr) *report = report_;
  }

 private:
  void append(const Record& r, const Line& line, const Quaternion& q, float logit) {
    const double frames = settings_.frames;
    for (std::size_t c = 0; c < 3; ++c) {
      set_.position.push_back(static_cast<float>(r.position[c] + line.offset[c]));
      set_.velocity.push_back(static_cast<float>(line.velocity[c] / frames));
      set_.log_scale.push_back(std::log(r.scale[c]));
      set_.sh.push_back(static_cast<float>((r.rgba[c] / 255.0 - 0.5) / math::kSh00));
    }
    for (double v : q) set_.rotation.push_back(static_cast<float>(v));
    set_.opacity_logit.push_back(logit);
    set_.time.push_back(static_cast<float>(r.centre * frames));
    set_.sigma.push_back(static_cast<float>(std::min(r.width, 65504.0) * frames));
    set_.radius.push_back(0);
  }

  void measure(const Record& r, const std::vector<Sample>& samples, const Line& line,
               const Quaternion& q) {
    double farthest = 0, turned = 0;
    for (const Sample& s : samples) {
      const Vector p = path_at(r, s.dt);
      double square = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const double d = p[c] - line.offset[c] - s.dt * line.velocity[c];
        square += d * d;
      }
      farthest = std::max(farthest, std::sqrt(square));
      turned = std::max(turned, degrees_between(q, rotation_at(r, s.dt)));
    }
    std::array<float, 3> scale = r.scale;
    if (!std::isfinite(farthest + turned + scale[0] + scale[1] + scale[2]))
      return;  // dropped later
    std::sort(scale.begin(), scale.end());
    report_.bent += farthest > settings_.bend * double{scale[1]} ? 1 : 0;
    report_.path_max = std::max(report_.path_max, farthest);
    report_.rotation_max = std::max(report_.rotation_max, turned);
    squares_ += farthest * farthest;
    ++measured_;
  }

  const SplatvSettings& settings_;
  Gaussians4D& set_;
  SplatvReport report_;
  std::uint64_t empty_ = 0, never_visible_ = 0, measured_ = 0;
  double squares_ = 0;
};

}  // namespace

bool is_splatv(std::span<const std::uint8_t> head) {
  return head.size() >= 4 && ByteReader(head).u32() == kMagic;
}

Result<Scene> read_splatv(const ByteSource& source, const SplatvSettings& settings,
                          const ReadLimits& limits, SplatvReport* report, ConversionNotes* notes) {
  if (settings.frames == 0) return usage_error("invalid frame count (expected at least 1, got 0)");
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(const Layout layout, read_layout(source, memory));
  STGS_ASSIGN(const Lease lease, memory.take_set(layout.records, 0));
  const std::uint64_t block_bytes =
      kRecordBytes * std::min<std::uint64_t>(kBlockRecords, layout.records);
  STGS_ASSIGN(const Lease block_lease, memory.take(block_bytes, "the records being read"));
  Scene scene;
  scene.metadata.time_base = settings.frame_time;
  scene.metadata.frames = settings.frames;
  scene.metadata.start_camera = layout.camera;
  scene.gaussians.reserve(static_cast<std::size_t>(layout.records));
  Importer importer(settings, scene.gaussians);
  std::vector<std::uint8_t> block;
  for (std::uint64_t done = 0; done < layout.records;) {
    const std::uint64_t count = std::min<std::uint64_t>(kBlockRecords, layout.records - done);
    block.resize(static_cast<std::size_t>(count * kRecordBytes));
    STGS_TRY(source.read(layout.offset + done * kRecordBytes, block));
    for (std::size_t i = 0; i < count; ++i) {
      importer.add(parse_record(std::span(block).subspan(i * kRecordBytes, kRecordBytes)));
    }
    done += count;
  }
  drop_invalid(scene.gaussians, notes);
  importer.finish(layout, report, notes);
  return scene;
}

}  // namespace stgs
