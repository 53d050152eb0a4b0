// SPDX-License-Identifier: Apache-2.0
// Packs the segments of a .stgs file for test_webgl2.py.
//
// usage: pack_scene FILE.stgs OUT
// Writes the words of all segments to OUT.bin, and to OUT.json the other fields of PackedSegment
// (sdk/web/src/types.ts), with `at`, the offset of the words in bytes.
#include <cstdint>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "packed_segment.h"
#include "stgs/format/scene_file.h"

namespace stgs {
namespace {

Status pack(const std::string& path, const std::string& out) {
  STGS_ASSIGN(const auto reader, SceneReader::open(path));
  std::ofstream words(out + ".bin", std::ios::binary), list(out + ".json");
  list.precision(17);
  std::uint64_t at = 0;
  const SceneMetadata& metadata = reader->metadata();
  list << "{\"tickSeconds\":" << metadata.time_base.seconds(1) << ",\"frames\":" << metadata.frames
       << ",\"shDegree\":" << reader->sh_degree() << ",\"near\":" << metadata.near_plane
       << ",\"kernel\":" << int{metadata.kernel} << ",\"segments\":[";
  const std::vector<SegmentInfo>& segments = reader->segments();
  for (std::uint32_t i = 0; i < segments.size(); ++i) {
    const SegmentInfo& segment = segments[i];
    STGS_ASSIGN(const Gaussians4D set, reader->decode(i, true, reader->render_origin(i)));
    const auto n = static_cast<std::uint32_t>(set.size());
    std::vector<std::uint8_t> packed(player::packed_bytes(n, set.sh_degree));
    player::pack_segment(set, 0, n, set.sh_degree, packed.data());
    words.write(reinterpret_cast<const char*>(packed.data()),
                static_cast<std::streamsize>(packed.size()));
    list << (i > 0 ? ",\n" : "\n") << "{\"id\":" << i << ",\"primitives\":" << n
         << ",\"shDegree\":" << set.sh_degree << ",\"begin\":" << segment.begin_ticks
         << ",\"end\":" << segment.end_ticks
         << ",\"origin\":" << reader->parts()[segment.part].begin_ticks + set.time_origin
         << ",\"at\":" << at << "}";
    at += packed.size();
  }
  list << "]}\n";
  if (!words.flush() || !list.flush()) return runtime_error("cannot write {}", out);
  return {};
}

}  // namespace
}  // namespace stgs

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: pack_scene FILE.stgs OUT\n";
    return 1;
  }
  const stgs::Status status = stgs::pack(argv[1], argv[2]);
  if (!status.ok()) std::cerr << status.message() << "\n";
  return static_cast<int>(status.code());
}
