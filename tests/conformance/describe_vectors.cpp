// SPDX-License-Identifier: Apache-2.0
// Describes .stgs files as spec/reference_decoder/decode.py does (spec/conformance.md 3.2): a line
// for each attribute of each tier with the XXH3-64 of its floats, or the reason for refusing it.
// Every SIMD target of the machine must give the same result.
//
// usage: describe_vectors [--max-primitives N] [--max-memory BYTES] FILE...
#include <cstring>
#include <string>

#include "../kernels/vector_targets.h"
#include "codec/attributes.h"
#include "container/container.h"

using namespace stgs;

namespace {

std::string refusal(const std::string& part, const Status& status) {
  return fmt::format("  {}refused: {}: {}\n", part,
                     status.code() == StatusCode::kUnsupported ? "unsupported" : "invalid",
                     status.message());
}

std::uint64_t hash_of(const Gaussians4D& set, Attribute attribute) {
  const AttributeView<const float> view = view_of(set, attribute);
  const auto components = static_cast<std::size_t>(components_of(attribute));
  std::vector<std::uint8_t> bytes(4 * components * set.size());
  for (std::size_t i = 0; i < set.size(); ++i) {
    std::memcpy(bytes.data() + 4 * components * i, view.data + view.stride * i, 4 * components);
  }
  return checksum(bytes);
}

std::string describe(const std::string& path, const ReadLimits& limits) {
  std::string out = path + ":\n";
  const auto reader = SceneReader::open(path, limits);
  if (!reader.ok()) return out + refusal("", reader.status());
  for (const Issue& issue : (*reader)->damage()) {
    if (!issue.error) continue;
    out += refusal("damage ", invalid_file("{} (issue {})", issue.message, issue.number));
  }
  for (std::uint32_t s = 0; s < (*reader)->segments().size(); ++s) {
    Status sh_status;
    const auto set = (*reader)->decode_intact(s, sh_status);
    if (!set.ok()) {
      out += refusal(fmt::format("segment {} ", s), set.status());
      continue;
    }
    for (const Attribute attribute : attributes_of(sh_status.ok() ? (*reader)->sh_degree() : 0)) {
      out +=
          fmt::format("  segment {} {} {:016x}\n", s, name_of(attribute), hash_of(*set, attribute));
    }
    if (!sh_status.ok()) out += refusal(fmt::format("segment {} sh ", s), sh_status);
  }
  const auto importance = (*reader)->importance();
  if (!importance.ok()) {
    out += refusal("importance ", importance.status());
  } else if (!importance->empty()) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(importance->data());
    out += fmt::format("  importance {:016x}\n", checksum({bytes, 4 * importance->size()}));
  }
  return out;
}

// Returns the issue numbers of the validator's errors.
std::string validation(const std::string& path, const ReadLimits& limits) {
  const auto source = open_file(path);
  if (!source.ok()) return refusal("validate ", source.status());
  const auto issues = validate_scene(**source, limits);
  if (!issues.ok()) return refusal("validate ", issues.status());
  std::string out = "  errors";
  for (const Issue& issue : *issues) {
    if (issue.error) out += fmt::format(" {}", issue.number);
  }
  return out + "\n";
}

}  // namespace

int main(int argc, char** argv) {
  ReadLimits limits;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--max-primitives" && i + 1 < argc) {
      limits.max_primitives = std::stoull(argv[++i]);
    } else if (argument == "--max-memory" && i + 1 < argc) {
      limits.max_memory = std::stoull(argv[++i]);
    } else {
      const std::string expected = describe(argument, limits);
      bool same = true;
      testing::for_each_vector_target(
          [&] { same = describe(argument, limits) == expected && same; });
      if (!same) {
        fmt::print(stderr, "{}: vector targets differ\n", argument);
        return 1;
      }
      fmt::print("{}{}", expected, validation(argument, limits));
    }
  }
  return 0;
}
