// SPDX-License-Identifier: Apache-2.0
// Writing USD as text (.usda) with prims of the schema ParticleField3DGaussianSplat of OpenUSD
// 26.03. Static primitives are one prim without time samples. The others are grouped by the frames
// in which they are visible, so that each prim has samples for these frames only. USD interpolates
// samples linearly: two samples describe linear motion.
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <string_view>

#include "interchange/import.h"
#include "interchange/usda_groups.h"

namespace stgs {
namespace {

constexpr double kOpacitySteps = 1e4;  // per unit, of time samples
constexpr double kExtentDeviations = 3;

// Returns the part of each primitive; null for those of a scene without parts.
std::vector<const ScenePart*> parts_of(const Scene& scene) {
  std::vector<const ScenePart*> out;
  for (const ScenePart& part : scene.parts) {
    out.insert(out.end(), static_cast<std::size_t>(part.primitives), &part);
  }
  out.resize(scene.gaussians.size(), nullptr);
  return out;
}

class UsdaWriter {
 public:
  UsdaWriter(const Scene& scene, const Gaussians4D& set, const UsdaGrouper& grouper)
      : scene_(scene), set_(set), grouper_(grouper), parts_(parts_of(scene)) {}

  // `max_bytes`: of the text.
  std::vector<std::uint8_t> write(const UsdaGroups& groups, std::uint64_t max_bytes,
                                  UsdaStatistics& statistics) {
    out_.reserve(static_cast<std::size_t>(max_bytes));  // growth would need three times the text
    header();
    for (const auto& [key, primitives] : groups) group(key, primitives, statistics);
    print("}}\n");
    return std::move(out_);
  }

 private:
  template <typename... Args>
  void print(fmt::format_string<Args...> text, Args&&... args) {
    fmt::format_to(std::back_inserter(out_), text, std::forward<Args>(args)...);
  }

  void header() {
    const SceneMetadata& m = scene_.metadata;
    print("#usda 1.0\n(\n    defaultPrim = \"Scene\"\n");
    if (!m.title.empty()) print("    doc = \"{}\"\n", escaped(m.title));
    if (m.frames > 1) {
      const double rate = 1.0 * m.time_base.denominator / m.time_base.numerator;
      print("    startTimeCode = 0\n    endTimeCode = {}\n", m.frames - 1);
      print("    timeCodesPerSecond = {}\n    framesPerSecond = {}\n", rate, rate);
    }
    print("    metersPerUnit = {}\n    upAxis = \"Y\"\n)\n\ndef Xform \"Scene\"\n{{\n",
          m.metres_per_unit > 0 ? m.metres_per_unit : 1.0f);
  }

  // Returns a text for a quoted string of one line.
  static std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : text) {
      if (c == '"' || c == '\\') out += '\\';
      out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
    return out;
  }

  void group(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives,
             UsdaStatistics& statistics) {
    const char* names[] = {"static", "moving", "fading"};
    print("    def ParticleField3DGaussianSplat \"{}", names[key.kind]);
    if (key.kind == UsdaGroup::kFades) print("_{}_{}", key.first, key.last);
    print(
        "\"\n    {{\n        uniform token projectionModeHint = \"perspective\"\n"
        "        uniform token sortingModeHint = \"zDepth\"\n");
    const std::uint32_t last_frame = scene_.metadata.frames - 1;
    if (key.first > 0 || key.last < last_frame) {
      print("        token visibility.timeSamples = {{ ");
      if (key.first > 0) print("0: \"invisible\", ");
      print("{}: \"inherited\", ", key.first);
      if (key.last < last_frame) print("{}: \"invisible\", ", key.last + 1);
      print("}}\n");
    }
    extent(key, primitives);
    positions(key, primitives);
    shape(primitives);
    opacities(key, primitives, statistics);
    sh(primitives);
    print("    }}\n");
  }

  // Prints the values of an array; value(i, c) returns component c of primitive i.
  template <typename Value>
  void values(const std::vector<std::uint32_t>& primitives, std::size_t width, const Value& value) {
    const char* separator = "[";
    for (const std::uint32_t i : primitives) {
      print("{}", separator);
      if (width > 1) print("(");
      for (std::size_t c = 0; c < width; ++c) print("{}{}", c > 0 ? ", " : "", value(i, c));
      if (width > 1) print(")");
      separator = ", ";
    }
    print("]");
  }

