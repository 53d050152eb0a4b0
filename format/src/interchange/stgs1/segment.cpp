// SPDX-License-Identifier: Apache-2.0
// Clauses 6 and 7.2: from SEGM records to planes.
#include <algorithm>

#include "codec/draco_points.h"
#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr int kOwnLayout = 65535;  // 6.1
constexpr std::size_t kMaxOwnTables = 256;
// Memory of Draco for a point, and of its keys: points of 12 bytes as integers and as values, an
// index, and the bits of the coordinates, which are at most as many.
constexpr std::uint64_t kDracoScratch = 64;
constexpr std::uint16_t kLossless = 0, kQuantised = 1;  // profiles, 4.2

// An opened record of a segment (6.1).
struct OpenRecord {
  Bytes payload;
  Lease lease;  // of the payload, an own layout and the planes
  LayoutSet own;
  const LayoutSet* set = nullptr;  // null: own
  std::size_t number = 0;          // of the layout
  bool omits_sh = false;
  std::uint64_t first_key = 0, planes_sum = 0;
  std::vector<View> stored;  // of each stream
  View group;
  bool has_group = false;

  const std::vector<Table>& tables() const { return set != nullptr ? set->tables : own.tables; }
  std::span<const Stream> streams() const { return (set != nullptr ? set : &own)->streams(number); }
};

class TierDecoder {
 public:
  TierDecoder(const File& file, const Tier& tier) : file_(file), tier_(tier) {}

  Result<Charged<Gaussians4D>> decode(Status& sh_status, std::vector<std::uint16_t>& skipped) {
    Charged<Gaussians4D> out;
    Gaussians4D& set = out.value;
    OpenRecord base, sh;
    STGS_TRY(open(tier_.base, 0, base));
    const bool is_separate = tier_.sh.bytes > 0;
    if (is_separate && file_.degree == 0) {
      return invalid_file("SH in a separate record in a file of degree 0");
    }
    if (file_.degree > 0 && base.omits_sh != is_separate) {
      return invalid_file("its SH are stored twice or not at all");
    }
    STGS_TRY(check_sizes(base));
    set.sh_degree = file_.degree;
    STGS_ASSIGN(out.lease, file_.memory.take_set(tier_.primitives, file_.degree));
    set.resize(tier_.primitives);
    STGS_TRY(decode_record(base, set));
    if (is_separate) {
      sh_status = decode_sh(sh, set);
      if (!sh_status.ok()) clear_sh(set);
    }
    for (const OpenRecord* record : {&base, &sh}) {
      if (record->payload.empty()) continue;
      for (const Stream& s : record->streams()) {
        if (s.is_optional()) skipped.push_back(s.attribute);
      }
    }
    return out;
  }

 private:
  // Charges bytes to the lease of a record.
  Status take(std::uint64_t bytes, OpenRecord& record) {
    return file_.memory.grow(record.lease, record.lease.bytes() + bytes, "the bytes of a segment");
  }

  // Reads a record and checks everything but its streams.
  Status open(const Location& at, int content, OpenRecord& out) {
    Bytes payload;
    STGS_TRY(read_payload(at, payload, out));
    ByteReader in(payload);
    const int level = static_cast<std::int16_t>(in.u16());
    const int layer = in.u16();
    const std::uint32_t slot = in.u32(), n = in.u32();
    const int number = in.u16();
    out.planes_sum = in.u64();
    if (!in.ok() || level != tier_.level || layer != 256 * content + tier_.number ||
        slot != tier_.slot || n != tier_.primitives) {
      return invalid_file("the record differs from its entry in the index [byte {}]", at.offset);
    }
    const bool is_own = number == kOwnLayout;
    if (is_own) {
      Lease tables;
      STGS_TRY(read_layouts(in, file_.memory, kMaxOwnTables, out.own, tables));
      out.lease.merge(std::move(tables));
      if (out.own.ends.size() != 1) return invalid_file("the record has no single own layout");
    }
    const LayoutSet& set = is_own ? out.own : file_.layouts;
    out.number = is_own ? 0 : static_cast<std::size_t>(number);
    if (out.number >= set.ends.size()) return invalid_file("layout {} does not exist", number);
    const auto problem = set.problems.find(out.number);
    if (problem != set.problems.end()) return problem->second;
    const std::span<const Stream> streams = set.streams(out.number);
    if (is_own) STGS_TRY(check_own_tables(set));
    STGS_TRY(check_streams(streams, content, out.omits_sh));
    STGS_TRY(locate(set, streams, in, out));
    if (!is_own) out.set = &file_.layouts;
    out.payload = std::move(payload);  // the views of its bytes stay valid
    return {};
  }

