// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <bit>
#include <exception>

#include "scene_write.h"
#include "segmenter.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

// What the index tells of an appended stretch.
struct Stretch {
  PartEntry part;
  std::vector<SegmentEntry> segments;  // of part 0
  std::vector<AttributeBytes> attributes;
  std::uint64_t primitives = 0;
  std::uint64_t fragment = 0, fragment_bytes = 0;  // its FRAG record
};

// The index of successive stretches.
std::vector<std::uint8_t> index_of(std::span<const Stretch> stretches, double chunk_ticks) {
  FileIndex index;
  index.chunk_ticks = chunk_ticks;
  std::vector<PartEntry> parts;
  for (const Stretch& stretch : stretches) {
    for (SegmentEntry segment : stretch.segments) {
      segment.part = static_cast<std::uint32_t>(parts.size());
      index.segments.push_back(segment);
    }
    parts.push_back(stretch.part);
    index.primitives += stretch.primitives;
    if (index.attributes.empty())
      index.attributes = stretch.attributes;
    else
      for (std::size_t a = 0; a < stretch.attributes.size(); ++a) {
        index.attributes[a].bytes += stretch.attributes[a].bytes;
      }
  }
  return write_index(index, parts);
}

// The bytes of each attribute in `all` beyond those in `before`.
std::vector<AttributeBytes> totals_beyond(const std::vector<AttributeBytes>& all,
                                          const std::vector<AttributeBytes>& before) {
  std::vector<AttributeBytes> out = all;
  for (AttributeBytes& row : out) {
    for (const AttributeBytes& other : before) {
      if (other.attribute == row.attribute) row.bytes -= other.bytes;
    }
  }
  return out;
}

// What a recorder knew when it had written these complete fragments. Of attributes it is enough
// to know what each fragment of the index lists: a later one lists several of them, or none.
std::vector<Stretch> stretches_of(const FileHead& head) {
  std::vector<Stretch> out(head.parts.size());
  for (std::size_t p = 0; p < out.size(); ++p) out[p].part = head.parts[p];
  for (SegmentEntry segment : head.index.segments) {
    Stretch& stretch = out[segment.part];
    stretch.primitives += segment.base.primitives;
    stretch.segments.push_back(std::move(segment));
  }
  std::uint64_t at = head.header.head_bytes;
  for (std::size_t p = 0; p < out.size(); ++p) {
    at += out[p].part.skip;
    for (const IndexEntry* record : records_of(out[p].segments)) at += record->bytes;
    out[p].fragment = at;
    out[p].fragment_bytes = p + 1 < out.size() ? out[p + 1].part.skip : 0;
  }
  const std::vector<FragmentEntry>& fragments = head.fragments;
  out.back().fragment_bytes = fragments.back().bytes;
  for (std::size_t f = 0; f < fragments.size(); ++f) {
    const auto& all = f + 1 < fragments.size() ? fragments[f + 1].before : head.index.attributes;
    out[fragments[f].first_part].attributes = totals_beyond(all, fragments[f].before);
  }
  for (Stretch& stretch : out) {
    if (stretch.attributes.empty())
      stretch.attributes = totals_beyond(head.index.attributes, head.index.attributes);
  }
  return out;
}

class Recorder final : public SceneRecorder {
 public:
  Recorder(const FileMetadata& metadata, const RecordSettings& settings)
      : metadata_(metadata), settings_(settings) {
    settings_.write.own_layouts = true;
  }

  Status create(const std::string& path) {
    std::vector<std::uint8_t> records = write_head_records(metadata_, {});
    FileHeader header;
    header.flags = kGrowing;
    header.head_bytes = kHeaderBytes + records.size();
    std::vector<std::uint8_t> head = write_header(header);
    head.insert(head.end(), records.begin(), records.end());
    head_checksum_ = checksum(head);
    STGS_TRY(file_.create(path));
    return append_bytes(head);
  }

  // Goes on with a file whose complete fragments are `head`; what follows them is cut off.
  Status resume(const std::string& path, const FileHead& head) {
    head_checksum_ = head.head_checksum;
    if (!head.fragments.empty()) {
      frames_ = head.metadata.scene.frames;
      chunk_ticks_ = head.index.chunk_ticks;
      has_bounds_ = head.index.primitives > 0;
      stretches_ = stretches_of(head);
    }
    return file_.extend(path, head.header.file_bytes);
  }

