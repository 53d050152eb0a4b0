// SPDX-License-Identifier: Apache-2.0
// Weights of networks: safetensors files, and the network of the perceptual loss. The unpacked form
// has the same bytes; the length of the header is repaired.
#include <cmath>
#include <cstring>
#include <string_view>

#include "fuzz_target.h"
#include "perceptual/feature_network.h"
#include "perceptual/safetensors.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

constexpr std::size_t kLength = 8;  // bytes of the length of the header
// Names and shapes that are asked for.
constexpr const char* kNames[] = {"a", "features.0.bias", "features.0.weight"};
const std::vector<std::uint64_t> kShapes[] = {{}, {0}, {2}, {2, 3}, {64}};

Bytes file_of(const std::string& header, std::size_t data_bytes) {
  Bytes out(kLength);
  const std::uint64_t length = header.size();
  std::memcpy(out.data(), &length, kLength);
  out.insert(out.end(), header.begin(), header.end());
  for (std::size_t i = 0; i < data_bytes; ++i) out.push_back(static_cast<std::uint8_t>(i % 60));
  return out;
}

std::vector<Bytes> seeds() {
  return {
      file_of(R"({"__metadata__":{"format":"pt"},"a":{"dtype":"F32","shape":[2,3],)"
              R"("data_offsets":[0,24]},"b":{"dtype":"F16","shape":[2],"data_offsets":[24,28]}})",
              28),
      file_of(R"({"a":{"dtype":"BF16","shape":[],"data_offsets":[0,2]},)"
              R"("e":{"dtype":"F64","shape":[0,5],"data_offsets":[2,2]}})",
              2),
      file_of(R"({"features.0.bias":{"dtype":"F32","shape":[64],"data_offsets":[0,256]}})", 256),
      file_of("{}", 0)};
}

std::size_t header_end(View file) {
  std::uint64_t length = 0;
  if (file.size() < kLength) return file.size();
  std::memcpy(&length, file.data(), kLength);
  return length > file.size() - kLength ? file.size() : kLength + static_cast<std::size_t>(length);
}

std::vector<Unit> units(View file) {
  return {{0, header_end(file)}};
}

// With repaired sizes, the header ends after its last '}'.
Bytes repair(Bytes file, Repair repair) {
  if (repair != Repair::kSizes || file.size() < kLength) return file;
  const std::string_view text(reinterpret_cast<const char*>(file.data()) + kLength,
                              file.size() - kLength);
  const std::size_t last = text.rfind('}');
  const std::uint64_t length = last == std::string_view::npos ? 0 : last + 1;
  std::memcpy(file.data(), &length, kLength);
  return file;
}

// The values of the JSON header, the tensors' names and shapes, and one tensor as bytes and floats.
std::uint64_t memory(View input) {
  return 192 * input.size() + (64 << 10);
}

void check(const Status& status) {
  require(status.ok() || (status.code() == StatusCode::kInvalidFile && !status.message().empty()),
          "damaged weights are invalid");
}

}  // namespace

const Target stgs::fuzz::kTarget{"safetensors", seeds, nullptr, repair, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  const auto file = Safetensors::open(memory_source(input, "input"));
  check(file.status());
  for (const char* name : kNames) {
    for (const std::vector<std::uint64_t>& shape : kShapes) {
      if (!file.ok()) continue;
      const auto values = file->floats(name, shape);
      check(values.status());
      if (!values.ok()) continue;
      std::uint64_t expected = 1;
      for (const std::uint64_t n : shape) expected *= n;
      require(file->contains(name) && values->size() == expected, "a tensor has its shape");
      require(values->size() * 2 <= size, "a tensor has bytes in the file");
      for (const float v : *values) require(std::isfinite(v), "weights are finite");
    }
  }
  check(read_feature_network(memory_source(input, "input"), ChannelWeights::kOptional).status());
  return 0;
}