  Status read_payload(const Location& at, Bytes& payload, OpenRecord& out) {
    if (!file_.has(at)) return invalid_file("it is missing, the file is truncated");
    STGS_TRY(take(at.bytes, out));
    const std::uint64_t end = at.offset + at.bytes;
    STGS_ASSIGN(const std::optional<Record> record, record_at(file_.source, at.offset, end));
    if (!record || record->tag != tag("SEGM") || record->end() != end) {
      return invalid_file("its record header is damaged [byte {}]", at.offset);
    }
    if (record->flags != kCriticalFlag) {
      return (record->flags & kCriticalFlag) != 0
                 ? unsupported("its record has unknown flags {:#x}", record->flags)
                 : invalid_file("its record is not marked critical [byte {}]", at.offset);
    }
    STGS_TRY(read_bytes(file_.source, record->payload(), record->length, payload));
    if (checksum(payload) == record->checksum) return {};
    return invalid_file("its record is damaged [byte {}]", at.offset);
  }

  static Status check_own_tables(const LayoutSet& set) {
    std::vector<bool> is_named(set.tables.size());
    for (const Stream& s : set.rows) {
      for (const std::uint16_t t : s.tables) is_named[t] = true;
    }
    const bool all = std::find(is_named.begin(), is_named.end(), false) == is_named.end();
    return all ? Status() : invalid_file("its layout has a table that no plane uses");
  }

  // Checks that the streams are those of the content (5.7, 6.4) and the profile (8.1).
  Status check_streams(std::span<const Stream> streams, int content, bool& omits_sh) const {
    std::vector<std::uint16_t> have, base, rest;
    for (const Stream& s : streams) {
      if (s.is_optional()) continue;
      if (!s.known) {
        return unsupported("unknown attribute {} with mapping {}, prediction {} and coder {}",
                           s.attribute, s.mapping, s.prediction, s.coder);
      }
      if ((s.mapping != 0 && file_.profile == kLossless) ||
          (s.coder == kDraco && file_.profile <= kQuantised)) {
        return invalid_file("the file's profile does not allow mapping {} with coder {}", s.mapping,
                            s.coder);
      }
      have.push_back(s.attribute);
    }
    for (std::uint16_t a = kPosition; a <= kSh0; ++a) base.push_back(a);
    for (int d = 1; d <= file_.degree; ++d) rest.push_back(static_cast<std::uint16_t>(kSh0 + d));
    omits_sh = content == 0 && have == base;
    if (content == 0) base.insert(base.end(), rest.begin(), rest.end());
    if (omits_sh || have == (content == 0 ? base : rest)) return {};
    return invalid_file("its layout does not have the attributes of its content");
  }

  // Locates the stored bytes of all streams.
  Status locate(const LayoutSet& set, std::span<const Stream> streams, ByteReader& in,
                OpenRecord& out) {
    bool has_key = false, has_stored = false;
    for (const Stream& s : streams) {
      has_key = has_key || (s.prediction == kMorton && !s.is_optional());
      out.has_group = out.has_group || s.coder == kRans;
      const auto coded = std::count_if(s.tables.begin(), s.tables.end(), [&set](std::uint16_t t) {
        return !set.tables[t].is_single;
      });
      STGS_TRY(take(std::uint64_t{tier_.primitives} *
                        (s.coder == kRans ? static_cast<std::size_t>(coded) : s.planes()),
                    out));
      has_stored = has_stored || s.coder == kStored;
      if (s.coder == kDraco) STGS_TRY(take(kDracoScratch * tier_.primitives, out));
    }
    if (has_stored) STGS_TRY(take(kZstdScratch, out));  // one stream after the other
    if (has_key) out.first_key = in.u64();
    std::vector<std::uint64_t> sizes;
    for (const Stream& s : streams) sizes.push_back(s.coder == kRans ? 0 : in.u64());
    for (const std::uint64_t size : sizes) out.stored.push_back(in.bytes(size));
    if (out.has_group) out.group = in.bytes(in.left());
    if (in.ok() && in.left() == 0) return {};
    return invalid_file("its streams do not fill its record");
  }

