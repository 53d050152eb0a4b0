// SPDX-License-Identifier: Apache-2.0
// Records of the body besides segments: importance (5.11), steps, and those that a scene cannot
// represent (3.5).
#include <algorithm>
#include <cmath>

#include "interchange/stgs1/file.h"

namespace stgs::stgs1 {
namespace {

constexpr const char* kStepsName = "stgs.quantisation";
constexpr std::uint32_t kImportanceRecord = tag("IMPO"), kStepsRecord = tag("quan");

// Returns the record at `at`, before the end of the complete content.
Result<Record> tail_record(const File& file, std::uint64_t at) {
  STGS_ASSIGN(const std::optional<Record> record, record_at(file.source, at, file.end));
  if (record) return *record;
  return invalid_file("the records after the segments are damaged or missing [byte {}]", at);
}

// Returns the payload of the first record with this tag, and flags 0, after the segments.
Result<std::optional<ChargedBytes>> find_payload(const File& file, std::uint32_t wanted) {
  for (std::uint64_t at = file.body_at; at < file.end;) {
    STGS_ASSIGN(const Record record, tail_record(file, at));
    at = record.end();
    if (record.tag != wanted || record.flags != 0) continue;
    if (!file.has({record.payload(), record.length})) {
      return invalid_file("record '{}' is missing, the file is truncated", text_of(wanted));
    }
    ChargedBytes payload;
    STGS_ASSIGN(payload.lease, file.memory.take(record.length, "the bytes of a record"));
    STGS_TRY(read_bytes(file.source, record.payload(), record.length, payload.value));
    if (checksum(payload.value) == record.checksum) {
      return std::optional<ChargedBytes>(std::move(payload));
    }
    return invalid_file("record '{}' is damaged [byte {}]", text_of(wanted), record.offset);
  }
  return std::optional<ChargedBytes>();
}

// Reads the fields of Scene::quantisation, and checks each number by itself.
class StepsReader {
 public:
  explicit StepsReader(View payload) : in_(payload) {}

  std::optional<Quantisation> read() {
    if (in_.string() != kStepsName) return {};
    Quantisation out;
    LifespanRounding& lifespans = out.lifespans;
    for (double* v :
         {&out.quality, &out.longest_part, &lifespans.time, &lifespans.lifespan, &lifespans.motion,
          &lifespans.opacity, &lifespans.edge, &out.near_distance, &out.near_displacement}) {
      *v = number(in_.f64());
    }
    for (float& v : out.middle) v = number(in_.f32());
    out.opacity = step();
    out.graded = in_.u8() != 0;
    out.bounds.resize(in_.u8());
    for (float& v : out.bounds) v = number(in_.f32());
    out.tiers.resize(out.bounds.size() + 1);
    for (TierSteps& tier : out.tiers) {
      for (Step* s : {&tier.position, &tier.displacement, &tier.log_scale, &tier.rotation}) {
        *s = step();
      }
      for (Step& s : tier.sh) s = step();
    }
    if (!in_.ok() || in_.left() != 0 || !is_good_ || !is_valid(out)) return {};
    return out;
  }

 private:
  template <typename T>
  T number(T v) {
    is_good_ = is_good_ && std::isfinite(v);
    return v;
  }

  Step step() {
    Step s;
    s.exponent = in_.i8();
    s.multiplier = in_.u8();
    is_good_ = is_good_ && s.exponent >= -100 && s.exponent <= 100 && s.multiplier % 2 == 1;
    return s;
  }

  ByteReader in_;
  bool is_good_ = true;
};

}  // namespace

Result<Charged<std::vector<float>>> read_importance(const File& file) {
  STGS_ASSIGN(const std::optional<ChargedBytes> payload, find_payload(file, kImportanceRecord));
  Charged<std::vector<float>> out;
  if (!payload) return out;
  const Bytes& bytes = payload->value;
  if (bytes.size() / 4 != file.primitives || bytes.size() % 4 != 0) {
    return invalid_file("the importance has {} bytes for {} primitives", bytes.size(),
                        file.primitives);
  }
  STGS_ASSIGN(out.lease, file.memory.take(bytes.size(), "the importances of primitives"));
  ByteReader in(bytes);
  out.value.resize(bytes.size() / 4);
  for (float& v : out.value) v = in.f32();
  const bool is_valid_range = std::all_of(out.value.begin(), out.value.end(),
                                          [](float v) { return std::isfinite(v) && v >= 0; });
  if (!is_valid_range) return invalid_file("an importance is negative or not finite");
  return out;
}

Result<std::optional<Quantisation>> read_steps(const File& file) {
  STGS_ASSIGN(const std::optional<ChargedBytes> payload, find_payload(file, kStepsRecord));
  return payload ? StepsReader(payload->value).read() : std::nullopt;
}

Status count_omitted(File& file) {
  std::vector<Location> gaps = file.gaps;
  gaps.push_back({file.body_at, file.end - file.body_at});
  for (const Location& gap : gaps) {
    const std::uint64_t end = gap.offset + gap.bytes;
    for (std::uint64_t at = gap.offset; at < end;) {
      STGS_ASSIGN(const std::optional<Record> record, record_at(file.source, at, end));
      if (!record) break;
      const bool is_held = record->tag == kImportanceRecord || record->tag == kStepsRecord ||
                           record->tag == tag("COPY");
      if (!is_held && (record->flags & kCriticalFlag) == 0) {
        file.omit(fmt::format("record '{}'", text_of(record->tag)), kRecord + record->length);
      }
      at = record->end();
    }
  }
  return {};
}

}  // namespace stgs::stgs1
