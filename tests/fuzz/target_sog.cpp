// SPDX-License-Identifier: Apache-2.0
// Bundles of SOG, .sogst and .tsog: a zip archive of JSON and lossless WebP images, read from a
// path.
#include "../fixtures/sogst_fixture.h"
#include "../fixtures/temporary_folder.h"

#include <zlib.h>

#include <cstring>

#include "imported.h"
#include "stgs/format/timed_formats.h"
#include "webp_stream.h"
#include "zip_members.h"

using namespace stgs;
using namespace stgs::fuzz;

namespace {

constexpr std::uint32_t kLocal = 0x04034B50, kCentral = 0x02014B50;  // signatures of zip

// One file per process, because libzip reads only from files.
const std::string& input_path() {
  static const testing::TemporaryFolder folder;
  static const std::string path = folder / "input.sog";
  return path;
}

std::string read_input() {
  std::ifstream file(input_path(), std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Stores the members uncompressed, so that a changed byte changes one byte of an image.
Bytes bundle(const testing::SogModel& model) {
  const std::map<std::string, std::string> members = model.all_files();
  std::filesystem::remove(input_path());
  zip_t* const archive = zip_open(input_path().c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  for (const auto& [name, bytes] : members) {
    zip_source_t* const source = zip_source_buffer(archive, bytes.data(), bytes.size(), 0);
    const auto index = static_cast<zip_uint64_t>(zip_file_add(archive, name.c_str(), source, 0));
    zip_set_file_compression(archive, index, ZIP_CM_STORE, 0);
    zip_file_set_mtime(archive, index, 0, 0);
  }
  zip_close(archive);
  const std::string bytes = read_input();
  return {bytes.begin(), bytes.end()};
}

std::vector<Bytes> seeds() {
  testing::SogModel small = testing::random_sog(3, 0, 1, 2);
  const testing::SogModel with_sh = testing::random_sog(9, 1, 2, 3);
  return {bundle(small), bundle(with_sh), bundle(testing::random_sogst(3, 0, 2, 3, 1, 2)),
          bundle(testing::streamed(testing::random_sogst(9, 1, 1, 4))),
          bundle(testing::continuous_tsog(3, 0, 2, 5))};
}

std::uint32_t get_u32(View bytes, std::size_t at) {
  std::uint32_t v = 0;
  if (at + sizeof v <= bytes.size()) std::memcpy(&v, &bytes[at], sizeof v);
  return v;
}
std::uint16_t get_u16(View bytes, std::size_t at) {
  std::uint16_t v = 0;
  if (at + sizeof v <= bytes.size()) std::memcpy(&v, &bytes[at], sizeof v);
  return v;
}

// Returns the offset of the content of the member whose local header is at `at`.
std::size_t content_offset(View zip, std::size_t at) {
  return at + 30 + get_u16(zip, at + 26) + get_u16(zip, at + 28);
}

// Member headers, and the beginning of the content.
std::vector<Unit> units(View zip) {
  std::vector<Unit> out;
  for (std::size_t at = 0; at + 30 <= zip.size(); ++at) {
    if (get_u32(zip, at) != kLocal && get_u32(zip, at) != kCentral) continue;
    out.push_back({at, std::min(at + 46, zip.size())});
    const std::size_t content = content_offset(zip, at);
    if (get_u32(zip, at) == kLocal && content < zip.size())
      out.push_back({content, std::min(zip.size(), content + 200)});
  }
  return out;
}

// Repairs the CRCs of stored members in both headers.
Bytes repair(Bytes zip, Repair repair) {
  if (repair == Repair::kNothing) return zip;
  for (std::size_t at = 0; at + 46 <= zip.size(); ++at) {
    if (get_u32(zip, at) != kCentral) continue;
    const std::size_t local = get_u32(zip, at + 42), size = get_u32(zip, at + 20);
    if (get_u32(zip, local) != kLocal) continue;
    const std::size_t content = content_offset(zip, local);
    if (content > zip.size() || size > zip.size() - content) continue;
    const auto crc =
        static_cast<std::uint32_t>(crc32(0, zip.data() + content, static_cast<uInt>(size)));
    std::memcpy(&zip[at + 16], &crc, sizeof crc);
    if (local + 18 <= zip.size()) std::memcpy(&zip[local + 14], &crc, sizeof crc);
  }
  return zip;
}

// The readers of the page for browsers, without the content of deflated members.
void read_as_page(View bundle) {
  ImportMemory memory(kImportLimits, "input");
  web::HostDecoding decoding;
  const auto members = web::ZipMembers::open(bundle, "input", decoding, memory);
  if (!members.ok()) return;
  for (const char* name : {"meta.json", "l.webp", "sh0.webp", "centroids.webp"}) {
    const auto content = (*members)->content(name);
    if (!content.ok()) continue;
    const auto stream = web::lossless_webp_stream(*content, name);
    const auto size = lossless_webp_size(*content, name);
    if (stream.ok() && size.ok()) require(stream->size == *size, "libwebp reads the same size");
  }
}

}  // namespace

const Target stgs::fuzz::kTarget{"sog", seeds, nullptr, repair, units, import_memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::ofstream(input_path(), std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  read_as_page({data, size});
  ConversionNotes notes;
  check_import(read_sog(input_path(), kImportLimits, &notes));
  CurveReport report;
  check_import(read_sogst(input_path(), {}, kImportLimits, &report, &notes));
  require(report.opacity_max >= 0 && report.opacity_max <= 1, "the report is in range");
  check_import(read_tsog(input_path(), {}, kImportLimits, &notes));
  return 0;
}
