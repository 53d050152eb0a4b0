// SPDX-License-Identifier: Apache-2.0
// Binary glTF 2.0 (.glb) with the extension KHR_gaussian_splatting, as ratified by Khronos.
#include <algorithm>
#include <cmath>
#include <cstring>

#include <nlohmann/json.hpp>

#include "core/bytes.h"
#include "interchange/import.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFloat = 5126, kUnsignedByte = 5121, kArrayBuffer = 34962;  // glTF enumerants
constexpr std::uint32_t kGlbMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinChunk = 0x004E4942;
constexpr std::uint64_t kMaxJsonBytes = 64 * 1024;  // far more than the actual size
constexpr const char* kExtension = "KHR_gaussian_splatting";

// The binary chunk, and the JSON that describes it.
class GltfBuffer {
 public:
  explicit GltfBuffer(std::size_t primitives) : primitives_(primitives) {}

  // Adds an attribute of `width` floats per primitive, which value(i, out) sets.
  template <typename Value>
  Json& floats(const std::string& name, std::size_t width, const Value& value) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + primitives_ * width * sizeof(float));
    parallel_blocks(
        std::size_t{0}, primitives_, kPrimitivesPerTask, [&](std::size_t first, std::size_t last) {
          float one[4] = {};
          for (std::size_t i = first; i < last; ++i) {
            value(i, one);
            std::memcpy(bytes_.data() + at + i * width * sizeof(float), one, width * sizeof(float));
          }
        });
    const char* types[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    return add(name, types[width], kFloat, at);
  }

  // Adds an attribute of four bytes per primitive that represent [0, 1].
  template <typename Value>
  void bytes(const std::string& name, const Value& value) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + primitives_ * 4);
    for (std::size_t i = 0; i < primitives_; ++i) {
      float one[4] = {};
      value(i, one);
      for (std::size_t c = 0; c < 4; ++c) {
        bytes_[at + 4 * i + c] =
            static_cast<std::uint8_t>(std::clamp(std::round(255.0f * one[c]), 0.0f, 255.0f));
      }
    }
    add(name, "VEC4", kUnsignedByte, at)["normalized"] = true;
  }

  Json attributes = Json::object(), accessors = Json::array(), views = Json::array();
  const std::vector<std::uint8_t>& data() const { return bytes_; }

 private:
  Json& add(const std::string& name, const char* type, int component, std::size_t at) {
    attributes[name] = accessors.size();
    views.push_back({{"buffer", 0},
                     {"byteOffset", at},
                     {"byteLength", bytes_.size() - at},
                     {"target", kArrayBuffer}});
    accessors.push_back({{"bufferView", views.size() - 1},
                         {"componentType", component},
                         {"count", primitives_},
                         {"type", type}});
    return accessors.back();
  }

  std::size_t primitives_;
  std::vector<std::uint8_t> bytes_;
};

std::string attribute(const std::string& name) {
  return fmt::format("{}:{}", kExtension, name);
}

void add_positions(const Gaussians4D& set, GltfBuffer& buffer) {
  Json& accessor = buffer.floats("POSITION", 3, [&](std::size_t i, float* out) {
    std::copy_n(set.position.data() + 3 * i, 3, out);
  });
  // glTF requires the bounds of positions.
  for (std::size_t c = 0; c < 3; ++c) {
    float low = set.position[c], high = low;
    for (std::size_t i = c; i < set.position.size(); i += 3) {
      low = std::min(low, set.position[i]);
      high = std::max(high, set.position[i]);
    }
    accessor["min"].push_back(low);
    accessor["max"].push_back(high);
  }
}

void add_shape(const Gaussians4D& set, GltfBuffer& buffer) {
  buffer.floats(attribute("ROTATION"), 4, [&](std::size_t i, float* out) {
    const float* q = set.rotation.data() + 4 * i;
    const double length = std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] +
                                    double{q[2]} * q[2] + double{q[3]} * q[3]);
    for (std::size_t c = 0; c < 4; ++c) out[c] = static_cast<float>(q[(c + 1) % 4] / length);
  });
  buffer.floats(attribute("SCALE"), 3, [&](std::size_t i, float* out) {
    for (std::size_t c = 0; c < 3; ++c) out[c] = std::exp(set.log_scale[3 * i + c]);
  });
  buffer.floats(attribute("OPACITY"), 1, [&](std::size_t i, float* out) {
    out[0] = math::opacity_of(set.opacity_logit[i]);
  });
}

