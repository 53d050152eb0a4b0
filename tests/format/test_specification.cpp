// SPDX-License-Identifier: Apache-2.0
// The specification and the program agree.
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "catch.h"
#include "fixtures/copy_fixture.h"
#include "stgs/format/scene_file.h"

using namespace stgs;

namespace {

std::string source_text(const std::string& path) {
  std::ifstream file(std::string(STGS_TEST_DATA) + "/../../" + path);
  std::ostringstream text;
  text << file.rdbuf();
  REQUIRE_FALSE(text.str().empty());
  return text.str();
}

// The scene of spec 9.
Scene example_scene() {
  Scene scene;
  scene.metadata.time_base = {1, 2};
  scene.metadata.frames = 2;
  scene.metadata.generator = "example";
  Gaussians4D& set = scene.gaussians;
  set.resize(1);
  set.position = {1.0f, 2.0f, 3.0f};
  set.log_scale = {-1.0f, -2.0f, -3.0f};
  set.rotation = {1.0f, 0.0f, 0.0f, 0.0f};
  set.opacity_logit = {2.0f};
  set.sh = {0.1f, 0.2f, 0.3f};
  set.time = {0.5f};
  set.sigma = {1.0f};
  set.radius = {0.25f};
  return scene;
}

std::string hexdump(const std::vector<std::uint8_t>& bytes) {
  std::string out;
  for (std::size_t at = 0; at < bytes.size(); at += 16) {
    std::string hex, text;
    for (std::size_t i = at; i < std::min(at + 16, bytes.size()); ++i) {
      hex += fmt::format("{:02x} ", bytes[i]);
      text.push_back(bytes[i] >= 0x20 && bytes[i] < 0x7F ? static_cast<char>(bytes[i]) : '.');
    }
    out += fmt::format("    {:04x}  {:<48} {}\n", at, hex, text);
  }
  return out;
}

}  // namespace

TEST_CASE("the example in the specification is the writer's output") {
  const auto encoded = encode_scene(example_scene(), {});
  INFO(encoded.status().message());
  REQUIRE(encoded.ok());
  const auto bytes = testing::without_copy(*encoded, 0);
  const std::string text = source_text("spec/stgs-format.md");
  const std::string begin = "<!-- example begin -->\n", end = "<!-- example end -->";
  const std::size_t first = text.find(begin) + begin.size();
  const std::string printed = text.substr(first, text.find(end) - first);
  CHECK(printed == "\n" + hexdump(bytes) + "\n");
  const auto record_at = [&bytes](const char* tag) {
    const std::string content(bytes.begin(), bytes.end());
    return content.find(tag);
  };
  CHECK(text.find(fmt::format("META begins at {}, LAYT at {}, INDX at {}, SEGM at {}.",
                              record_at("META"), record_at("LAYT"), record_at("INDX"),
                              record_at("SEGM"))) != std::string::npos);
  const auto issues = validate_scene(*memory_source(bytes));
  REQUIRE(issues.ok());
  CHECK(issues->empty());
}

TEST_CASE("the program and the specification list the same issue numbers") {
  const auto numbers = [](const std::string& text, const char* pattern) {
    std::set<int> out;
    const std::regex expression(pattern);
    for (std::sregex_iterator it(text.begin(), text.end(), expression), last; it != last; ++it) {
      out.insert(std::stoi((*it)[1]));
    }
    return out;
  };
  const auto code =
      numbers(source_text("format/src/container/findings.h"), " = ([1-5][0-9][0-9]),");
  CHECK(code.size() > 30);
  CHECK(code == numbers(source_text("spec/conformance.md"), "\\| ([1-5][0-9][0-9]) \\|"));
}

TEST_CASE("the specification and the program have the same format version") {
  CHECK(source_text("spec/stgs-format.md")
            .find(fmt::format("Format version {}.{}.", kFormatMajor, kFormatMinor)) !=
        std::string::npos);
}
