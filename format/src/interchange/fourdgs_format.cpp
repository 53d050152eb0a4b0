// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_format.h"

#include <algorithm>

namespace stgs::fourdgs {
namespace {

bool all_finite(std::initializer_list<double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

}  // namespace

std::uint64_t Population::bytes() const {
  std::uint64_t words = ids.size() + objects.size();
  for (const auto& values : bins) words += values.size();
  return sizeof(std::uint32_t) * words + sh.size();
}

double Grid::motion_step(std::int64_t sigma_bin, bool never_fades, double window_length) const {
  double half =
      never_fades ? window_length : reach() * std::exp(static_cast<double>(sigma_bin) * log_sigma);
  half = half > 0.02 ? std::min(half, 2.0) : 0.02;
  return motion * std::exp2(-std::clamp(std::ceil(std::log2(half / 0.5)), -4.0, 2.0));
}

double Grid::time_step(std::int64_t sigma_bin, bool never_fades) const {
  if (never_fades) return time;
  const double target = std::min(time, 0.05 * std::exp(static_cast<double>(sigma_bin) * log_sigma));
  return time * std::exp2(std::clamp(std::floor(std::log2(target / time)), -10.0, 0.0));
}

Gaussian dequantise(const Population& set, std::size_t i, const Grid& grid, const Window& window) {
  const auto bin = [&set](Attribute a, std::size_t at) {
    return static_cast<double>(set.bins[a][at]);
  };
  const bool never_fades = (set.bins[kFlags][i] & kNeverFades) != 0;
  const std::int32_t sigma = set.bins[kSigma][i];
  const double motion = grid.motion_step(sigma, never_fades, window.end - window.begin);
  Gaussian g{};
  for (std::size_t c = 0; c < 3; ++c) {
    g.position[c] = grid.origin[c] + bin(kPosition, 3 * i + c) * grid.position;
    g.log_scale[c] = bin(kScale, 3 * i + c) * grid.log_scale;
    g.motion[c] = bin(kMotion, 3 * i + c) * motion;
  }
  // Stored as g, r - g, b - g.
  const double green = bin(kColour, 3 * i);
  const std::array<double, 3> rgb = {bin(kColour, 3 * i + 1) + green, green,
                                     bin(kColour, 3 * i + 2) + green};
  for (std::size_t c = 0; c < 3; ++c) g.rgb[c] = std::clamp(rgb[c] * grid.colour, 0.0, 1.0);
  g.opacity = std::clamp(bin(kOpacity, i) * grid.opacity, 0.0, 1.0);
  g.centre = bin(kTime, i) * grid.time_step(sigma, never_fades);
  g.deviation = never_fades ? std::numeric_limits<double>::infinity()
                            : std::exp(static_cast<double>(sigma) * grid.log_sigma);
  // The components x y z w, of which the largest one is omitted.
  const auto largest = static_cast<std::size_t>(set.bins[kRotationIndex][i]);
  std::array<double, 4> q{};
  double squares = 0;
  for (std::size_t c = 0, k = 0; c < 4; ++c) {
    if (c == largest) continue;
    q[c] = std::clamp(bin(kRotation, 3 * i + k++) * grid.rotation, -1.0, 1.0);
    squares += q[c] * q[c];
  }
  q[largest] = std::sqrt(std::max(0.0, 1 - squares));
  g.rotation = {q[3], q[0], q[1], q[2]};
  return g;
}

double visibility(const Gaussian& g, double seconds, double cutoff) {
  if (std::isinf(g.deviation)) return 1;
  const double x = (seconds - g.centre) / std::max(g.deviation, 1e-30);
  const double l = std::exp(-0.5 * x * x);
  return l >= cutoff ? l : 0;
}

bool is_never_visible(const Gaussian& g, const Window& window, double duration, double cutoff) {
  const double begin = std::max(0.0, window.begin), end = std::min(duration, window.end);
  if (!(window.begin < window.end && begin < end) || g.opacity <= 0) return true;
  return visibility(g, std::clamp(g.centre, begin, end), cutoff) == 0;
}

std::string short_text(const std::string& text) {
  std::string out = text.substr(0, 40);
  std::replace_if(
      out.begin(), out.end(), [](char c) { return c < ' ' || c > '~'; }, '.');
  return "\"" + out + "\"";
}

std::map<std::string, std::string> read_map(ByteReader& in, bool& ok) {
  std::map<std::string, std::string> out;
  ByteReader block(in.bytes(in.u32()));
  while (block.ok() && block.left() > 0) {
    std::string key = block.string();
    out.insert_or_assign(std::move(key), block.string());
  }
  ok = in.ok() && block.ok();
  return out;
}

void write_map(ByteWriter& out, const std::map<std::string, std::string>& map) {
  ByteWriter block;
  for (const auto& [key, value] : map) {
    block.string(key);
    block.string(value);
  }
  out.u32(static_cast<std::uint32_t>(block.size()));
  out.bytes(block.view());
}

void write_record(ByteWriter& out, std::uint8_t opcode, View content) {
  out.u8(opcode);
  out.u64(content.size());
  out.bytes(content);
}

Result<Header> parse_header(View content, const Place& place) {
  ByteReader in(content);
  Header h;
  h.profile = in.string();
  h.library = in.string();
  h.duration = in.f64();
  h.gaussians = in.u64();
  h.cutoff = in.f64();
  h.model = in.string();
  for (double& v : h.bounds) v = in.f64();
  h.sh_degree = in.u8();
  h.flags = in.u8();
  bool ok = false;
  h.attributes = read_map(in, ok);
  if (!ok) return invalid_file("{}: invalid header{}", place.file, place.text());
  if (h.model != kBirth && h.model != kKeyframes) {
    return unsupported("{}: unsupported temporal model (expected {} or {}, got {}){}", place.file,
                       kBirth, kKeyframes, short_text(h.model), place.text());
  }
  if (!(h.cutoff > 0 && h.cutoff <= 1)) {
    return invalid_file("{}: invalid cut-off (expected above 0, to 1, got {}){}", place.file,
                        h.cutoff, place.text());
  }
  if (h.sh_degree > 3) {
    return invalid_file("{}: invalid SH degree (expected 0 to 3, got {}){}", place.file,
                        h.sh_degree, place.text());
  }
  if (!(h.duration >= 0)) {
    return invalid_file("{}: invalid duration ({} s){}", place.file, h.duration, place.text());
  }
  return h;
}

Result<Grid> parse_quantization(View content, const Place& place) {
  ByteReader in(content);
  const std::string scheme = in.string();
  Grid g;
  for (double& v : g.origin) v = in.f64();
  for (double* step : {&g.position, &g.log_scale, &g.rotation, &g.colour, &g.opacity, &g.motion,
                       &g.time, &g.log_sigma}) {
    *step = in.f64();
  }
  in.u8();  // step_sh: used by the encoder only
  bool ok = false;
  read_map(in, ok);
  if (!ok) return invalid_file("{}: invalid quantisation record{}", place.file, place.text());
  if (scheme != kScheme) {
    return unsupported("{}: unsupported quantisation (expected {}, got {}){}", place.file, kScheme,
                       short_text(scheme), place.text());
  }
  if (!all_finite({g.origin[0], g.origin[1], g.origin[2], g.position, g.log_scale, g.rotation,
                   g.colour, g.opacity, g.motion, g.time, g.log_sigma})) {
    return invalid_file("{}: a quantisation step is not finite{}", place.file, place.text());
  }
  return g;
}

Result<std::vector<Window>> parse_windows(View content, const Place& place) {
  ByteReader in(content);
  const std::uint32_t count = in.u32();
  if (!in.ok() || count > in.left() / 16) {
    return invalid_file("{}: invalid window table ({} windows in {} bytes){}", place.file, count,
                        content.size(), place.text());
  }
  std::vector<Window> out(count);
  for (Window& window : out) {
    window.begin = in.f64();
    window.end = in.f64();
  }
  return out;
}

}  // namespace stgs::fourdgs
