// SPDX-License-Identifier: Apache-2.0
#include "perceptual/safetensors.h"

#include <algorithm>

#include "catch.h"
#include "network_fixture.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Shape = std::vector<std::uint64_t>;

Result<Safetensors> open(Bytes bytes) {
  return Safetensors::open(memory_source(std::move(bytes), "w.safetensors"));
}

Result<Safetensors> open(const std::string& header, std::size_t data) {
  return open(safetensors_file(header, Bytes(data)));
}

// Checks for an invalid-file error whose message names the file and contains `text`.
template <typename T>
void check_rejected(const Result<T>& result, const std::string& text) {
  INFO(text);
  REQUIRE_FALSE(result.ok());
  const Status& status = result.status();
  INFO(status.message());
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(status.message().find("w.safetensors") == 0);
  CHECK(status.message().find(text) != std::string::npos);
}

std::string tensor(const std::string& name, const std::string& type, const std::string& shape,
                   const std::string& offsets) {
  return fmt::format(R"("{}":{{"dtype":"{}","shape":{},"data_offsets":{}}})", name, type, shape,
                     offsets);
}

// A header of these entries.
std::string object(const std::vector<std::string>& entries) {
  return fmt::format("{{{}}}", fmt::join(entries, ","));
}

}  // namespace

TEST_CASE("every supported type is read as 32-bit floats") {
  const Bytes data = {0x00, 0x00, 0x80, 0x3f, 0x00, 0x00, 0x20, 0xc1,  // F32: 1, -10
                      0x00, 0x3c, 0x01, 0x00, 0xff, 0xfb, 0x00, 0x80,  // F16: 1, 2^-24, -65504, -0
                      0x80, 0x3f, 0x49, 0xc0};                         // BF16: 1, -3.140625
  const std::string header =
      object({tensor("half", "F16", "[4]", "[8,16]"), tensor("a", "F32", "[2,1]", "[0,8]"),
              R"("__metadata__":{"format":"pt"})", tensor("brain", "BF16", "[1,2]", "[16,20]"),
              tensor("none", "F32", "[3,0]", "[20,20]")});
  const Result<Safetensors> file = open(safetensors_file(header + "  ", data));
  REQUIRE(file.ok());
  CHECK(file->contains("half"));
  CHECK_FALSE(file->contains("__metadata__"));
  CHECK(*file->floats("a", Shape{2, 1}) == std::vector<float>{1.0f, -10.0f});
  CHECK(*file->floats("half", Shape{4}) == std::vector<float>{1.0f, 0x1p-24f, -65504.0f, 0.0f});
  CHECK(*file->floats("brain", Shape{1, 2}) == std::vector<float>{1.0f, -3.140625f});
  CHECK(file->floats("none", Shape{3, 0})->empty());
}

TEST_CASE("broken headers are rejected before their sizes are used") {
  check_rejected(open(Bytes(5)), "shorter than 8 bytes");
  check_rejected(open(Bytes(8)), "not a JSON object");
  check_rejected(open(Bytes{100, 0, 0, 0, 0, 0, 0, 0, '{', '}'}),
                 "header of 100 bytes, 2 available");
  check_rejected(open(Bytes(16, 0xff)), "header of 18446744073709551615 bytes, 8 available");
  check_rejected(open(std::string(kMaxSafetensorsHeader + 1, ' '), 0), "header too large");
  for (const char* header : {"[]", "{", "{\"a\":}", "\"text\"", "{\"\xff\":1}"})
    check_rejected(open(header, 0), "not a JSON object");
  check_rejected(open(std::string(100000, '['), 0), "more than 64 nested arrays and objects");
  const struct {
    const char *entry, *message;
  } entries[] = {
      {R"(3)", "its description is not a JSON object"},
      {R"({"shape":[1],"data_offsets":[0,4]})", "dtype is missing or not a string"},
      {R"({"dtype":4,"shape":[1],"data_offsets":[0,4]})", "dtype is missing or not a string"},
      {R"({"dtype":"F32","data_offsets":[0,4]})", "shape is missing or not an array"},
      {R"({"dtype":"F32","shape":4,"data_offsets":[0,4]})", "shape is missing or not an array"},
      {R"({"dtype":"F32","shape":[1]})", "data_offsets is missing or not an array of 2"},
      {R"({"dtype":"F32","shape":[1],"data_offsets":[0,4,8]})",
       "data_offsets is missing or not an array of 2"},
      {R"({"dtype":"F32","shape":[-1],"data_offsets":[0,4]})",
       "its shape has an entry that is not"},
      {R"({"dtype":"F32","shape":[1.5],"data_offsets":[0,4]})",
       "its shape has an entry that is not"},
      {R"({"dtype":"F32","shape":[1],"data_offsets":[-4,0]})", "its data_offsets are not"},
      {R"({"dtype":"F32","shape":[1],"data_offsets":["0",4]})", "its data_offsets are not"},
      {R"({"dtype":"F32","shape":[1],"data_offsets":[4,0]})", "its data ends before it begins"},
      {R"({"dtype":"F32","shape":[1],"data_offsets":[0,5]})", "its data ends at byte 5 of 4"},
      {R"({"dtype":"F32","shape":[3],"data_offsets":[0,4]})",
       "4 bytes do not match shape [3] of type F32"},
      {R"({"dtype":"F16","shape":[1],"data_offsets":[0,4]})",
       "4 bytes do not match shape [1] of type F16"},
      {R"({"dtype":"F32","shape":[4294967296,4294967296],"data_offsets":[0,4]})",
       "4 bytes do not match"},
      {R"({"dtype":"F32","shape":[4611686018427387905],"data_offsets":[0,4]})",
       "4 bytes do not match"},
  };
  for (const auto& [entry, message] : entries) {
    check_rejected(open(fmt::format(R"({{"a":{}}})", entry), 4),
                   std::string("tensor 'a': ") + message);
  }
}

