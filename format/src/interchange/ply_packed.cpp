// SPDX-License-Identifier: Apache-2.0
// The packed PLY of PlayCanvas (developer.playcanvas.com, "compressed PLY format"): chunks of 256
// primitives with their bounds, four 32-bit words per primitive, and a byte per SH coefficient.
#include <algorithm>
#include <array>
#include <cmath>

#include "interchange/ply.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

constexpr std::size_t kChunk = 256;
constexpr std::array<const char*, 18> kBounds = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
constexpr std::size_t kGeometryBounds = 12;
constexpr std::array<const char*, 4> kWords = {"packed_position", "packed_rotation", "packed_scale",
                                               "packed_color"};

struct PackedLayout {
  const PlyElement* chunk = nullptr;
  const PlyElement* vertex = nullptr;
  const PlyElement* sh = nullptr;               // optional
  std::array<const PlyProperty*, 18> bounds{};  // those of the colour are optional
  std::array<const PlyProperty*, 4> words{};
  int sh_degree = 0;
};

Result<PackedLayout> layout_of(const PlyHeader& header, const std::string& file) {
  PackedLayout layout;
  layout.chunk = header.find("chunk");
  layout.vertex = header.find("vertex");
  layout.sh = header.find("sh");
  for (const PlyElement* element : {layout.chunk, layout.vertex, layout.sh}) {
    if (element != nullptr && (element->has_lists || !element->offset_known)) {
      return unsupported("{}: packed PLY with list properties", file);
    }
  }
  for (std::size_t i = 0; i < kBounds.size(); ++i) {
    layout.bounds[i] = layout.chunk->find(kBounds[i]);
    if (layout.bounds[i] == nullptr && i < kGeometryBounds) {
      return invalid_file("{}: chunks lack the property '{}'", file, kBounds[i]);
    }
  }
  for (std::size_t i = 0; i < kWords.size(); ++i) {
    layout.words[i] = layout.vertex->find(kWords[i]);
    if (layout.words[i] == nullptr || layout.words[i]->type != PlyType::kUint32) {
      return invalid_file("{}: vertices lack the property '{}' of type uint", file, kWords[i]);
    }
  }
  if (layout.chunk->count != layout.vertex->count / kChunk + (layout.vertex->count % kChunk != 0)) {
    return invalid_file("{}: wrong number of chunks (got {} for {} vertices, expected one per {})",
                        file, layout.chunk->count, layout.vertex->count, kChunk);
  }
  if (layout.sh == nullptr) return layout;
  const std::size_t columns = layout.sh->properties.size();
  layout.sh_degree = columns % 3 == 0 ? sh_degree_of(columns / 3) : -1;
  if (layout.sh_degree < 0 || layout.sh_degree > 3 || layout.sh->count != layout.vertex->count) {
    return invalid_file("{}: SH records do not match ({} records of {} bytes for {} vertices)",
                        file, layout.sh->count, columns, layout.vertex->count);
  }
  for (std::size_t k = 0; k < columns; ++k) {
    const PlyProperty& property = layout.sh->properties[k];
    if (property.name != fmt::format("f_rest_{}", k) || property.type != PlyType::kUint8) {
      return invalid_file("{}: SH property {} is '{}' (expected 'f_rest_{}' of type uchar)", file,
                          k, property.name, k);
    }
  }
  return layout;
}

// Returns the lowest `bits` of a word as a number in [0, 1].
float unit(std::uint32_t word, int bits) {
  const std::uint32_t mask = (1u << bits) - 1u;
  return static_cast<float>(word & mask) / static_cast<float>(mask);
}
std::array<float, 3> unit_11_10_11(std::uint32_t word) {
  return {unit(word >> 21, 11), unit(word >> 11, 10), unit(word, 11)};
}

// 2 bits give the index of the largest component, which is omitted; 10 bits each for the others.
std::array<float, 4> unpack_rotation(std::uint32_t word) {
  std::array<float, 4> q{};
  const std::size_t largest = word >> 30;
  float sum = 0.0f;
  int shift = 20;
  for (std::size_t c = 0; c < 4; ++c) {
    if (c == largest) continue;
    q[c] = (unit(word >> shift, 10) - 0.5f) * 1.41421356f;
    sum += q[c] * q[c];
    shift -= 10;
  }
  q[largest] = std::sqrt(std::max(0.0f, 1.0f - sum));
  return q;
}

float between(float low, float high, float t) {
  return low * (1.0f - t) + high * t;
}

std::uint32_t word_of(const std::uint8_t* record, const PlyProperty& property) {
  std::uint32_t word = 0;
  std::memcpy(&word, record + property.offset, sizeof(word));
  return word;
}

