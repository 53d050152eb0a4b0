// SPDX-License-Identifier: Apache-2.0
// Reads safetensors files: named tensors, a common container of network weights.
//
//   u64 (little-endian)   length of the header
//   header                JSON: {"NAME": {"dtype", "shape", "data_offsets": [begin, end]}, ...}
//   data                  offsets are relative to its start; the tensors fill it without gaps or
//   overlap
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Maximum header size, bytes; those of LPIPS's networks have up to 6,000.
inline constexpr std::uint64_t kMaxSafetensorsHeader = std::uint64_t{1} << 18;

class Safetensors {
 public:
  // Reads and validates the header: every tensor must lie within the file, have the size that its
  // shape requires, and not overlap another. kInvalidFile names the file and the tensor.
  static Result<Safetensors> open(std::unique_ptr<ByteSource> source);

  // Returns whether the file has a tensor of this name.
  bool contains(const std::string& name) const { return tensors_.count(name) != 0; }
  // Reads a tensor of type F32, F16 or BF16 as 32-bit floats. kInvalidFile if it is missing, has
  // another shape or type, or contains a non-finite value.
  Result<std::vector<float>> floats(const std::string& name,
                                    std::span<const std::uint64_t> shape) const;
  // Returns the name of the file for messages.
  const std::string& name() const { return source_->name(); }

 private:
  struct Tensor {
    std::string type;
    std::vector<std::uint64_t> shape;
    std::uint64_t begin = 0, end = 0;  // in the file
  };
  using Tensors = std::map<std::string, Tensor>;

  static Result<Tensors> parse(const std::string& file, const std::string& header,
                               std::uint64_t data_begin, std::uint64_t data_bytes);
  static Status check_layout(const std::string& file, const Tensors& tensors,
                             std::uint64_t data_begin, std::uint64_t data_bytes);

  std::unique_ptr<ByteSource> source_;
  Tensors tensors_;
};

}  // namespace stgs::encoder