  Status append(const Gaussians4D& stretch, std::uint32_t end_frame,
                std::span<const float> importance) override {
    STGS_TRY(check_open());
    if (end_frame <= frames_) {
      return usage_error("{}: a stretch that ends at frame {} is appended to {} frames",
                         file_.path(), end_frame, frames_);
    }
    if (chunk_ticks_ > 0 && 2.0 * end_frame >= kMostSlots * chunk_ticks_) {
      return usage_error("{}: {} frames are too many for chunks of {} ticks", file_.path(),
                         end_frame, chunk_ticks_);
    }
    if (stretch.sh_degree != metadata_.sh_degree) {
      return usage_error("{}: a stretch of degree {} is appended to harmonics of degree {}",
                         file_.path(), stretch.sh_degree, metadata_.sh_degree);
    }
    try {
      return append_checked(stretch, end_frame, importance);
    } catch (const std::exception& e) {
      return runtime_error("{}: cannot append {} primitives: {}", file_.path(), stretch.size(),
                           e.what());
    }
  }

  Status close() override {
    STGS_TRY(check_open());
    open_ = false;
    FragmentHeader header = fragment_header(file_.bytes());
    header.flags = kFragmentClosed;
    if (frames_ == 0) header.frames = 1;  // nothing was appended
    if (!stretches_.empty()) header.before = stretches_.back().fragment;
    STGS_TRY(append_bytes(write_fragment(header, index_of(stretches_, chunk_or_one()))));
    return file_.close();
  }

  std::uint32_t frames() const override { return frames_; }
  std::uint64_t bytes() const override { return file_.bytes(); }

 private:
  Status check_open() const {
    if (open_) return {};
    return usage_error("{}: is closed, or an error has ended the recording", file_.path());
  }

  Status append_checked(const Gaussians4D& stretch, std::uint32_t end_frame,
                        std::span<const float> importance) {
    Scene scene;
    scene.metadata = metadata_.scene;
    scene.metadata.frames = end_frame;
    scene.gaussians = stretch;
    scene.importance.assign(importance.begin(), importance.end());
    scene.parts = {{static_cast<double>(frames_), static_cast<double>(end_frame), stretch.size()}};
    WriteSettings check = settings_.write;
    check.chunk_seconds = 0;  // was checked, and is not to be against the whole timeline
    STGS_TRY(check_scene(scene, check));
    STGS_ASSIGN(EncodedScene encoded, encode_records(scene, settings_.write, chunk_ticks_));
    chunk_ticks_ = encoded.body.index.chunk_ticks;
    add_bounds(encoded.metadata.scene, stretch.size() == 0);
    frames_ = end_frame;
    return write_stretch(encoded.body);
  }

  // The records, and the fragment of the index that makes them part of the file, in one write.
  Status write_stretch(Body& body) {
    Stretch stretch;
    stretch.part = body.parts.front();
    if (!stretches_.empty()) stretch.part.skip = stretches_.back().fragment_bytes;
    stretch.attributes = body.index.attributes;
    stretch.primitives = body.index.primitives;
    std::vector<std::uint8_t> bytes;
    const auto add = [&bytes](const std::vector<std::uint8_t>& record) {
      bytes.insert(bytes.end(), record.begin(), record.end());
    };
    std::vector<SegmentEntry>& segments = body.index.segments;
    for (std::size_t i = 0; i < segments.size(); ++i) segments[i].base.offset = i;
    for (std::size_t i = 0; i < segments.size(); ++i) segments[i].harmonics.offset = i;
    for (const IndexEntry* record : records_of(segments)) {
      const bool base = content_of(record->layer) == static_cast<int>(Content::kPrimitives);
      add((base ? body.bases : body.harmonics)[record->offset]);
    }
    stretch.segments = std::move(segments);
    stretches_.push_back(std::move(stretch));
    // Fragment i lists as many stretches as the greatest power of two that divides i, so that all
    // of n are found in log2(n) fragments.
    const std::size_t count = std::size_t{1} << std::countr_zero(stretches_.size());
    const std::size_t first = stretches_.size() - count;
    stretches_.back().fragment = file_.bytes() + bytes.size();
    FragmentHeader header = fragment_header(stretches_.back().fragment);
    if (stretches_.size() > 1) header.before = stretches_[stretches_.size() - 2].fragment;
    if (first > 0) header.previous = stretches_[first - 1].fragment;
    const std::vector<std::uint8_t> fragment =
        write_fragment(header, index_of(std::span(stretches_).subspan(first), chunk_ticks_));
    stretches_.back().fragment_bytes = fragment.size();
    add(fragment);
    return append_bytes(bytes);
  }

