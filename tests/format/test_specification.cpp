// SPDX-License-Identifier: Apache-2.0
// The specification and the program agree.
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "catch.h"
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

}  // namespace

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
            .find(fmt::format("file format, version {}.{}", kFormatMajor, kFormatMinor)) !=
        std::string::npos);
}