TEST_CASE("arrays that overlap, leave gaps or share a name are rejected") {
  const auto pair = [](const std::string& name, const char* shape, const char* offsets) {
    return object({tensor("a", "F32", "[2]", "[0,8]"), tensor(name, "F32", shape, offsets)});
  };
  CHECK(open(pair("b", "[1]", "[8,12]"), 12).ok());
  check_rejected(open(pair("b", "[1]", "[4,8]"), 8), "tensor 'b': its data overlaps");
  check_rejected(open(pair("b", "[2]", "[0,8]"), 8), "tensor 'b': its data overlaps");
  check_rejected(open(pair("b", "[1]", "[12,16]"), 16), "tensor 'b': its data leaves a gap");
  check_rejected(open(pair("b", "[1]", "[8,12]"), 16), "4 bytes at the end");
  check_rejected(open(pair("a", "[1]", "[8,12]"), 12), "tensor 'a' occurs twice");
}

TEST_CASE("floats() rejects arrays that are missing, of another shape or type, or not finite") {
  const Bytes data = {0x00, 0x00, 0x80, 0x7f, 0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x7e, 1};
  const std::string header =
      object({tensor("inf", "F32", "[1]", "[0,4]"), tensor("long", "I64", "[1]", "[4,12]"),
              tensor("nan", "F16", "[1]", "[12,14]"), tensor("new", "X9", "[7]", "[14,15]")});
  const Result<Safetensors> file = open(safetensors_file(header, data));
  REQUIRE(file.ok());
  check_rejected(file->floats("none", Shape{1}), "tensor 'none' is missing");
  check_rejected(file->floats("inf", Shape{2}),
                 "tensor 'inf': wrong shape (expected [2], got [1])");
  check_rejected(file->floats("inf", Shape{1, 1}),
                 "tensor 'inf': wrong shape (expected [1, 1], got [1])");
  check_rejected(file->floats("inf", Shape{1}), "tensor 'inf': contains a non-finite value");
  check_rejected(file->floats("nan", Shape{1}), "tensor 'nan': contains a non-finite value");
  check_rejected(file->floats("long", Shape{1}), "tensor 'long': unsupported type I64");
  check_rejected(file->floats("new", Shape{7}), "tensor 'new': unsupported type X9");
}

TEST_CASE("a truncated file is rejected at every length") {
  SafetensorsWriter writer;
  writer.add("a", "[3]", {1, 2, 3});
  writer.add("b", "[1,2]", {4, 5});
  const Bytes complete = writer.take();
  CHECK(open(complete).ok());
  for (std::size_t n = 0; n < complete.size(); ++n) {
    INFO(n << " bytes");
    const Result<Safetensors> truncated = open(Bytes(complete.begin(), complete.begin() + n));
    CHECK_FALSE(truncated.ok());
    CHECK(truncated.status().code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE(
    "networks are read with the tensor names of torchvision, with or without the linear layers of "
    "LPIPS") {
  const auto read = [](const Tensors& tensors) {
    return read_feature_network(memory_source(tensors_file(tensors), "w.safetensors"),
                                ChannelWeights::kOptional);
  };
  for (const LpipsNetwork& layout : lpips_networks()) {
    for (const bool linear : {false, true}) {
      const Tensors tensors = random_tensors(layout, 1, linear);
      const auto found = read(tensors);
      REQUIRE(found.ok());
      CAPTURE(layout.name, linear);
      CHECK((*found)->name == layout.name);
      CHECK((*found)->linear == linear);
      for (const LpipsLayer& layer : layout.layers) {
        if (layer.kind != LpipsLayer::Kind::kConvolution) continue;
        const std::string name = fmt::format("features.{}", layer.feature);
        CHECK(std::any_of((*found)->stages.begin(), (*found)->stages.end(),
                          [&](const FeatureStage& stage) {
                            return stage.weight == tensors.at(name + ".weight").second &&
                                   stage.bias == tensors.at(name + ".bias").second;
                          }));
      }
      const std::vector<float>& last = (*found)->stages.back().channel_weights;
      const auto channels = static_cast<std::size_t>(layout.layers.back().out);
      if (!linear) CHECK(last == std::vector<float>(channels, 1.0f / static_cast<float>(channels)));
      if (linear) CHECK(last == tensors.rbegin()->second.second);  // the last name is a linear one
    }
  }
  const Tensors tensors = random_tensors(network_layout("vgg"), 1);
  const std::uint64_t hash = (*read(tensors))->hash;
  for (const char* name : {"features.28.bias", "lin3.model.1.weight"}) {
    Tensors incomplete = tensors;
    incomplete.erase(name);
    check_rejected(read(incomplete), fmt::format("tensor '{}' is missing", name));
  }
  Tensors changed = tensors;
  changed.erase("features.0.weight");
  check_rejected(read(changed), "not a network of LPIPS");
  changed = tensors;
  changed.at("features.28.bias").second[511] += 1.0f;
  CHECK((*read(changed))->hash != hash);
  changed.at("features.12.weight").second.resize(9 * 256);
  check_rejected(read(changed),
                 "tensor 'features.12.weight': 9216 bytes do not match shape [256, 256, 3, 3]");
  changed = tensors;
  changed.at("lin2.model.1.weight").second[7] = -0.5f;
  check_rejected(read(changed), "tensor 'lin2.model.1.weight': negative channel weight");
}
