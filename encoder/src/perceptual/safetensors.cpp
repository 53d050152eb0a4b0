// SPDX-License-Identifier: Apache-2.0
#include "perceptual/safetensors.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "stgs/format/json_text.h"

namespace stgs::encoder {
namespace {

constexpr std::uint64_t kLengthBytes = 8;

// Returns the size of a value, bytes; nullopt for an unknown type, whose tensors cannot be read.
std::optional<std::uint64_t> value_bytes(const std::string& type) {
  static constexpr struct {
    const char* name;
    std::uint64_t bytes;
  } kTypes[] = {{"BOOL", 1}, {"U8", 1},  {"I8", 1},  {"F8_E4M3", 1}, {"F8_E5M2", 1},
                {"I16", 2},  {"U16", 2}, {"F16", 2}, {"BF16", 2},    {"I32", 4},
                {"U32", 4},  {"F32", 4}, {"I64", 8}, {"U64", 8},     {"F64", 8}};
  for (const auto& known : kTypes) {
    if (type == known.name) return known.bytes;
  }
  return std::nullopt;
}

// Returns the product of the shape and the value size; nullopt if it overflows 64 bits.
std::optional<std::uint64_t> array_bytes(const std::vector<std::uint64_t>& shape,
                                         std::uint64_t bytes) {
  // A tensor with a dimension of 0 is empty, even if the product of the others would overflow.
  if (std::find(shape.begin(), shape.end(), 0u) != shape.end()) return 0;
  for (const std::uint64_t n : shape) {
    if (bytes > ~std::uint64_t{0} / n) return std::nullopt;
    bytes *= n;
  }
  return bytes;
}

std::string shape_text(std::span<const std::uint64_t> shape) {
  return fmt::format("[{}]", fmt::join(shape.begin(), shape.end(), ", "));
}

float from_half(std::uint16_t bits) {
  const float sign = (bits & 0x8000u) != 0 ? -1.0f : 1.0f;
  const int exponent = (bits >> 10) & 31;
  const auto mantissa = static_cast<float>(bits & 1023u);
  if (exponent == 31) return mantissa == 0 ? sign * INFINITY : NAN;
  if (exponent == 0) return sign * std::ldexp(mantissa, -24);
  return sign * std::ldexp(1024.0f + mantissa, exponent - 25);
}

std::uint32_t little_endian(const std::uint8_t* p, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= std::uint32_t{p[i]} << (8 * i);
  return value;
}

std::vector<float> values_of(const std::string& type, const std::vector<std::uint8_t>& data) {
  const std::size_t bytes = type == "F32" ? 4 : 2;
  std::vector<float> values(data.size() / bytes);
  const auto fill = [&](auto convert) {
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = convert(data.data() + bytes * i);
  };
  using Bytes = const std::uint8_t*;
  if (type == "F16") {
    fill([](Bytes p) { return from_half(static_cast<std::uint16_t>(little_endian(p, 2))); });
  } else if (type == "BF16") {
    fill([](Bytes p) { return std::bit_cast<float>(little_endian(p, 2) << 16); });
  } else {
    fill([](Bytes p) { return std::bit_cast<float>(little_endian(p, 4)); });
  }
  return values;
}

}  // namespace

Result<Safetensors> Safetensors::open(std::unique_ptr<ByteSource> source) {
  const std::string file = source->name();
  const std::uint64_t size = source->size();
  std::uint8_t length_bytes[kLengthBytes];
  if (size < kLengthBytes)
    return invalid_file("{}: not a safetensors file (shorter than 8 bytes)", file);
  STGS_TRY(source->read(0, length_bytes));
  const std::uint64_t length = std::uint64_t{little_endian(length_bytes + 4, 4)} << 32 |
                               std::uint64_t{little_endian(length_bytes, 4)};
  if (length > size - kLengthBytes) {
    return invalid_file(
        "{}: not a safetensors file, or truncated (header of {} bytes, {} available)", file, length,
        size - kLengthBytes);
  }
  if (length > kMaxSafetensorsHeader) {
    return invalid_file("{}: header too large ({} bytes, at most {} supported)", file, length,
                        kMaxSafetensorsHeader);
  }
  std::vector<std::uint8_t> header(length);
  STGS_TRY(source->read(kLengthBytes, header));
  const std::uint64_t begin = kLengthBytes + length;
  Safetensors tensors;
  STGS_ASSIGN(tensors.tensors_,
              parse(file, std::string(header.begin(), header.end()), begin, size - begin));
  STGS_TRY(check_layout(file, tensors.tensors_, begin, size - begin));
  tensors.source_ = std::move(source);
  return tensors;
}

Result<Safetensors::Tensors> Safetensors::parse(const std::string& file, const std::string& header,
                                                std::uint64_t data_begin,
                                                std::uint64_t data_bytes) {
  std::set<std::string> names;
  std::string repeated;
  const auto note_names = [&](int depth, nlohmann::json::parse_event_t event,
                              nlohmann::json& value) {
    if (event == nlohmann::json::parse_event_t::key && depth == 1 &&
        !names.insert(value.get<std::string>()).second) {
      repeated = value.get<std::string>();
    }
    return true;
  };
  STGS_TRY(check_json_nesting(header, file + ": the header"));
  const nlohmann::json json = nlohmann::json::parse(header, note_names, false);
  if (!json.is_object()) return invalid_file("{}: the header is not a JSON object", file);
  if (!repeated.empty()) return invalid_file("{}: tensor '{}' occurs twice", file, repeated);
  Tensors tensors;
  for (const auto& [name, entry] : json.items()) {
    if (name == "__metadata__") continue;
    Tensor tensor;
    const auto invalid = [&, &tensor_name = name](const char* reason) {
      return invalid_file("{}: tensor '{}': {}", file, tensor_name, reason);
    };
    if (!entry.is_object()) return invalid("its description is not a JSON object");
    const auto type = entry.find("dtype"), shape = entry.find("shape"),
               offsets = entry.find("data_offsets");
    if (type == entry.end() || !type->is_string())
      return invalid("dtype is missing or not a string");
    if (shape == entry.end() || !shape->is_array())
      return invalid("shape is missing or not an array");
    if (offsets == entry.end() || !offsets->is_array() || offsets->size() != 2)
      return invalid("data_offsets is missing or not an array of 2");
    tensor.type = type->get<std::string>();
    for (const nlohmann::json& n : *shape) {
      if (!n.is_number_unsigned())
        return invalid("its shape has an entry that is not an integer >= 0");
      tensor.shape.push_back(n.get<std::uint64_t>());
    }
    for (const nlohmann::json& n : *offsets) {
      if (!n.is_number_unsigned()) return invalid("its data_offsets are not integers >= 0");
    }
    const auto begin = (*offsets)[0].get<std::uint64_t>(), end = (*offsets)[1].get<std::uint64_t>();
    if (begin > end) return invalid("its data ends before it begins");
    if (end > data_bytes) {
      return invalid_file("{}: tensor '{}': its data ends at byte {} of {}; the file is truncated",
                          file, name, end, data_bytes);
    }
    if (const auto bytes = value_bytes(tensor.type);
        bytes && array_bytes(tensor.shape, *bytes) != end - begin) {
      return invalid_file("{}: tensor '{}': {} bytes do not match shape {} of type {}", file, name,
                          end - begin, shape_text(tensor.shape), tensor.type);
    }
    tensor.begin = data_begin + begin;
    tensor.end = data_begin + end;
    tensors.emplace(name, std::move(tensor));
  }
  return tensors;
}

Status Safetensors::check_layout(const std::string& file, const Tensors& tensors,
                                 std::uint64_t data_begin, std::uint64_t data_bytes) {
  std::vector<Tensors::const_iterator> order;
  for (auto it = tensors.begin(); it != tensors.end(); ++it) order.push_back(it);
  std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
    return std::pair(a->second.begin, a->second.end) < std::pair(b->second.begin, b->second.end);
  });
  std::uint64_t end = data_begin;
  for (const auto& it : order) {
    if (it->second.begin != end) {
      return invalid_file("{}: tensor '{}': its data {} the previous tensor", file, it->first,
                          it->second.begin < end ? "overlaps" : "leaves a gap after");
    }
    end = it->second.end;
  }
  if (end != data_begin + data_bytes) {
    return invalid_file("{}: {} bytes at the end belong to no tensor", file,
                        data_begin + data_bytes - end);
  }
  return {};
}

Result<std::vector<float>> Safetensors::floats(const std::string& name,
                                               std::span<const std::uint64_t> shape) const {
  const auto found = tensors_.find(name);
  if (found == tensors_.end())
    return invalid_file("{}: tensor '{}' is missing", this->name(), name);
  const Tensor& tensor = found->second;
  if (!std::equal(shape.begin(), shape.end(), tensor.shape.begin(), tensor.shape.end())) {
    return invalid_file("{}: tensor '{}': wrong shape (expected {}, got {})", this->name(), name,
                        shape_text(shape), shape_text(tensor.shape));
  }
  if (tensor.type != "F32" && tensor.type != "F16" && tensor.type != "BF16") {
    return invalid_file("{}: tensor '{}': unsupported type {} (expected F32, F16 or BF16)",
                        this->name(), name, tensor.type);
  }
  // open() verified that the size matches the shape and that the data lies within the file.
  std::vector<std::uint8_t> data(tensor.end - tensor.begin);
  STGS_TRY(source_->read(tensor.begin, data));
  std::vector<float> values = values_of(tensor.type, data);
  if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); })) {
    return invalid_file("{}: tensor '{}': contains a non-finite value", this->name(), name);
  }
  return values;
}

}  // namespace stgs::encoder
