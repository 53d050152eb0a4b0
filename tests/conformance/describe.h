// SPDX-License-Identifier: Apache-2.0
// The lines of a file that its conformance vector's hash covers (spec/conformance.md 3.2).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "codec/record_decode.h"
#include "container/container.h"
#include "stgs/format/scene_file.h"

namespace stgs::testing {

// A file as the project's reader opens it, and its head.
struct OpenFile {
  std::unique_ptr<ByteSource> source;
  FileHead head;
  std::unique_ptr<SceneReader> reader;
};

// The lines of a file, with lines for refused parts, reported errors and, if `with_floats`, the
// floats of each attribute.
struct Description {
  bool with_floats = false;
  std::string text;

  template <typename... Args>
  void line(fmt::format_string<Args...> form, Args&&... args) {
    text += "  " + fmt::format(form, std::forward<Args>(args)...) + "\n";
  }
  void refuse(const std::string& part, const Status& status) {
    line("refused {}: {}", part, status.message());
  }
};

// Words of lines.
std::string bits_text(float value);
std::string bits_text(double value);
std::string bits_text(std::span<const float> values);
std::string bytes_text(std::span<const std::uint8_t> bytes);
std::string bytes_text(const std::string& text);
// Returns a time in units of 2^-`digits` ticks.
std::int64_t to_units(double ticks, int digits);

// From `file` to `primitives`.
void describe_scene(const OpenFile& file, Description& out);
// Links, lost nodes, parts, and segments with their tiers and further records.
void describe_index(const OpenFile& file, Description& out);
// The attributes and ends of segment `ordinal` of the reader, or its refusal. `place`: its part,
// level, slot and tier. Checks the reader's floats as well.
void describe_tier(const OpenFile& file, std::uint32_t ordinal, const std::string& place,
                   Description& out);

}  // namespace stgs::testing
