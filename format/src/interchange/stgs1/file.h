// SPDX-License-Identifier: Apache-2.0
// Header, records, metadata and index of a file (clauses 2 to 5).
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "interchange/import_memory.h"
#include "interchange/stgs1/layouts.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/scene_file.h"

namespace stgs::stgs1 {

inline constexpr std::array<std::uint8_t, 8> kFileMagic = {0x89, 'S',  'T',  'G',
                                                           0x0D, 0x0A, 0x1A, 0x0A};  // 2.1
inline constexpr std::uint64_t kHeader = 40, kRecord = 32;  // bytes of the headers, 2.2 and 3.1
inline constexpr std::uint32_t kCriticalFlag = 1;           // of a record, 3.2
inline constexpr double kTimeGrain = 0x1p-20, kMaxTime = 0x1p32;  // ticks, 5.2 and 5.3

constexpr std::uint32_t tag(const char (&text)[5]) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value |= std::uint32_t(static_cast<unsigned char>(text[i])) << 8 * i;
  return value;
}
// Returns a tag as text for messages.
std::string text_of(std::uint32_t tag);

struct Header {  // 2.2
  std::uint16_t major = 0, minor = 0;
  std::uint32_t flags = 0;
  std::uint64_t file_bytes = 0, head_bytes = 0;

  bool is_growing() const { return (flags & 1) != 0; }
};

struct Record {  // 3.1
  std::uint64_t offset = 0;
  std::uint32_t tag = 0, flags = 0;
  std::uint64_t length = 0, checksum = 0;  // of the payload

  std::uint64_t payload() const { return offset + kRecord; }
  std::uint64_t end() const { return payload() + length; }
};

// The range of a record in the file, including its header. 0 bytes: there is none.
struct Location {
  std::uint64_t offset = 0, bytes = 0;
};

// The primitives of one tier of a segment (5.3, 5.7).
struct Tier {
  std::uint32_t part = 0;
  int level = 0;  // -1: persistent
  std::uint32_t slot = 0;
  int number = 0;
  std::uint32_t primitives = 0;
  double begin = 0;  // of the segment's interval, ticks from the beginning of the part (5.4)
  Location base, sh;
};

// Records that a Scene cannot represent.
struct Omitted {
  std::uint64_t records = 0, bytes = 0;
};

struct File {
  const ByteSource& source;
  ImportMemory& memory;
  std::uint16_t minor = 0;
  bool is_growing = false;
  std::uint64_t head_bytes = 0;
  std::uint64_t end = 0;      // of the complete content, which a truncated source does not reach
  std::uint64_t body_at = 0;  // end of the last record that the index lists
  SceneMetadata metadata = {};
  int degree = 0;
  std::uint16_t profile = 0;
  LayoutSet layouts = {};
  double chunk = 0;  // ticks; 0: no index has been read
  std::vector<ScenePart> parts = {};
  std::vector<Tier> tiers = {};
  std::uint64_t primitives = 0;
  std::uint64_t entries = 0;  // of the index: parts, tiers, further records
  Lease entries_lease = {}, layouts_lease = {};
  std::vector<Location> gaps = {};  // ranges of the body that may have records of other tags
  std::map<std::string, Omitted> omitted = {};
  std::vector<std::string> damage = {};  // errors after which reading continues
  std::vector<std::string> notes = {};   // other findings

  bool has(const Location& at) const {
    return at.offset <= source.size() && at.bytes <= source.size() - at.offset;
  }
  void omit(const std::string& name, std::uint64_t bytes) {
    Omitted& all = omitted[name];
    ++all.records;
    all.bytes += bytes;
  }
};

// Returns the XXH3-64 of the bytes (1.5).
std::uint64_t checksum(View bytes);
// Reads bytes of the source, which the caller charges.
Status read_bytes(const ByteSource& source, std::uint64_t offset, std::uint64_t count, Bytes& out);
// Returns the header of a file, or nothing if its magic or checksum is wrong.
std::optional<Header> valid_header(View bytes);
// Returns the record whose header begins `bytes`; nothing if the header is truncated or damaged, or
// if the record extends past `end`. `offset` and `end` are bytes of the file.
std::optional<Record> parse_record(View bytes, std::uint64_t offset, std::uint64_t end);
// As above, from the source.
Result<std::optional<Record>> record_at(const ByteSource& source, std::uint64_t offset,
                                        std::uint64_t end);
// Returns whether all records of a head are intact (3.6).
bool is_intact_head(View head);

// Opens a file: reads its head, or its copy, and the index. `file` has source and limits.
Status open_stgs1(File& file);
// Returns the head in the usable copy of a damaged one (3.6). `first`: the header as stored.
Result<std::optional<ChargedBytes>> find_head_copy(const File& file, View first);
// Read META, and WNDW or PRIV (4.2, 4.5, 3.5).
Status read_metadata(View payload, File& file);
Status read_window(View payload, SceneMetadata& metadata);
Status check_private_names(View payload);
// Checks the bounds (4.3).
Status check_bounds(const SceneMetadata& metadata);
// Adds the index in the payload of INDX or FRAG (5.2). Its records begin at `at` and end at or
// before `end`.
Status read_index(View payload, std::uint64_t at, std::uint64_t end, File& file);
// Reads the index of a growing file whose head has been read (5.12). `head_sum`: checksum of it.
Status read_fragments(File& file, std::uint64_t head_sum);
// Returns the bytes of the floats of `count` primitives.
inline std::uint64_t float_bytes(const File& file, std::uint64_t count) {
  return 4 * static_cast<std::uint64_t>(17 + 3 * (file.degree + 1) * (file.degree + 1)) * count;
}

// Decodes a tier of the index, and charges its memory; times count from the beginning of its part.
// If its SH record alone cannot be read, SH above degree 0 are 0 and `sh_status` has the reason.
// `skipped` receives the attributes that were skipped (6.5).
Result<Charged<Gaussians4D>> decode_tier(const File& file, const Tier& tier, Status& sh_status,
                                         std::vector<std::uint16_t>& skipped);

// Reads Scene::importance from the first IMPO record after the segments (5.11); empty if there is
// none.
Result<Charged<std::vector<float>>> read_importance(const File& file);
// Reads Scene::quantisation from a private record after the segments, if there is a valid one.
Result<std::optional<Quantisation>> read_steps(const File& file);
// Counts the intact records of the body that a Scene cannot represent in file.omitted. Stops at
// damage.
Status count_omitted(File& file);

// Values of a record that its mapping depends on.
struct MappingInput {
  std::uint32_t n = 0;           // primitives
  std::uint64_t first_key = 0;   // 7.4
  double begin = 0, length = 0;  // of the segment, of the part; ticks
};
// A plane: the symbol of primitive i is data[i * stride]; the stride is 0 or 1.
struct Plane {
  const std::uint8_t* data = nullptr;
  std::size_t stride = 1;
};
// Decodes the planes of a stream (7.3 to 7.5) into its attribute of `set`, and checks the values.
// Attributes before it in the record must have been decoded.
Status map_stream(const Stream& stream, std::span<const Plane> planes, const MappingInput& input,
                  Gaussians4D& set);

}  // namespace stgs::stgs1