// Decodes primitives [first, last), those of one chunk, from their records.
void unpack_chunk(const PackedLayout& layout, const std::uint8_t* chunk,
                  const std::uint8_t* vertices, std::size_t first, std::size_t last,
                  Gaussians4D& set) {
  std::array<float, 18> bounds{};
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const PlyProperty* property = layout.bounds[i];
    // The default range of colours is [0, 1].
    bounds[i] = property != nullptr ? ply_float(chunk, *property) : i < 15 ? 0.0f : 1.0f;
  }
  const auto stride = static_cast<std::size_t>(layout.vertex->stride);
  const auto sh = static_cast<std::size_t>(3 * set.sh_coefficients());
  for (std::size_t i = first; i < last; ++i) {
    const std::uint8_t* record = vertices + (i - first) * stride;
    const auto position = unit_11_10_11(word_of(record, *layout.words[0]));
    const auto rotation = unpack_rotation(word_of(record, *layout.words[1]));
    const auto scale = unit_11_10_11(word_of(record, *layout.words[2]));
    const std::uint32_t colour = word_of(record, *layout.words[3]);
    for (std::size_t c = 0; c < 3; ++c) {
      set.position[3 * i + c] = between(bounds[c], bounds[3 + c], position[c]);
      set.log_scale[3 * i + c] = between(bounds[6 + c], bounds[9 + c], scale[c]);
      const float value = unit(colour >> (24 - 8 * c), 8);
      set.sh[i * sh + c] = (between(bounds[12 + c], bounds[15 + c], value) - 0.5f) / math::kSh00;
    }
    for (std::size_t c = 0; c < 4; ++c) set.rotation[4 * i + c] = rotation[c];
    set.opacity_logit[i] = logit_of_byte(static_cast<int>(colour & 0xFF));
  }
}

// A byte represents the middle of an interval of 1/32 in [-4, 4]; 0 and 255 represent the ends.
float unpack_sh(std::uint8_t value) {
  const float t = value == 0     ? 0.0f
                  : value == 255 ? 1.0f
                                 : (static_cast<float>(value) + 0.5f) / 256.0f;
  return 8.0f * (t - 0.5f);
}

Status read_sh(const ByteSource& source, const PackedLayout& layout, ImportMemory& memory,
               Gaussians4D& set) {
  const auto rest = static_cast<std::size_t>(set.sh_coefficients() - 1);
  const auto sh = 3 * (rest + 1);
  const std::size_t block_size = kChunk * kChunk;
  const std::size_t block_bytes = std::min(block_size, set.size()) * 3 * rest;
  STGS_ASSIGN(const Lease lease, memory.take(block_bytes, "the SH being read"));
  std::vector<std::uint8_t> bytes(block_bytes);
  for (std::size_t begin = 0; begin < set.size(); begin += block_size) {
    const std::size_t count = std::min(block_size, set.size() - begin);
    STGS_TRY(source.read(layout.sh->offset + begin * 3 * rest, {bytes.data(), count * 3 * rest}));
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < rest; ++k) {
        for (std::size_t c = 0; c < 3; ++c) {
          set.sh[(begin + i) * sh + 3 * (k + 1) + c] = unpack_sh(bytes[(3 * i + c) * rest + k]);
        }
      }
    }
  }
  return {};
}

}  // namespace

bool is_packed_ply(const PlyHeader& header) {
  const PlyElement* vertex = header.find("vertex");
  return !header.ascii && header.find("chunk") != nullptr && vertex != nullptr &&
         vertex->find("packed_position") != nullptr;
}

Result<Charged<Gaussians4D>> read_packed_ply(const ByteSource& source, const PlyHeader& header,
                                             ImportMemory& memory) {
  STGS_ASSIGN(const PackedLayout layout, layout_of(header, source.name()));
  Charged<Gaussians4D> out;
  Gaussians4D& set = out.value;
  set.sh_degree = layout.sh_degree;
  STGS_ASSIGN(out.lease, memory.take_set(layout.vertex->count, layout.sh_degree));
  STGS_ASSIGN(const Lease records, memory.take(layout.chunk->count * layout.chunk->stride +
                                                   layout.vertex->count * layout.vertex->stride,
                                               "the packed vertices"));
  set.resize(static_cast<std::size_t>(layout.vertex->count));
  std::vector<std::uint8_t> chunks(layout.chunk->count * layout.chunk->stride);
  std::vector<std::uint8_t> vertices(layout.vertex->count * layout.vertex->stride);
  STGS_TRY(source.read(layout.chunk->offset, chunks));
  STGS_TRY(source.read(layout.vertex->offset, vertices));
  parallel_for(std::size_t{0}, static_cast<std::size_t>(layout.chunk->count), [&](std::size_t c) {
    const std::size_t first = c * kChunk;
    unpack_chunk(layout, chunks.data() + c * layout.chunk->stride,
                 vertices.data() + first * layout.vertex->stride, first,
                 std::min(set.size(), first + kChunk), set);
  });
  if (layout.sh != nullptr && layout.sh_degree > 0) {
    STGS_TRY(read_sh(source, layout, memory, set));
  }
  return out;
}

}  // namespace stgs
