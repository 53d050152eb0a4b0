// SPDX-License-Identifier: Apache-2.0
#include "interchange/import.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

namespace stgs {
namespace {

constexpr float kFlatLogScale = -30.0f;  // of an axis of size 0: 1e-13 scene units

bool all_finite(const FloatArray& array, std::size_t i, std::size_t components) {
  return std::all_of(array.begin() + static_cast<std::ptrdiff_t>(i * components),
                     array.begin() + static_cast<std::ptrdiff_t>((i + 1) * components),
                     [](float v) { return std::isfinite(v); });
}

bool is_renderable(const Gaussians4D& set, std::size_t i) {
  const float* q = set.rotation.data() + 4 * i;
  return all_finite(set.position, i, 3) && all_finite(set.log_scale, i, 3) &&
         all_finite(set.rotation, i, 4) && all_finite(set.opacity_logit, i, 1) &&
         all_finite(set.sh, i, 3 * static_cast<std::size_t>(set.sh_coefficients())) &&
         all_finite(set.velocity, i, 3) && all_finite(set.time, i, 1) &&
         (q[0] != 0.0f || q[1] != 0.0f || q[2] != 0.0f || q[3] != 0.0f);
}

// Copies primitive `from` to `to`, which is not after it.
void move_primitive(Gaussians4D& set, std::size_t from, std::size_t to) {
  if (from == to) return;
  const auto move = [&](FloatArray& array, std::size_t components) {
    const auto at = [&](std::size_t i) {
      return array.begin() + static_cast<std::ptrdiff_t>(i * components);
    };
    std::copy(at(from), at(from + 1), at(to));
  };
  for (FloatArray* array : {&set.opacity_logit, &set.time, &set.sigma, &set.radius}) {
    move(*array, 1);
  }
  for (FloatArray* array : {&set.position, &set.log_scale, &set.velocity}) move(*array, 3);
  move(set.rotation, 4);
  move(set.sh, 3 * static_cast<std::size_t>(set.sh_coefficients()));
}

}  // namespace

void note_kernel(int kernel, const char* format, ConversionNotes* notes) {
  if (kernel != math::kBandLimited) return;
  note(notes, fmt::format("{} cannot state that splats are band-limited: viewers show small ones "
                          "larger and more opaque",
                          format));
}

std::string list_metadata(const SceneMetadata& metadata, const char* camera, bool described) {
  const auto is_set = [](const float(&v)[3]) { return v[0] != 0 || v[1] != 0 || v[2] != 0; };
  std::vector<std::string_view> items;
  if (metadata.start_camera) items.emplace_back(camera);
  if (is_set(metadata.background)) items.emplace_back("the background colour");
  if (described && !metadata.title.empty()) items.emplace_back("the title");
  if (described && metadata.metres_per_unit > 0) items.emplace_back("the metres per unit");
  if (is_set(metadata.up)) items.emplace_back("the up direction and the floor");
  if (!metadata.audio.empty()) items.emplace_back("the audio location");
  return fmt::format("{}", fmt::join(items, ", "));
}

float logit_of_byte(int value) {
  // 1 is exactly the visibility threshold and must not fall below it by rounding.
  const double steps = value <= 0 ? 0.25 : value >= 255 ? 254.75 : value == 1 ? 1.0001 : value;
  const double opacity = steps / 255.0;
  return static_cast<float>(std::log(opacity / (1.0 - opacity)));
}

void drop_invalid(Gaussians4D& set, ConversionNotes* notes) {
  for (float& logit : set.opacity_logit) {
    if (std::isinf(logit)) logit = std::copysign(kOpaqueLogit, logit);
  }
  for (float& log_scale : set.log_scale) {
    if (std::isinf(log_scale) && log_scale < 0.0f) log_scale = kFlatLogScale;
  }
  const std::size_t all = set.size();
  std::size_t valid = 0;
  for (std::size_t i = 0; i < all; ++i) {
    if (is_renderable(set, i)) move_primitive(set, i, valid++);
  }
  if (valid < all) {
    note(notes, fmt::format("dropped {} of {} primitives with values that are not finite or a "
                            "rotation of length 0",
                            all - valid, all));
    set.resize(valid);
  }
}

Status check_export(const Gaussians4D& set) {
  if (set.sh_degree < 0 || set.sh_degree > 3) {
    return usage_error("invalid SH degree (expected 0 to 3, got {})", set.sh_degree);
  }
  const std::size_t n = set.size();
  const std::size_t sh = 3 * n * static_cast<std::size_t>(set.sh_coefficients());
  if (set.position.size() != 3 * n || set.log_scale.size() != 3 * n ||
      set.rotation.size() != 4 * n || set.sh.size() != sh) {
    return usage_error("array lengths do not match (for {} primitives)", n);
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (!is_renderable(set, i)) {
      return usage_error("primitive {} has a value that is not finite or a rotation of length 0",
                         i);
    }
  }
  return {};
}

Scene finish_import(Gaussians4D set, ConversionNotes* notes) {
  drop_invalid(set, notes);
  return static_scene(std::move(set));
}

}  // namespace stgs
