// SPDX-License-Identifier: Apache-2.0
// A camera that a user wrote as JSON.
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "fuzz_target.h"
#include "stgs/encoder/camera_json.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

std::vector<Bytes> seeds() {
  constexpr std::string_view kComplete =
      R"({"name":"a","width":640,"height":480,"fx":500,"fy":510.5,"cx":320,"cy":2.4e2,)"
      R"("rotation":[1,0,0,0,1,0,0,0,1],"translation":[0,-1,2.5],"test":true})";
  constexpr std::string_view kMinimal =
      R"({"width":1,"height":32768,"fx":1e-3,"fy":1,"cx":0,"cy":0,)"
      R"("rotation":[0,0,1,0,1,0,-1,0,0],"translation":[0,0,0]})";
  // A token that the message of a syntax error quotes.
  const std::string token = R"({"a":"key ')" + std::string(1000, 'x');
  return {Bytes(kComplete.begin(), kComplete.end()), Bytes(kMinimal.begin(), kMinimal.end()),
          Bytes(token.begin(), token.end())};
}

std::uint64_t memory(View input) {
  return 64 * input.size() + (64 << 10);
}

}  // namespace

const Target stgs::fuzz::kTarget{"camera_json", seeds, nullptr, nullptr, nullptr, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto camera = encoder::parse_camera(text, "input");
  if (!camera.ok()) return 0;
  require(encoder::check_camera(*camera, "input").ok(), "a camera that is read is valid");
  const auto again = encoder::camera_from_json(encoder::camera_to_json(*camera), "again");
  require(again.ok() && again->width == camera->width && again->fx == camera->fx,
          "a camera round-trips");
  return 0;
}