  // Compares the sizes of all streams with the primitives (7.2).
  Status check_sizes(const OpenRecord& record) const {
    const std::span<const Stream> streams = record.streams();
    for (std::size_t i = 0; i < streams.size(); ++i) {
      const Stream& s = streams[i];
      if (s.is_optional() || s.coder == kRans) continue;
      if (s.coder == kStored) {
        STGS_TRY(check_stored(record.stored[i], s.planes() * std::uint64_t{tier_.primitives}));
        continue;
      }
      STGS_TRY(check_draco());
      if (!draco_fits(record.stored[i], tier_.primitives)) {
        return invalid_file("its Draco point cloud has an invalid header");
      }
    }
    return record.has_group ? check_group(record.group, tier_.primitives) : Status();
  }

  Status decode_sh(OpenRecord& record, Gaussians4D& set) {
    STGS_TRY(open(tier_.sh, 1, record));
    STGS_TRY(check_sizes(record));
    return decode_record(record, set);
  }

  // Decodes the streams of a record whose sizes have been checked.
  Status decode_record(const OpenRecord& record, Gaussians4D& set) const {
    const std::span<const Stream> streams = record.streams();
    const std::size_t n = tier_.primitives;
    std::vector<Plane> planes;
    std::size_t stored = 0;  // planes other than those of one symbol
    for (const Stream& s : streams) {
      for (std::size_t p = 0; p < s.planes(); ++p) {
        const Table* const table = s.coder == kRans ? &record.tables()[s.tables[p]] : nullptr;
        const bool is_single = table != nullptr && table->is_single;
        planes.push_back(is_single ? Plane{&table->only, 0} : Plane{});
        stored += is_single ? 0 : 1;
      }
    }
    Bytes symbols(stored * n);
    STGS_TRY(decode_planes(record, symbols, planes));
    if (checksum(symbols) != record.planes_sum) {
      return invalid_file("its decoded planes have another checksum");
    }
    const ScenePart& part = file_.parts[tier_.part];
    const MappingInput input{tier_.primitives, record.first_key, tier_.begin,
                             part.end_ticks - part.begin_ticks};
    std::span<const Plane> left = planes;
    for (const Stream& s : streams) {
      if (s.is_optional()) continue;
      STGS_TRY(map_stream(s, left.first(s.planes()), input, set));
      left = left.subspan(s.planes());
    }
    return {};
  }

  // Decodes the planes without a location into `symbols`, and sets their locations.
  Status decode_planes(const OpenRecord& record, std::span<std::uint8_t> symbols,
                       std::vector<Plane>& planes) const {
    const std::span<const Stream> streams = record.streams();
    const std::size_t n = tier_.primitives;
    std::vector<const Table*> tables;
    std::vector<std::uint8_t*> coded;
    std::size_t plane = 0, at = 0;
    for (std::size_t i = 0; i < streams.size(); ++i) {
      const Stream& s = streams[i];
      const std::size_t begin = at;
      for (std::size_t p = 0; p < s.planes(); ++p, ++plane) {
        if (planes[plane].data != nullptr) continue;
        planes[plane].data = symbols.data() + at;
        if (s.coder == kRans) {
          tables.push_back(&record.tables()[s.tables[p]]);
          coded.push_back(symbols.data() + at);
        }
        at += n;
      }
      if (s.is_optional() || s.coder == kRans) continue;
      const std::span<std::uint8_t> out = symbols.subspan(begin, at - begin);
      if (s.coder == kStored) {
        STGS_TRY(unpack(record.stored[i], out));
      } else if (const char* problem = draco_decode(record.stored[i], n, out)) {
        return invalid_file("{}", problem);
      }
    }
    return record.has_group ? decode_group(record.group, tier_.primitives, tables, coded)
                            : Status();
  }

  static void clear_sh(Gaussians4D& set) {
    const std::size_t stride = 3 * static_cast<std::size_t>(set.sh_coefficients());
    for (std::size_t i = 0; i < set.size(); ++i) {
      std::fill_n(set.sh.begin() + static_cast<std::ptrdiff_t>(i * stride + 3), stride - 3, 0.0f);
    }
  }

  const File& file_;
  const Tier& tier_;
};

}  // namespace

Result<Charged<Gaussians4D>> decode_tier(const File& file, const Tier& tier, Status& sh_status,
                                         std::vector<std::uint16_t>& skipped) {
  sh_status = {};
  return TierDecoder(file, tier).decode(sh_status, skipped);
}

}  // namespace stgs::stgs1
