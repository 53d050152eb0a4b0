// SPDX-License-Identifier: Apache-2.0
// The functions of stgs-import.wasm (sdk/web/src/viewer/import_worker.ts): converts a 3DGS PLY
// model to an .stgs file in memory. An instance of the module converts one file.
#include <cstdint>
#include <exception>
#include <string>
#include <vector>

#include "export.h"
#include "stgs/format/interchange.h"
#include "stgs/format/scene_file.h"

namespace {

using namespace stgs;

constexpr std::uint64_t kMaxMemory = std::uint64_t{2} << 30;  // of 4 GiB that have an address

std::vector<std::uint8_t> input, output;

Result<std::vector<std::uint8_t>> convert(std::string name) {
  ReadLimits limits;
  limits.max_memory = kMaxMemory;
  const auto source = memory_source(std::move(input), std::move(name));
  STGS_ASSIGN(const Scene scene, read_ply(*source, limits));
  return encode_scene(scene, {});
}

}  // namespace

// Returns memory for the file and, behind it, its name with a zero byte; null if there is not
// enough.
STGS_EXPORT std::uint8_t* stgs_import_allocate(std::uint32_t file_bytes, std::uint32_t name_bytes) {
  try {
    input.resize(std::size_t{file_bytes} + name_bytes);
    return input.data();
  } catch (const std::exception&) {
    return nullptr;
  }
}

// Converts the file. Returns null if it succeeded, or why it failed.
STGS_EXPORT const char* stgs_import(std::uint32_t file_bytes) {
  try {
    std::string name(reinterpret_cast<const char*>(input.data()) + file_bytes);
    input.resize(file_bytes);
    auto converted = convert(std::move(name));
    if (converted.ok()) {
      output = std::move(converted).value();
      return nullptr;
    }
    return web::give(converted.status().message());
  } catch (const std::exception&) {
    return web::give("not enough memory in the browser; use 'stgs convert'");
  }
}

// The .stgs file, after stgs_import() has succeeded.
STGS_EXPORT const std::uint8_t* stgs_import_data() {
  return output.data();
}
STGS_EXPORT std::uint32_t stgs_import_bytes() {
  return static_cast<std::uint32_t>(output.size());
}