  float position_at(std::size_t i, std::size_t c, double ticks) const {
    const double begin = parts_[i] == nullptr ? 0 : parts_[i]->begin_ticks;
    return static_cast<float>(set_.position[3 * i + c] +
                              double{set_.velocity[3 * i + c]} * (ticks - begin - set_.time[i]));
  }
  bool any_moves(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives) const {
    return key.kind != UsdaGroup::kStatic && key.first < key.last &&
           std::any_of(primitives.begin(), primitives.end(), [this](std::uint32_t i) {
             const float* u = set_.velocity.data() + 3 * std::size_t{i};
             return u[0] != 0 || u[1] != 0 || u[2] != 0;
           });
  }

  void extent(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives) {
    std::array<float, 3> low, high;
    low.fill(INFINITY);
    high.fill(-INFINITY);
    for (const std::uint32_t i : primitives) {
      const float* log_scale = set_.log_scale.data() + 3 * std::size_t{i};
      const auto radius = static_cast<float>(
          kExtentDeviations * std::exp(double{*std::max_element(log_scale, log_scale + 3)}));
      for (std::size_t c = 0; c < 3; ++c) {
        for (const std::uint32_t frame : {key.first, key.last}) {
          low[c] = std::min(low[c], position_at(i, c, frame) - radius);
          high[c] = std::max(high[c], position_at(i, c, frame) + radius);
        }
      }
    }
    print("        float3[] extent = [({}, {}, {}), ({}, {}, {})]\n", low[0], low[1], low[2],
          high[0], high[1], high[2]);
  }

  void positions(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives) {
    const auto at = [&](double ticks) {
      values(primitives, 3, [&](std::size_t i, std::size_t c) { return position_at(i, c, ticks); });
    };
    if (!any_moves(key, primitives)) {
      print("        point3f[] positions = ");
      at(0.5 * key.first + 0.5 * key.last);
      print("\n");
      return;
    }
    print("        point3f[] positions.timeSamples = {{\n            {}: ", key.first);
    at(key.first);
    print(",\n            {}: ", key.last);
    at(key.last);
    print(",\n        }}\n");
  }

  void shape(const std::vector<std::uint32_t>& primitives) {
    print("        quatf[] orientations = ");
    values(primitives, 4, [this](std::size_t i, std::size_t c) {
      const float* q = set_.rotation.data() + 4 * i;
      const double length = std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] +
                                      double{q[2]} * q[2] + double{q[3]} * q[3]);
      return static_cast<float>(q[c] / length);
    });
    print("\n        float3[] scales = ");
    values(primitives, 3, [this](std::size_t i, std::size_t c) {
      return static_cast<float>(std::exp(double{set_.log_scale[3 * i + c]}));
    });
    print("\n");
  }

  void opacities(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives,
                 UsdaStatistics& statistics) {
    if (key.kind != UsdaGroup::kFades) {
      print("        float[] opacities = ");
      values(primitives, 1,
             [this](std::size_t i, std::size_t) { return grouper_.constant_opacity(i); });
      print("\n");
      return;
    }
    print("        float[] opacities.timeSamples = {{\n");
    for (std::uint64_t frame = key.first; frame <= key.last; ++frame) {
      print("            {}: ", frame);
      values(primitives, 1, [&](std::size_t i, std::size_t) {
        const double opacity = grouper_.opacity_at(i, parts_[i], static_cast<double>(frame));
        return std::round(opacity * kOpacitySteps) / kOpacitySteps;
      });
      print(",\n");
    }
    print("        }}\n");
    measure_interpolation(key, primitives, statistics);
  }

  void measure_interpolation(const UsdaGroup& key, const std::vector<std::uint32_t>& primitives,
                             UsdaStatistics& statistics) const {
    for (const std::uint32_t i : primitives) {
      double before = grouper_.opacity_at(i, parts_[i], key.first);
      for (double frame = key.first; frame < key.last; ++frame) {
        const double after = grouper_.opacity_at(i, parts_[i], frame + 1);
        const double middle = grouper_.opacity_at(i, parts_[i], frame + 0.5);
        statistics.interpolation_max =
            std::max(statistics.interpolation_max, std::abs((before + after) / 2 - middle));
        before = after;
      }
    }
  }

  void sh(const std::vector<std::uint32_t>& primitives) {
    const auto coefficients = static_cast<std::size_t>(set_.sh_coefficients());
    print("        uniform int radiance:sphericalHarmonicsDegree = {}\n", set_.sh_degree);
    print("        float3[] radiance:sphericalHarmonicsCoefficients = [");
    const char* separator = "";
    for (const std::uint32_t i : primitives) {
      const float* sh = set_.sh.data() + 3 * coefficients * i;
      for (std::size_t k = 0; k < coefficients; ++k) {
        print("{}({}, {}, {})", separator, sh[3 * k], sh[3 * k + 1], sh[3 * k + 2]);
        separator = ", ";
      }
    }
    print("]\n");
  }

  const Scene& scene_;
  const Gaussians4D& set_;
  const UsdaGrouper& grouper_;
  std::vector<const ScenePart*> parts_;
  std::vector<std::uint8_t> out_;
};