void add_colour(const Gaussians4D& set, GltfBuffer& buffer) {
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  std::size_t k = 0;
  for (int degree = 0; degree <= set.sh_degree; ++degree) {
    for (int order = 0; order < 2 * degree + 1; ++order, ++k) {
      buffer.floats(attribute(fmt::format("SH_DEGREE_{}_COEF_{}", degree, order)), 3,
                    [&](std::size_t i, float* out) {
                      std::copy_n(set.sh.data() + 3 * (i * coefficients + k), 3, out);
                    });
    }
  }
  // Fallback for viewers without the extension: points with the degree-0 colour.
  buffer.bytes("COLOR_0", [&](std::size_t i, float* out) {
    for (std::size_t c = 0; c < 3; ++c) {
      out[c] = math::sh_colour(math::kSh00 * set.sh[3 * i * coefficients + c]);
    }
    out[3] = math::opacity_of(set.opacity_logit[i]);
  });
}

std::string document(const GltfBuffer& buffer) {
  Json primitive;
  primitive["attributes"] = buffer.attributes;
  primitive["mode"] = 0;  // points
  primitive["extensions"][kExtension] = {{"kernel", "ellipse"},
                                         {"colorSpace", "srgb_rec709_display"},
                                         {"projection", "perspective"},
                                         {"sortingMethod", "cameraDistance"}};
  Json root;
  root["asset"] = {{"version", "2.0"}, {"generator", "stgs"}};
  root["extensionsUsed"] = Json::array({kExtension});
  root["scene"] = 0;
  root["scenes"] = Json::array({Json{{"nodes", Json::array({0})}}});
  root["nodes"] = Json::array({Json{{"mesh", 0}}});
  root["meshes"] = Json::array({Json{{"primitives", Json::array({primitive})}}});
  root["accessors"] = buffer.accessors;
  root["bufferViews"] = buffer.views;
  root["buffers"] = Json::array({Json{{"byteLength", buffer.data().size()}}});
  std::string text = root.dump();
  text.append((4 - text.size() % 4) % 4, ' ');  // chunks are multiples of 4 bytes
  return text;
}

}  // namespace

Result<std::vector<std::uint8_t>> write_glb(Gaussians4D set) {
  STGS_TRY(check_export(set));
  if (set.size() == 0) return unsupported("glTF cannot represent a set without primitives");
  const std::uint64_t floats = 11 + 3 * static_cast<std::uint64_t>(set.sh_coefficients());
  const std::uint64_t data_bytes = set.size() * sizeof(float) * (floats + 1);  // 1: COLOR_0
  if (data_bytes > 0xFFFFFFFF - kMaxJsonBytes) {
    return unsupported("{} primitives need {} bytes, more than the 4 GiB of a .glb file",
                       set.size(), data_bytes);
  }
  flip_axes(set, -1, -1, 1);
  GltfBuffer buffer(set.size());
  add_positions(set, buffer);
  add_shape(set, buffer);
  add_colour(set, buffer);
  const std::string json = document(buffer);
  const std::vector<std::uint8_t>& data =
      buffer.data();  // a multiple of 4 bytes, as all attributes
  const std::uint64_t total = 12 + 8 + json.size() + 8 + data.size();
  ByteWriter out;
  for (const std::uint32_t word : {kGlbMagic, 2u, static_cast<std::uint32_t>(total),
                                   static_cast<std::uint32_t>(json.size()), kJsonChunk}) {
    out.u32(word);
  }
  out.bytes({reinterpret_cast<const std::uint8_t*>(json.data()), json.size()});
  out.u32(static_cast<std::uint32_t>(data.size()));
  out.u32(kBinChunk);
  out.bytes(data);
  return out.take();
}

}  // namespace stgs
