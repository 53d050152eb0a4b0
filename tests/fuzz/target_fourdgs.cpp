// SPDX-License-Identifier: Apache-2.0
// .4dgs: records, of which chunks have compressed streams. The seeds have zstd streams, which are
// not checked by a sum, and zlib streams, which are.
#include "../fixtures/fourdgs_fixture.h"

#include <cstring>

#include "imported.h"
#include "stgs/format/fourdgs.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

constexpr std::size_t kMagicBytes = 8, kRecordHead = 9;

Bytes as_bytes(const std::string& text) {
  return {text.begin(), text.end()};
}

std::string keyframe_clip() {
  using namespace stgs::testing::fourdgs;
  File file;
  file.model = "keyframe-delta";
  std::vector<Gaussian> set(3);
  for (std::size_t i = 0; i < set.size(); ++i) {
    set[i].id = static_cast<std::uint32_t>(i);
    set[i].flags = static_cast<int>(i % 2);
  }
  const std::uint64_t keyframe = file.head().size();
  file.body = chunk(0, 1, set.size(), streams(set, true));
  Delta delta;
  delta.begin = 1;
  delta.end = 2;
  delta.reference = delta.keyframe = keyframe;
  delta.updated = {set[1]};
  delta.update_streams = stream(0, 3, {1, 2, 3}, kRaw, 1, kZstd);
  delta.dead = {set[0]};
  set[0].id = 9;
  delta.born = {set[0]};
  file.body += delta_chunk(delta);
  return file.bytes();
}

std::vector<Bytes> seeds() {
  using namespace stgs::testing::fourdgs;
  std::vector<Gaussian> set(4);
  for (std::size_t i = 0; i < set.size(); ++i) {
    set[i].time = static_cast<int>(10 * i);
    set[i].window = static_cast<int>(i % 2);
    set[i].flags = static_cast<int>(i / 2);
    set[i].sh.assign(24, 100);
  }
  File birth = birth_file(set, {kRaw, 2, kZstd});
  birth.windows = {{0, 2}, {0.5, 1.25}};
  birth.sh_degree = 2;
  birth.attributes = {{"color_space", "linear-rec709-display"}};
  birth.body += bands(set, 2);
  auto written = write_4dgs(stgs::testing::random_scene(7, 1, 4, 5));
  require(written.ok(), "seeds can be written");
  return {as_bytes(birth.bytes()), as_bytes(keyframe_clip()), std::move(*written)};
}

std::vector<Unit> units(View form) {
  std::vector<Unit> out = {{0, std::min(kMagicBytes, form.size())}};
  for (std::size_t at = kMagicBytes; at + kRecordHead <= form.size();) {
    std::uint64_t length = 0;
    std::memcpy(&length, form.data() + at + 1, sizeof length);
    length = std::min<std::uint64_t>(length, form.size() - at - kRecordHead);
    const std::size_t end = at + kRecordHead + static_cast<std::size_t>(length);
    out.push_back({at, end});
    at = end;
  }
  return out;
}

// Besides the import: the encoding of its scene.
std::uint64_t memory(View input) {
  return import_memory(input) + 4 * kImportLimits.max_memory;
}

}  // namespace

const Target stgs::fuzz::kTarget{"fourdgs", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ConversionNotes notes;
  FourdgsReport report;
  const auto scene = read_4dgs(*memory_source(Bytes(data, data + size), "input"), {}, kImportLimits,
                               &report, &notes);
  check_import(scene);
  if (scene.ok()) {
    std::uint64_t primitives = 0;
    for (const ScenePart& part : scene->parts) primitives += part.primitives;
    require(scene->parts.empty() || primitives == scene->gaussians.size(),
            "parts cover all primitives");
    require(encode_scene(*scene, {}).ok(), "an imported scene can be written");
  }
  return 0;
}