// Returns the greatest size of the text, bytes; about 1.5 times that of most scenes.
std::uint64_t greatest_bytes(const Scene& scene, const UsdaGroups& groups) {
  constexpr std::uint64_t kFloat = 18, kSample = 8;  // with separators and parentheses
  constexpr std::uint64_t kHeader = 1024, kFrame = 32;
  const auto coefficients = static_cast<std::uint64_t>(scene.gaussians.sh_coefficients());
  std::uint64_t bytes = kHeader + 2 * scene.metadata.title.size();
  for (const auto& [key, primitives] : groups) {
    const std::uint64_t samples =
        key.kind == UsdaGroup::kFades ? std::uint64_t{key.last} - key.first + 1 : 0;
    bytes += kHeader + kFrame * samples;
    bytes += (kFloat * (14 + 3 * coefficients) + kSample * samples) * primitives.size();
  }
  return bytes;
}

void note_losses(const Scene& scene, const UsdaStatistics& statistics, ConversionNotes* notes) {
  const SceneMetadata& m = scene.metadata;
  if (statistics.static_opacity_max > 0 || statistics.static_position_max > 0) {
    note(notes, fmt::format("primitives that hardly change have no samples: error of the opacity "
                            "{:.3g}, of the position {:.3g} scene units at most",
                            statistics.static_opacity_max, statistics.static_position_max));
  }
  if (statistics.interpolation_max > 0) {
    note(notes, fmt::format("opacities are linear between frames, in steps of {}: error half-way "
                            "between frames {:.3g} at most",
                            1 / kOpacitySteps, statistics.interpolation_max));
  }
  if (statistics.between_frames > 0) {
    note(notes, fmt::format("dropped {} of {} primitives that are visible only between frames",
                            statistics.between_frames, scene.gaussians.size()));
  }
  note_kernel(m.kernel, "USD", notes);
  const std::string lost = list_metadata(m, "the start camera", false);
  if (!lost.empty()) note(notes, fmt::format("does not contain {}", lost));
}

}  // namespace

Result<std::vector<std::uint8_t>> write_usda(const Scene& scene, ConversionNotes* notes,
                                             std::uint64_t max_memory) {
  STGS_TRY(check_export(scene.gaussians));
  if (scene.metadata.frames == 0) return usage_error("invalid frame count 0");
  std::uint64_t in_parts = 0;
  for (const ScenePart& part : scene.parts) in_parts += part.primitives;
  if (!scene.parts.empty() && in_parts != scene.gaussians.size()) {
    return usage_error("the parts have {} of {} primitives", in_parts, scene.gaussians.size());
  }
  Gaussians4D set = scene.gaussians;
  flip_axes(set, 1, -1, -1);
  const UsdaGrouper grouper(scene, set);
  UsdaStatistics statistics;
  const UsdaGroups groups = grouper.groups(statistics);
  const std::uint64_t bytes = greatest_bytes(scene, groups);
  if (bytes > max_memory) {
    return unsupported(
        "the text needs up to {} bytes (limit {}); allow more memory, convert a single time, or "
        "fewer primitives",
        bytes, max_memory);
  }
  UsdaWriter writer(scene, set, grouper);
  std::vector<std::uint8_t> out = writer.write(groups, bytes, statistics);
  note_losses(scene, statistics, notes);
  return out;
}

}  // namespace stgs
