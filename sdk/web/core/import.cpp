// SPDX-License-Identifier: Apache-2.0
// The functions of stgs-import.wasm (sdk/web/src/viewer/import_worker.ts), which converts a 3DGS
// PLY, an SPZ or a SOG model to an .stgs file in memory. The extension of the name selects the
// format. An instance of the module converts one file. The host calls stgs_import_unpack(),
// stgs_import_open() and stgs_import_convert(), in this order, and executes all tasks of
// stgs_import_task() after each one.
#include <cstdint>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/bytes.h"
#include "export.h"
#include "host_decoding.h"
#include "interchange/compression.h"
#include "interchange/sog_read.h"
#include "stgs/format/interchange.h"
#include "stgs/format/scene_file.h"
#include "webp_stream.h"
#include "zip_members.h"

namespace {

using namespace stgs;
using Bytes = std::vector<std::uint8_t>;

ReadLimits import_limits() {
  ReadLimits limits;
  limits.max_memory = std::uint64_t{2} << 30;  // of the 4 GiB of addresses
  return limits;
}

bool has_ending(std::string_view name, std::string_view ending) {  // in lower case
  if (name.size() < ending.size()) return false;
  name.remove_prefix(name.size() - ending.size());
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = name[i];
    if ((c >= 'A' && c <= 'Z' ? static_cast<char>(c + 'a' - 'A') : c) != ending[i]) return false;
  }
  return true;
}

// The conversion of one file. Call each step once, in this order.
class Import {
 public:
  Import(Bytes file, const std::string& name)
      : name_(name), file_(std::move(file)), memory_(import_limits(), name) {}

  // Requests the content of a gzip stream, or of the deflated members of an archive.
  Status unpack() {
    if (has_ending(name_, ".sog")) return open_bundle();
    return has_ending(name_, ".spz") && is_gzip(file_) ? request_gzip() : Status();
  }
  // Requests the images of a bundle.
  Status open() { return members_ ? open_model() : Status(); }
  // Returns the .stgs file.
  Result<Bytes> convert() {
    STGS_ASSIGN(const Scene scene, read_scene());
    return encode_scene(scene, {});
  }

 private:
  Status open_bundle() {
    STGS_ASSIGN(lease_, memory_.take(file_.size(), "the bytes of the file"));
    STGS_ASSIGN(members_, web::ZipMembers::open(file_, name_, web::host_decoding(), memory_));
    return {};
  }
  Status request_gzip() {
    constexpr std::size_t kSizeField = 4;  // at the end: the size of the content modulo 2^32
    if (file_.size() < kSizeField) return invalid_file("{}: gzip stream is truncated", name_);
    const std::uint64_t size = ByteReader(std::span(file_).last(kSizeField)).u32();
    if (size / kDeflateRatio > file_.size()) {
      return invalid_file("{}: gzip stream is damaged or truncated", name_);
    }
    return web::host_decoding().request(web::Coding::kGzip, name_, file_, size, memory_);
  }
  Status open_model() {
    const web::ZipMembers& members = *members_;
    STGS_ASSIGN(model_, open_sog(std::move(members_), "meta.json", memory_));
    const SogLayout& layout = model_->layout;
    std::vector<std::string> images = layout.means.files;
    images.insert(images.end(), {layout.scales_file, layout.quats_file, layout.sh0_file});
    if (layout.palette) {
      images.insert(images.end(), {layout.palette->centroids, layout.palette->labels});
    }
    for (const std::string& image : images) {
      STGS_ASSIGN(const auto bytes, members.content(image));
      const std::string label = members.label(image);
      STGS_ASSIGN(const web::WebpStream stream, web::lossless_webp_stream(bytes, label));
      STGS_TRY(web::host_decoding().request(web::Coding::kWebp, label, stream.bytes,
                                            stream.size.bytes(), memory_,
                                            static_cast<std::uint32_t>(stream.size.width)));
    }
    return {};
  }
  Result<Scene> read_scene() {
    if (model_) {
      SogSet set(memory_);
      set.count(*model_);
      STGS_TRY(set.read(*model_));
      return set.finish(nullptr);
    }
    ReadLimits limits = import_limits();
    limits.max_memory = memory_.available();
    const auto source = memory_source(std::move(file_), name_);
    return has_ending(name_, ".spz") ? read_spz(*source, limits) : read_ply(*source, limits);
  }

  std::string name_;
  Bytes file_;
  ImportMemory memory_;
  Lease lease_;                               // of the file
  std::unique_ptr<web::ZipMembers> members_;  // of a bundle, until its model is open
  std::optional<SogModel> model_;             // of a bundle
};

Bytes input, output;
std::optional<Import> import;

// Returns the message of a failed step to the host, or null.
template <typename Step>
const char* attempt(const Step& step) {
  try {
    const Status status = step();
    return status.ok() ? nullptr : web::give(status.message());
  } catch (const std::exception&) {
    return web::give("not enough memory in the browser; use 'stgs convert'");
  }
}

Status convert() {
  STGS_ASSIGN(output, import->convert());
  return {};
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

// The steps. Each returns null on success, or an error message.
STGS_EXPORT const char* stgs_import_unpack(std::uint32_t file_bytes) {
  return attempt([&] {
    const std::string name(reinterpret_cast<const char*>(input.data()) + file_bytes);
    input.resize(file_bytes);
    import.emplace(std::move(input), name);
    return import->unpack();
  });
}
STGS_EXPORT const char* stgs_import_open() {
  return attempt([] { return import->open(); });
}
STGS_EXPORT const char* stgs_import_convert() {
  return attempt(convert);
}

// Returns the next task of the host; null if none is left.
STGS_EXPORT const web::DecodeTask* stgs_import_task() {
  return web::host_decoding().next();
}

// The .stgs file, after stgs_import_convert() has succeeded.
STGS_EXPORT const std::uint8_t* stgs_import_data() {
  return output.data();
}
STGS_EXPORT std::uint32_t stgs_import_bytes() {
  return static_cast<std::uint32_t>(output.size());
}
