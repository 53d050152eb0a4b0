// SPDX-License-Identifier: Apache-2.0
// Reads safetensors files: named arrays of numbers, as PyTorch's users keep weights in.
//
//   u64 (little-endian)   length of the header
//   header                JSON: {"NAME": {"dtype", "shape", "data_offsets": [begin, end]}, ...}
//   data                  offsets count from here; the arrays fill it without gaps or overlaps
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

// Bytes of a header, at most; VGG16's has 3,000.
inline constexpr std::uint64_t kMaxSafetensorsHeader = std::uint64_t{1} << 23;

class Safetensors {
 public:
  // Reads and checks the header: every array lies within the file, has the bytes that its shape
  // needs and shares none with another. kInvalidFile, with the file and the array, where not.
  static Result<Safetensors> open(std::unique_ptr<ByteSource> source);

  bool contains(const std::string& name) const { return tensors_.count(name) != 0; }
  // The array as 32-bit floats, from F32, F16 or BF16. kInvalidFile where it is missing, has
  // another shape or type, or holds a value that is not finite.
  Result<std::vector<float>> floats(const std::string& name,
                                    std::span<const std::uint64_t> shape) const;
  // What messages call the file.
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
