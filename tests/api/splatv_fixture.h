// SPDX-License-Identifier: Apache-2.0
// Writes small .splatv files.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace stgs::testing {

// An unpacked record; time runs from 0 to 1.
struct SplatvRecord {
  std::array<float, 3> position{};
  std::array<float, 4> rotation{1, 0, 0, 0};
  std::array<float, 3> scale{0.25f, 0.125f, 0.0625f};
  std::array<std::uint8_t, 4> rgba{255, 128, 0, 204};
  std::array<float, 9> motion{};           // position: coefficients of dt, dt^2, dt^3
  std::array<float, 4> rotation_motion{};  // rotation: coefficients of dt
  float centre = 0.5f, width = 0.25f;
};

// Exact for values that binary16 represents.
inline std::uint32_t half_bits(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  const std::uint32_t sign = bits >> 16 & 0x8000;
  const int exponent = static_cast<int>(bits >> 23 & 255) - 127 + 15;
  if (value == 0.0f) return sign;
  if (std::isnan(value)) return sign | 0x7E00;
  if (exponent >= 31) return sign | 0x7C00;
  if (exponent <= 0) return sign | static_cast<std::uint32_t>(std::ldexp(std::abs(value), 24));
  return sign | static_cast<std::uint32_t>(exponent) << 10 | (bits >> 13 & 1023);
}

inline void put_u32(std::string& out, std::uint32_t v) {
  for (int i = 0; i < 4; ++i) out.push_back(static_cast<char>(v >> (8 * i)));
}

inline std::string pack_record(const SplatvRecord& r) {
  std::string out;
  const auto halves = [&out](float a, float b) { put_u32(out, half_bits(a) | half_bits(b) << 16); };
  for (float v : r.position) put_u32(out, std::bit_cast<std::uint32_t>(v));
  halves(r.rotation[0], r.rotation[1]);
  halves(r.rotation[2], r.rotation[3]);
  halves(r.scale[0], r.scale[1]);
  halves(r.scale[2], 0);
  for (std::uint8_t v : r.rgba) out.push_back(static_cast<char>(v));
  for (std::size_t i = 0; i < 8; i += 2) halves(r.motion[i], r.motion[i + 1]);
  halves(r.motion[8], 0);
  halves(r.rotation_motion[0], r.rotation_motion[1]);
  halves(r.rotation_motion[2], r.rotation_motion[3]);
  halves(r.centre, r.width);
  return out;
}

inline nlohmann::json splatv_chunks(std::size_t records) {
  return nlohmann::json::array({{{"type", "splat"},
                                 {"size", records * 64},
                                 {"texwidth", 4},
                                 {"texheight", records},
                                 {"cameras",
                                  {{{"width", 640},
                                    {"height", 480},
                                    {"fx", 500},
                                    {"fy", 510},
                                    {"position", {1, 2, 3}},
                                    {"rotation", {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}}}}}}});
}

inline std::string splatv_file(const std::vector<SplatvRecord>& records,
                               const std::string& json_text) {
  std::string out;
  put_u32(out, 0x674B);
  put_u32(out, static_cast<std::uint32_t>(json_text.size()));
  out += json_text;
  for (const SplatvRecord& r : records) out += pack_record(r);
  return out;
}
inline std::string splatv_file(const std::vector<SplatvRecord>& records) {
  return splatv_file(records, splatv_chunks(records.size()).dump());
}

}  // namespace stgs::testing
