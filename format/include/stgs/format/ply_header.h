// SPDX-License-Identifier: Apache-2.0
// The header of a PLY file, as specified by Stanford's "PLY polygon file format".
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs {

// The scalar type of a property.
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;
  std::uint64_t offset = 0;  // bytes, within a record of its element
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
  std::uint64_t stride = 0;  // bytes per record
  std::uint64_t offset = 0;  // bytes, of its first record in a binary file
  bool has_lists = false;    // then the stride and the offsets of later elements are unknown
  bool offset_known = true;

  // Returns the property of that name, or null.
  const PlyProperty* find(std::string_view property) const;
};

struct PlyHeader {
  bool ascii = false;
  std::uint64_t bytes = 0;  // length of the header
  std::vector<PlyElement> elements;
  std::vector<std::string> comments;  // the text after the keyword

  // Returns the element of that name, or null.
  const PlyElement* find(std::string_view element) const;
};

// Reads and checks the header: known scalar types, valid counts, at most 4096 properties. In a
// binary file every element of known offset must lie within the file.
Result<PlyHeader> read_ply_header(const ByteSource& source);

// Returns a little-endian value of a record as the nearest float.
inline float ply_float(const std::uint8_t* record, const PlyProperty& property) {
  const auto load = [&]<typename T>(T value) {
    std::memcpy(&value, record + property.offset, sizeof(T));
    return static_cast<float>(value);
  };
  switch (property.type) {
    case PlyType::kInt8:
      return load(std::int8_t{});
    case PlyType::kUint8:
      return load(std::uint8_t{});
    case PlyType::kInt16:
      return load(std::int16_t{});
    case PlyType::kUint16:
      return load(std::uint16_t{});
    case PlyType::kInt32:
      return load(std::int32_t{});
    case PlyType::kUint32:
      return load(std::uint32_t{});
    case PlyType::kFloat32:
      return load(float{});
    case PlyType::kFloat64:
      return load(double{});
  }
  return 0.0f;
}

}  // namespace stgs
