// SPDX-License-Identifier: Apache-2.0
// PLY, binary and ASCII, PlayCanvas' packed PLY, and .ftgs.ply.
#include <string>
#include <string_view>

#include "../fixtures/ftgs_fixture.h"
#include "imported.h"
#include "stgs/format/timed_formats.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

Bytes to_bytes(std::string_view text) {
  return {text.begin(), text.end()};
}

// A packed PLY with as many chunks as needed and SH of degree 1.
Bytes packed_ply(std::size_t vertices) {
  const std::size_t chunks = (vertices + 255) / 256;
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement chunk " + std::to_string(chunks) + "\n";
  for (const char* name : {"min_x", "min_y", "min_z", "max_x", "max_y", "max_z", "min_scale_x",
                           "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y",
                           "max_scale_z", "min_r", "min_g", "min_b", "max_r", "max_g", "max_b"}) {
    text += std::string("property float ") + name + "\n";
  }
  text += "element vertex " + std::to_string(vertices) + "\n";
  for (const char* name : {"position", "rotation", "scale", "color"}) {
    text += std::string("property uint packed_") + name + "\n";
  }
  text += "element sh " + std::to_string(vertices) + "\n";
  for (int k = 0; k < 9; ++k) text += "property uchar f_rest_" + std::to_string(k) + "\n";
  text += "end_header\n";
  Bytes out = to_bytes(text);
  const std::size_t body = chunks * 72 + vertices * (16 + 9);
  for (std::size_t i = 0; i < body; ++i) out.push_back(static_cast<std::uint8_t>(i * 37 % 127));
  return out;
}

std::vector<Bytes> seeds() {
  std::vector<Bytes> out = {packed_ply(3), packed_ply(257),
                            to_bytes(testing::ftgs_file(3).bytes())};
  for (const int degree : {0, 3}) {
    auto bytes = write_ply(testing::random_scene(3, degree, 1, 5).gaussians);
    require(bytes.ok(), "seeds can be written");
    out.push_back(std::move(*bytes));
  }
  out.push_back(to_bytes(
      "ply\r\nformat ascii 1.0\r\ncomment by hand\r\nelement camera 1\r\nproperty int id\r\n"
      "element vertex 2\r\nproperty float x\r\nproperty float y\r\nproperty double z\r\n"
      "property float scale_0\r\nproperty float scale_1\r\nproperty float scale_2\r\n"
      "property float rot_0\r\nproperty float rot_1\r\nproperty float rot_2\r\n"
      "property float rot_3\r\nproperty float opacity\r\nproperty float f_dc_0\r\n"
      "property float f_dc_1\r\nproperty float f_dc_2\r\nend_header\r\n7\r\n"
      "1 2 3 -3 -3.5 -4 1 0 0 0 2 0.1 0.2 0.3\r\n-1 1e-3 0 -3 -3 -3 0.5 0.5 0.5 0.5 -1 0 0 0\r\n"));
  return out;
}

std::size_t header_end(View form) {
  const std::string_view text(reinterpret_cast<const char*>(form.data()), form.size());
  const std::size_t end = text.find("end_header");
  return end == std::string_view::npos ? form.size() : end;
}

// The lines of the header.
std::vector<Unit> units(View form) {
  std::vector<Unit> out;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < header_end(form); ++i) {
    if (form[i] != '\n') continue;
    out.push_back({begin, i + 1});
    begin = i + 1;
  }
  return out;
}

}  // namespace

const Target stgs::fuzz::kTarget{"ply", seeds, nullptr, nullptr, units, import_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ConversionNotes notes;
  check_import(read_ply(*memory_source(Bytes(data, data + size), "input"), kImportLimits, &notes));
  check_import(
      read_ftgs_ply(*memory_source(Bytes(data, data + size), "input"), {}, kImportLimits, &notes));
  return 0;
}
