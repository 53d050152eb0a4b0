// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_file.h"

#include <zlib.h>

#include <algorithm>

#include "interchange/import.h"
#include "stgs/format/fourdgs.h"

namespace stgs::fourdgs {
namespace {

constexpr std::size_t kChunkFields = 24, kDeltaFields = 51;
constexpr std::size_t kCrcBlock = 1 << 20;
// Memory of a record, while the list of them grows, and of an object. Of a map of strings for each
// byte of its text: an entry of 8 bytes takes 112 with two short strings.
constexpr std::uint64_t kRecordMemory = 3 * sizeof(BodyRecord), kObjectMemory = 64, kMapRatio = 14;

std::array<double, 3> read_vector(ByteReader& in) {
  std::array<double, 3> v{};
  for (double& c : v) c = in.f64();
  return v;
}

std::uint32_t checksum(std::uint32_t crc, View bytes) {
  return static_cast<std::uint32_t>(::crc32(crc, bytes.data(), static_cast<uInt>(bytes.size())));
}

// Reads one record after the other.
class Scanner {
 public:
  Scanner(const ByteSource& source, ImportMemory& memory, ConversionNotes* notes)
      : source_(source), memory_(memory), notes_(notes) {
    out_.file = source.name();
    out_.bytes = source.size();
  }

  Result<Contents> run() {
    STGS_TRY(check_magic());
    std::uint64_t at = kMagic.size();
    const std::uint64_t end =
        source_.size() - std::min<std::uint64_t>(source_.size(), kMagic.size());
    while (!footer_) {
      std::array<std::uint8_t, kRecordHead> head{};
      if (at > end || end - at < head.size()) return truncated();
      STGS_TRY(source_.read(at, head));
      ByteReader in(head);
      BodyRecord record;
      record.opcode = in.u8();
      record.offset = at;
      record.length = in.u64();
      if (record.length > end - at - head.size()) return truncated();
      STGS_TRY(take(record));
      at += head.size() + record.length;
    }
    std::array<std::uint8_t, kMagic.size()> magic{};
    if (at != end) {
      return invalid_file("{}: {} bytes after the last record", out_.file, end - at);
    }
    STGS_TRY(source_.read(at, magic));
    if (magic != kMagic) return truncated();
    STGS_TRY(check_complete());
    return std::move(out_);
  }

 private:
  Place here(const BodyRecord& record) const { return {out_.file, record.offset}; }

  Status truncated() const {
    return invalid_file("{}: the file is truncated (no footer in its {} bytes); copy it again",
                        out_.file, source_.size());
  }

  Status check_magic() const {
    std::array<std::uint8_t, kMagic.size()> magic{};
    if (source_.size() < magic.size()) return truncated();
    STGS_TRY(source_.read(0, magic));
    if (magic == kMagic) return {};
    if (is_4dgs(magic)) {
      return unsupported("{}: unsupported version of .4dgs (expected 1, got {})", out_.file,
                         short_text(std::string(1, static_cast<char>(magic[kVersionByte]))));
    }
    return invalid_file("{}: not a .4dgs file", out_.file);
  }

  Status take(const BodyRecord& record) {
    if (!has_header_ && record.opcode != kHeader) {
      return invalid_file("{}: the first record is not a header [byte {}]", out_.file,
                          record.offset);
    }
    switch (record.opcode) {
      case kHeader:
      case kQuantization:
      case kWindowTable:
      case kCamera:
      case kMetadata:
      case kFrame:
      case kObjectTrack:
      case kChunkIndex:
      case kFooter: {
        STGS_ASSIGN(const ChargedBytes content, read_body(source_, record, memory_));
        return parse(record, content.value);
      }
      case kChunk:
      case kDeltaChunk:
        return take_chunk(record);
      case kBand:
        if (out_.body.empty()) {
          return invalid_file("{}: an SH band before the first chunk [byte {}]", out_.file,
                              record.offset);
        }
        return append(record);
      case kStatistics:
      case kSummaryOffset:
        return {};
      case kAudio:
      case kAudioSource:
        ++out_.omitted.audio;
        return {};
      case kAudioData:
        return {};  // counted with its source
      case kAttachment:
        ++out_.omitted.attachments;
        return {};
      case kObjectTable:
        ++out_.omitted.objects;
        return {};
      default:
        ++(record.opcode >= 0x20 && record.opcode < 0x30 ? out_.omitted.provenance
                                                         : out_.omitted.unknown);
        return {};
    }
  }

