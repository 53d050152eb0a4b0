// SPDX-License-Identifier: Apache-2.0
#include <cstring>

#include "interchange/import.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

std::string header_of(const Gaussians4D& set) {
  std::string header =
      fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", set.size());
  const auto property = [&header](const std::string& name) {
    header += fmt::format("property float {}\n", name);
  };
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) property(name);
  for (int c = 0; c < 3; ++c) property(fmt::format("f_dc_{}", c));
  for (int k = 0; k < 3 * (set.sh_coefficients() - 1); ++k) property(fmt::format("f_rest_{}", k));
  property("opacity");
  for (int c = 0; c < 3; ++c) property(fmt::format("scale_{}", c));
  for (int c = 0; c < 4; ++c) property(fmt::format("rot_{}", c));
  return header + "end_header\n";
}

}  // namespace

Result<std::vector<std::uint8_t>> write_ply(const Gaussians4D& set) {
  STGS_TRY(check_export(set));
  const std::string header = header_of(set);
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  const std::size_t width = 14 + 3 * coefficients;  // floats per vertex, including normals
  std::vector<std::uint8_t> out(header.size() + set.size() * width * sizeof(float));
  std::memcpy(out.data(), header.data(), header.size());
  parallel_blocks(
      std::size_t{0}, set.size(), kPrimitivesPerTask, [&](std::size_t first, std::size_t last) {
        std::vector<float> record(width);
        for (std::size_t i = first; i < last; ++i) {
          auto to = record.begin();
          const float* sh = set.sh.data() + i * 3 * coefficients;
          to = std::copy_n(set.position.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, to);
          to = std::fill_n(to, 3, 0.0f);  // normals; 3DGS writes 0 as well
          to = std::copy_n(sh, 3, to);
          for (std::size_t c = 0; c < 3; ++c) {
            for (std::size_t k = 1; k < coefficients; ++k) *to++ = sh[3 * k + c];
          }
          *to++ = set.opacity_logit[i];
          to = std::copy_n(set.log_scale.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, to);
          std::copy_n(set.rotation.begin() + static_cast<std::ptrdiff_t>(4 * i), 4, to);
          std::memcpy(out.data() + header.size() + i * width * sizeof(float), record.data(),
                      width * sizeof(float));
        }
      });
  return out;
}

}  // namespace stgs