  Status append_bytes(std::span<const std::uint8_t> bytes) {
    const Status status = file_.append(bytes, settings_.sync);
    open_ = open_ && status.ok();
    return status;
  }

  void add_bounds(const SceneMetadata& of, bool empty) {
    if (empty) return;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      float &low = metadata_.scene.bounds_min[axis], &high = metadata_.scene.bounds_max[axis];
      low = has_bounds_ ? std::min(low, of.bounds_min[axis]) : of.bounds_min[axis];
      high = has_bounds_ ? std::max(high, of.bounds_max[axis]) : of.bounds_max[axis];
    }
    has_bounds_ = true;
  }

  // Of a FRAG record at `offset`.
  FragmentHeader fragment_header(std::uint64_t offset) const {
    FragmentHeader header;
    header.frames = frames_;
    header.offset = offset;
    header.head = head_checksum_;
    std::copy_n(metadata_.scene.bounds_min, 3, header.bounds_min);
    std::copy_n(metadata_.scene.bounds_max, 3, header.bounds_max);
    return header;
  }

  double chunk_or_one() const { return chunk_ticks_ > 0 ? chunk_ticks_ : 1.0; }

  AppendedFile file_;
  FileMetadata metadata_;
  RecordSettings settings_;
  double chunk_ticks_ =  // 0: open
      to_chunk(metadata_.scene.time_base.ticks(settings_.write.chunk_seconds));
  std::vector<Stretch> stretches_;
  std::uint64_t head_checksum_ = 0;
  std::uint32_t frames_ = 0;
  bool has_bounds_ = false;
  bool open_ = true;
};

// The stored bytes of a record, checked.
bool copy_record(const ByteSource& source, const IndexEntry& entry,
                 std::vector<std::uint8_t>& bytes, Findings& findings) {
  bytes.resize(entry.bytes);
  if (Status status = source.read(entry.offset, bytes); !status.ok()) {
    findings.failed_read(entry.offset, status);
    return false;
  }
  RecordHeader header;
  return parse_record_header(bytes, entry.offset, entry.offset + entry.bytes, header, findings) &&
         check_payload(header, std::span(bytes).subspan(kRecordHeaderBytes),
                       entry.offset + kRecordHeaderBytes, findings);
}

// Whether all bytes of the last fragment's own records are there, as a power cut can leave them
// not.
bool last_stretch_is_whole(const ByteSource& source, const FileHead& head) {
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  Findings found;
  std::vector<std::uint8_t> bytes;
  for (const SegmentEntry& segment : head.index.segments) {
    if (segment.part != last) continue;
    for (const IndexEntry* entry : {&segment.base, &segment.harmonics}) {
      if (entry->bytes > 0) copy_record(source, *entry, bytes, found);
    }
  }
  return found.ok();
}

// Takes the part of a last fragment away that is not whole.
void drop_torn_end(const ByteSource& source, FileHead& head) {
  if (head.closed || head.parts.size() < 2 || last_stretch_is_whole(source, head)) return;
  const auto last = static_cast<std::uint32_t>(head.parts.size() - 1);
  std::vector<SegmentEntry>& segments = head.index.segments;
  const auto first = std::find_if(segments.begin(), segments.end(),
                                  [last](const SegmentEntry& s) { return s.part == last; });
  for (auto s = first; s != segments.end(); ++s) head.index.primitives -= s->base.primitives;
  segments.erase(first, segments.end());
  head.parts.pop_back();
  head.metadata.scene.frames = static_cast<std::uint32_t>(head.parts.back().end);
}

// The first bytes of a source.
class Beginning final : public ByteSource {
 public:
  Beginning(const ByteSource& whole, std::uint64_t size) : whole_(whole), size_(size) {}
  std::uint64_t size() const override { return size_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return whole_.read(offset, out);
  }
  const std::string& name() const override { return whole_.name(); }

 private:
  const ByteSource& whole_;
  std::uint64_t size_ = 0;
};

// Whether every stretch is one part with its fragment behind it, as a Recorder lays them out.
bool is_ours(const ByteSource& source, const FileHead& head) {
  const auto none = [&head](const FragmentEntry& f) { return f.first_part >= head.parts.size(); };
  if (std::any_of(head.fragments.begin(), head.fragments.end(), none)) return false;
  for (const Stretch& stretch : stretches_of(head)) {
    std::vector<std::uint8_t> bytes(kRecordHeaderBytes);
    if (!source.read(stretch.fragment, bytes).ok()) return false;
    Findings found;
    RecordHeader record;
    if (!parse_record_header(bytes, stretch.fragment, source.size(), record, found)) return false;
    if (record.tag != kFragmentTag) return false;
  }
  return true;
}