  Status parse(const BodyRecord& record, View content) {
    switch (record.opcode) {
      case kHeader: {
        STGS_TRY(charge(2 * kMapRatio * content.size()));  // the attributes are metadata too
        STGS_TRY(first(has_header_, "header", record));
        STGS_ASSIGN(out_.header, parse_header(content, here(record)));
        for (const auto& [key, value] : out_.header.attributes) out_.metadata[key] = value;
        return {};
      }
      case kQuantization: {
        STGS_ASSIGN(const Lease parsed, memory_.take(kMapRatio * content.size(), "the metadata"));
        STGS_TRY(first(has_grid_, "quantisation record", record));
        STGS_ASSIGN(out_.grid, parse_quantization(content, here(record)));
        out_.grid.cutoff = out_.header.cutoff;
        return {};
      }
      case kWindowTable: {
        STGS_TRY(charge(content.size()));
        STGS_TRY(first(has_windows_, "window table", record));
        STGS_ASSIGN(out_.windows, parse_windows(content, here(record)));
        return {};
      }
      case kCamera:
        return parse_camera(record, content);
      case kMetadata: {
        STGS_TRY(charge(kMapRatio * content.size()));
        STGS_ASSIGN(const Lease parsed, memory_.take(kMapRatio * content.size(), "the metadata"));
        ByteReader in(content);
        in.string();  // its name
        bool ok = false;
        for (auto& [key, value] : read_map(in, ok)) out_.metadata.emplace(key, value);
        if (!ok) return invalid_file("{}: invalid metadata [byte {}]", out_.file, record.offset);
        return {};
      }
      case kFrame:
        return parse_frame(record, content);
      case kObjectTrack:
        return parse_track(record, content);
      case kChunkIndex:
        return check_index(record, content);
      default:
        return parse_footer(record, content);
    }
  }

  // Two records that describe the complete file could contradict each other.
  Status first(bool& seen, const char* name, const BodyRecord& record) const {
    if (seen) return invalid_file("{}: a second {} [byte {}]", out_.file, name, record.offset);
    seen = true;
    return {};
  }

  Status parse_camera(const BodyRecord& record, View content) {
    ByteReader in(content);
    CameraRecord camera;
    camera.fov_y = in.f64();
    camera.position = read_vector(in);
    camera.target = read_vector(in);
    camera.keyframes = in.u32();
    if (!in.ok()) return invalid_file("{}: invalid camera [byte {}]", out_.file, record.offset);
    out_.camera = camera;
    return {};
  }

  Status parse_frame(const BodyRecord& record, View content) {
    ByteReader in(content);
    const std::string name = in.string();
    FrameRecord frame;
    frame.left_handed = in.u8() == 2;
    const int up = in.u8(), forward = in.u8();
    in.u8();  // unit, a name for metres_per_unit
    frame.metres_per_unit = in.f64();
    if (!in.ok() || up > 5 || forward > 5 || up % 3 == forward % 3 ||
        !(frame.metres_per_unit >= 0 && std::isfinite(frame.metres_per_unit))) {
      return invalid_file(
          "{}: invalid coordinate frame (up {}, forward {}, {} m per unit) [byte {}]", out_.file,
          up, forward, frame.metres_per_unit, record.offset);
    }
    frame.up = up;
    if (!name.empty()) {
      ++out_.omitted.provenance;  // of something else than the scene
      return {};
    }
    if (out_.frame) {
      return invalid_file("{}: a second coordinate frame [byte {}]", out_.file, record.offset);
    }
    out_.frame = frame;
    return {};
  }

  Status parse_track(const BodyRecord& record, View content) {
    ByteReader in(content);
    const std::uint32_t object = in.u32();
    in.u8();  // interpolation
    const std::uint32_t samples = in.u32();
    if (!in.ok() || samples > in.left() / 64 || object == 0) {
      return invalid_file("{}: invalid object track (object {}, {} samples) [byte {}]", out_.file,
                          object, samples, record.offset);
    }
    bool moves = false;
    for (std::uint32_t i = 0; i < samples; ++i) {
      in.f64();  // time
      const auto axis = read_vector(in);
      in.f64();  // w: of either sign, and of any length
      const auto shift = read_vector(in);
      for (std::size_t c = 0; c < 3; ++c) moves |= axis[c] != 0 || shift[c] != 0;
    }
    if (!moves) return {};
    STGS_TRY(charge(kObjectMemory));
    out_.moving_objects.insert(object);
    return {};
  }

  Status take_chunk(BodyRecord record) {
    const bool is_delta = record.opcode == kDeltaChunk;
    if (!has_grid_) {
      return invalid_file("{}: a chunk before the quantisation record [byte {}]", out_.file,
                          record.offset);
    }
    if (is_delta && !out_.has_keyframes()) {
      return invalid_file("{}: a delta chunk in a file of temporal model {} [byte {}]", out_.file,
                          kBirth, record.offset);
    }
    Bytes fields(is_delta ? kDeltaFields : kChunkFields);
    if (record.length < fields.size()) {
      return invalid_file("{}: a chunk of {} bytes is too short [byte {}]", out_.file,
                          record.length, record.offset);
    }
    STGS_TRY(source_.read(record.offset + kRecordHead, fields));
    ByteReader in(fields);
    record.begin = in.f64();
    record.end = in.f64();
    record.level = in.u32();
    if (is_delta) {
      const int mode = in.u8();
      if (mode > 1) {
        return unsupported("{}: unknown mode {} of a delta chunk [byte {}]", out_.file, mode,
                           record.offset);
      }
      record.chained = mode == 1;
      record.reference = in.u64();
      record.keyframe = in.u64();
      record.depth = in.u16();
    }
    record.count = in.u32();
    if (is_delta) {
      record.births = in.u32();
      record.deaths = in.u32();
    }
    return append(record);
  }

