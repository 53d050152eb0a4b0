// SPDX-License-Identifier: Apache-2.0
// The functions of stgs-import.wasm (sdk/web/src/viewer/import_worker.ts): converts a model to an
// .stgs file in memory: a 3DGS PLY, an SPZ or a SOG model, by the ending of its name. An instance
// of the module converts one file.
#include <cstdint>
#include <exception>
#include <string>
#include <string_view>
#include <vector>

#include "export.h"
#include "interchange/sog_read.h"
#include "stgs/format/interchange.h"
#include "stgs/format/scene_file.h"
#include "zip_members.h"

namespace {

using namespace stgs;

constexpr std::uint64_t kMaxMemory = std::uint64_t{2} << 30;  // of 4 GiB that have an address

std::vector<std::uint8_t> input, output;

bool has_ending(std::string_view name, std::string_view ending) {  // in lower case
  if (name.size() < ending.size()) return false;
  name.remove_prefix(name.size() - ending.size());
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = name[i];
    if ((c >= 'A' && c <= 'Z' ? static_cast<char>(c + 'a' - 'A') : c) != ending[i]) return false;
  }
  return true;
}

Result<Scene> read_bundle(const std::string& name, const ReadLimits& limits) {
  ImportMemory memory(limits, name);
  STGS_ASSIGN(const Lease lease, memory.take(input.size(), "the bytes of the file"));
  STGS_ASSIGN(std::unique_ptr<NamedFiles> files, web::zip_members(input, name, memory));
  std::vector<SogModel> models;
  STGS_ASSIGN(SogModel model, open_sog(std::move(files), "meta.json", memory));
  models.push_back(std::move(model));
  return read_sog_models(models, memory, nullptr);
}

Result<Scene> read_model(const std::string& name) {
  ReadLimits limits;
  limits.max_memory = kMaxMemory;
  if (has_ending(name, ".sog")) return read_bundle(name, limits);
  const auto source = memory_source(std::move(input), name);
  return has_ending(name, ".spz") ? read_spz(*source, limits) : read_ply(*source, limits);
}

Result<std::vector<std::uint8_t>> convert(const std::string& name) {
  STGS_ASSIGN(const Scene scene, read_model(name));
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
    auto converted = convert(name);
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