// What is complete of a recording that is to be gone on with.
Result<FileHead> read_resumable(const ByteSource& source) {
  for (std::uint64_t size = source.size();;) {
    const Beginning beginning(source, size);
    Findings findings;
    FileHead head;
    read_head(beginning, {}, head, findings);
    if (!findings.ok()) return findings.status(source.name());
    if (!head.growing() || head.closed) {
      return usage_error("{}: is finished; nothing can be appended to it", source.name());
    }
    if (!findings.take().empty()) {
      return invalid_file("{}: a fragment of its index is damaged; 'stgs finalize' keeps the rest",
                          source.name());
    }
    if (head.fragments.empty()) return head;
    if (!is_ours(source, head)) {
      return unsupported("{}: is laid out otherwise than this recorder does; 'stgs finalize' it",
                         source.name());
    }
    if (last_stretch_is_whole(source, head)) return head;
    size = head.fragments.back().offset;  // a power cut: without this fragment
  }
}

Status finalize(const ByteSource& source, const std::string& output) {
  Findings findings;
  FileHead head;
  read_head(source, {}, head, findings);
  if (!findings.ok()) return findings.status(source.name());
  if (!head.growing()) {
    return usage_error("{}: has its index in the head already", source.name());
  }
  drop_torn_end(source, head);
  for (PartEntry& part : head.parts) part.skip = 0;
  const std::vector<IndexEntry*> records = records_of(head.index.segments);
  std::uint64_t body_bytes = 0;
  for (const IndexEntry* record : records) body_bytes += record->bytes;
  FileHeader header;
  OutputFile file;
  STGS_TRY(file.open(output));
  STGS_TRY(file.write(write_finished_head(
      head.metadata, head.layouts, write_index(head.index, head.parts), body_bytes, header)));
  std::vector<std::uint8_t> bytes;
  for (const IndexEntry* record : records) {
    if (!copy_record(source, *record, bytes, findings)) return findings.status(source.name());
    STGS_TRY(file.write(bytes));
  }
  return file.commit();
}

}  // namespace

Result<std::unique_ptr<SceneRecorder>> SceneRecorder::create(const std::string& path,
                                                             const SceneMetadata& metadata,
                                                             int sh_degree,
                                                             const RecordSettings& settings) {
  if (metadata.window) return usage_error("{}: a recording is no window of a capture", path);
  FileMetadata head{metadata, settings.write.profile, sh_degree};
  head.scene.frames = 1;  // what is recorded stands in the fragments
  std::fill_n(head.scene.bounds_min, 3, 0.0f);
  std::fill_n(head.scene.bounds_max, 3, 0.0f);
  Scene none;
  none.metadata = head.scene;
  none.gaussians.sh_degree = sh_degree;
  STGS_TRY(check_scene(none, settings.write));
  Findings findings;
  check_metadata_values(head, 0, findings);
  if (!findings.ok()) return usage_error("{}: {}", path, findings.take().front().message);
  auto recorder = std::make_unique<Recorder>(head, settings);
  STGS_TRY(recorder->create(path));
  return std::unique_ptr<SceneRecorder>(std::move(recorder));
}

Result<std::unique_ptr<SceneRecorder>> SceneRecorder::resume(const std::string& path,
                                                             const RecordSettings& settings) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  try {
    STGS_ASSIGN(const FileHead head, read_resumable(*source));
    if (head.metadata.profile != settings.write.profile) {
      return usage_error("{}: was recorded with profile {}, not {}", path,
                         profile_name(head.metadata.profile), profile_name(settings.write.profile));
    }
    STGS_TRY(check_profile(settings.write.profile));
    auto recorder = std::make_unique<Recorder>(head.metadata, settings);
    STGS_TRY(recorder->resume(path, head));
    return std::unique_ptr<SceneRecorder>(std::move(recorder));
  } catch (const std::exception& e) {
    return runtime_error("{}: {}", path, e.what());
  }
}

Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output) {
  try {
    return finalize(*recording, output);
  } catch (const std::exception& e) {
    return runtime_error("{}: {}", recording->name(), e.what());
  }
}

}  // namespace stgs