  Status append(const BodyRecord& record) {
    STGS_TRY(charge(kRecordMemory));
    out_.body.push_back(record);
    return {};
  }

  // Charges bytes that the contents take in addition.
  Status charge(std::uint64_t bytes) {
    held_ += bytes;
    return memory_.grow(out_.lease, held_, "the records of the file");
  }

  // The index repeats fields of the chunks.
  Status check_index(const BodyRecord& record, View content) {
    ByteReader in(content);
    const double begin = in.f64(), end = in.f64();
    const std::uint64_t offset = in.u64(), length = in.u64();
    const std::uint32_t count = in.u32(), bands = in.u32();
    in.bytes(std::uint64_t{bands} * 17);
    if (!in.ok()) return invalid_file("{}: invalid index [byte {}]", out_.file, record.offset);
    const auto found = std::lower_bound(
        out_.body.begin(), out_.body.end(), offset,
        [](const BodyRecord& chunk, std::uint64_t at) { return chunk.offset < at; });
    const auto differs = [&](const char* field) {
      return invalid_file("{}: the index differs from the chunk at byte {} ({}) [byte {}]",
                          out_.file, offset, field, record.offset);
    };
    if (found == out_.body.end() || found->offset != offset || !found->is_chunk()) {
      return differs("no chunk");
    }
    const BodyRecord& chunk = *found;
    if (begin != chunk.begin || end != chunk.end) return differs("interval");
    if (length != chunk.length + kRecordHead) return differs("length");
    if (count != std::uint64_t{chunk.count} + chunk.births + chunk.deaths) return differs("count");
    if (!out_.has_keyframes() || in.left() == 0) return {};
    const bool is_delta = in.u8() == 1;
    const int mode = in.u8();
    const std::uint64_t reference = in.u64(), keyframe = in.u64();
    const std::uint32_t depth = in.u16();
    if (!in.ok() || is_delta != (chunk.opcode == kDeltaChunk)) return differs("kind");
    if (mode != (chunk.chained ? 1 : 0)) return differs("mode");
    if (reference != chunk.reference) return differs("reference");
    if (keyframe != (is_delta ? chunk.keyframe : chunk.offset)) return differs("keyframe");
    return depth == chunk.depth ? Status() : differs("depth");
  }

  Status parse_footer(const BodyRecord& record, View content) {
    ByteReader in(content);
    const std::uint64_t start = in.u64();
    in.u64();  // start of the summary offsets
    const std::uint32_t expected = in.u32();
    if (!in.ok() || start > record.offset) {
      return invalid_file("{}: invalid footer [byte {}]", out_.file, record.offset);
    }
    footer_ = true;
    if (start == 0 || expected == 0) return {};
    std::uint32_t crc = 0;
    STGS_ASSIGN(const Lease lease,
                memory_.take(std::min<std::uint64_t>(kCrcBlock, record.offset - start),
                             "the bytes of the index"));
    for (std::uint64_t at = start; at < record.offset;) {
      Bytes block(static_cast<std::size_t>(std::min<std::uint64_t>(kCrcBlock, record.offset - at)));
      STGS_TRY(source_.read(at, block));
      crc = checksum(crc, block);
      at += block.size();
    }
    if (crc != expected) {
      note(notes_, fmt::format("the checksum of the index is wrong (expected {:08x}, got {:08x}): "
                               "the file is damaged, and values may be wrong",
                               expected, crc));
    }
    return {};
  }

  Status check_complete() {
    if (!has_grid_) return invalid_file("{}: no quantisation record", out_.file);
    if (out_.windows.empty()) out_.windows.push_back({0, 0});
    if (out_.has_keyframes()) return {};
    std::uint64_t total = 0;
    for (const BodyRecord& record : out_.body) total += record.count;
    if (total == out_.header.gaussians) return {};
    return invalid_file("{}: Gaussians are missing (expected {}, got {} in the chunks)", out_.file,
                        out_.header.gaussians, total);
  }

  const ByteSource& source_;
  ImportMemory& memory_;
  ConversionNotes* notes_;
  Contents out_;
  std::uint64_t held_ = 0;  // bytes that the contents take
  bool has_header_ = false, has_grid_ = false, has_windows_ = false, footer_ = false;
};

}  // namespace

Result<Contents> read_contents(const ByteSource& source, ImportMemory& memory,
                               ConversionNotes* notes) {
  return Scanner(source, memory, notes).run();
}

Result<ChargedBytes> read_body(const ByteSource& source, const BodyRecord& record,
                               ImportMemory& memory) {
  ChargedBytes out;
  STGS_ASSIGN(out.lease, memory.take(record.length, "the bytes of a record"));
  out.value.resize(static_cast<std::size_t>(record.length));
  STGS_TRY(source.read(record.offset + kRecordHead, out.value));
  return out;
}

}  // namespace stgs::fourdgs
