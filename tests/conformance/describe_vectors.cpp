// SPDX-License-Identifier: Apache-2.0
// Describes .stgs files as spec/reference_decoder/decode.py does (spec/conformance.md 3.2): the
// lines of the hash of the decoded data, with lines for refused parts, reported errors and the
// validator's errors. Every SIMD target of the CPU must give the same result, and every float must
// be that of its integers (spec 8.5).
//
// usage: describe_vectors [--floats] {[--max-primitives N] [--max-memory BYTES] FILE}...
#include <string>

#include "../kernels/vector_targets.h"
#include "describe.h"
#include "scene/importance.h"
#include "sha256.h"

using namespace stgs;
using stgs::testing::Description;
using stgs::testing::OpenFile;

namespace {

// Describes the errors after which reading continued, except lost nodes, which are refused parts.
void describe_reports(const OpenFile& file, Description& out) {
  auto lost = file.head.walk.lost.begin();
  for (const Issue& issue : file.reader->damage()) {
    if (lost != file.head.walk.lost.end() && issue.number == lost->issue &&
        issue.offset == lost->record) {
      ++lost;
      continue;
    }
    out.line("reported: {} (issue {})", issue.message, issue.number);
  }
}

void describe_importance(const OpenFile& file, Description& out) {
  Findings findings;
  const auto payload = find_importance(*file.source, file.head, findings);
  if (!findings.ok()) out.refuse("importance", findings.status(file.source->name()));
  if (!payload) return;
  out.line("importance {}", stgs::testing::sha256(*payload));
  const auto values = file.reader->importance();
  const bool assigned = file.head.listed_primitives == file.head.index.primitives;
  if (values.ok() != assigned || (assigned && 4 * values->size() != payload->size()))
    out.line("mismatch: importances");
}

// Opens a file. Returns the reason for refusing it.
Status open(const std::string& path, const ReadLimits& limits, OpenFile& file) {
  STGS_ASSIGN(file.source, open_file(path));
  STGS_ASSIGN(file.reader, SceneReader::open(path, limits));
  Findings findings;
  file.head.walk.keeps_nodes = true;
  read_head(*file.source, limits, IndexLoading::kComplete, file.head, findings);
  return findings.status(path);
}

std::string describe(const std::string& path, const ReadLimits& limits, bool with_floats) {
  OpenFile file;
  Description out;
  out.with_floats = with_floats;
  if (const Status status = open(path, limits, file); !status.ok()) {
    out.refuse("file", status);
    return out.text;
  }
  if (file.reader->segments().size() != file.head.index.segments.size())
    out.line("mismatch: {} segments", file.reader->segments().size());
  describe_reports(file, out);
  describe_scene(file, out);
  describe_index(file, out);
  describe_importance(file, out);
  return out.text;
}

// Returns the numbers of the validator's errors.
std::string validation(const std::string& path, const ReadLimits& limits) {
  const auto source = open_file(path);
  Description out;
  if (!source.ok()) {
    out.refuse("validate", source.status());
    return out.text;
  }
  const auto issues = validate_scene(**source, limits);
  if (!issues.ok()) {
    out.refuse("validate", issues.status());
    return out.text;
  }
  std::string line = "errors";
  for (const Issue& issue : *issues) {
    if (issue.error) line += fmt::format(" {}", issue.number);
  }
  out.line("{}", line);
  return out.text;
}

}  // namespace

int main(int argc, char** argv) {
  ReadLimits limits;
  bool with_floats = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--max-primitives" && i + 1 < argc) {
      limits.max_primitives = std::stoull(argv[++i]);
    } else if (argument == "--max-memory" && i + 1 < argc) {
      limits.max_memory = std::stoull(argv[++i]);
    } else if (argument == "--floats") {
      with_floats = true;
    } else {
      const std::string expected = describe(argument, limits, with_floats);
      bool same = true;
      stgs::testing::for_each_vector_target(
          [&] { same = describe(argument, limits, with_floats) == expected && same; });
      if (!same) {
        fmt::print(stderr, "{}: vector targets differ\n", argument);
        return 1;
      }
      fmt::print("{}:\n{}{}", argument, expected, validation(argument, limits));
      limits = {};  // those of the next file
    }
  }
  return 0;
}
