// SPDX-License-Identifier: Apache-2.0
// .stgs files of format version 1.x, which this version does not write: the inputs are the files of
// tests/format/stgs1_vectors.
#include <xxhash.h>

#include <cstring>

#include "imported.h"
#include "interchange/stgs1/stgs1.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

constexpr std::size_t kHeader = 40, kRecord = 32;  // clauses 2.2, 3.1 of that version

std::uint64_t number_at(View bytes, std::size_t at) {
  std::uint64_t v = 0;
  std::memcpy(&v, bytes.data() + at, sizeof v);
  return v;
}
void put_hash(Bytes& bytes, std::size_t at, std::size_t begin, std::size_t end) {
  const std::uint64_t v = XXH3_64bits(bytes.data() + begin, end - begin);
  std::memcpy(bytes.data() + at, &v, sizeof v);
}

// Returns the header and the records. The last one is clipped to the file.
std::vector<Unit> units(View file) {
  std::vector<Unit> out;
  if (file.size() < kHeader) return out;
  out.push_back({0, kHeader});
  for (std::size_t at = kHeader; at + kRecord <= file.size(); at = out.back().end) {
    const std::uint64_t length = number_at(file, at + 8);
    out.push_back({at, at + kRecord + std::min<std::uint64_t>(length, file.size() - at - kRecord)});
  }
  return out;
}

// Repairs the checksums, and the size of a finished file.
Bytes repack(Bytes file, Repair repair) {
  if (repair == Repair::kNothing) return file;
  for (const Unit& unit : units(file)) {
    if (unit.begin > 0) {
      put_hash(file, unit.begin + 16, unit.begin + kRecord, unit.end);
      put_hash(file, unit.begin + 24, unit.begin, unit.begin + 24);
      continue;
    }
    const std::uint64_t size = file.size();
    const bool is_finished = (file[12] & 1) == 0;
    if (repair == Repair::kSizes && is_finished) std::memcpy(&file[16], &size, sizeof size);
    put_hash(file, 32, 0, 32);
  }
  return file;
}

// Without a writer there are no seeds besides the corpus, but an empty input.
std::vector<Bytes> seeds() {
  return {Bytes()};
}

// The file is read twice, and the first scene stays.
std::uint64_t memory(View input) {
  return import_memory(input) + kImportLimits.max_memory;
}

}  // namespace

const Target stgs::fuzz::kTarget{"stgs1", seeds, nullptr, repack, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ConversionNotes notes;
  const auto source = memory_source(Bytes(data, data + size), "input");
  const auto scene = read_stgs1(*source, kImportLimits, &notes);
  if (scene.status().code() == StatusCode::kNotBuilt) return 0;  // positions coded by Draco
  check_import(scene);
  const auto again = read_stgs1(*source, kImportLimits);
  require(scene.status().message() == again.status().message(), "reading is repeatable");
  if (!scene.ok()) return 0;
  std::uint64_t primitives = 0;
  for (const ScenePart& part : scene->parts) primitives += part.primitives;
  require(scene->parts.empty() || primitives == scene->gaussians.size(),
          "the parts cover the primitives");
  require(scene->importance.empty() || scene->importance.size() == scene->gaussians.size(),
          "there is one importance per primitive, or none");
  return 0;
}
