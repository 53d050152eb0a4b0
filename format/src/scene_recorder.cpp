// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <bit>
#include <exception>

#include "recording.h"
#include "scene_write.h"
#include "segmenter.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

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

class Recorder final : public SceneRecorder {
 public:
  Recorder(const FileMetadata& metadata, const RecordSettings& settings)
      : metadata_(metadata), settings_(settings) {
    settings_.write.own_layouts = true;
  }

  Status create(const std::string& path) {
    FileHeader header;
    header.flags = kGrowing;
    auto [head, copy] = write_copied_head(header, write_head_records(metadata_, {}), 0);
    head_checksum_ = checksum(head);
    head_copy_bytes_ = copy.size();
    head.insert(head.end(), copy.begin(), copy.end());
    STGS_TRY(file_.create(path));
    return append_bytes(head);
  }

  // Goes on with a file whose complete fragments are `head`; what follows them is cut off.
  Status resume(const std::string& path, const FileHead& head) {
    head_checksum_ = head.head_checksum;
    head_copy_bytes_ = head.header.file_bytes - head.header.head_bytes;  // of no fragments
    if (!head.fragments.empty()) {
      frames_ = head.metadata.scene.frames;
      chunk_ticks_ = head.index.chunk_ticks;
      has_bounds_ = head.index.primitives > 0;
      stretches_ = stretches_of(head);
    }
    return file_.extend(path, head.header.file_bytes);
  }

  Status append(const Gaussians4D& stretch, std::uint32_t end_frame,
                std::span<const float> importance, std::uint32_t last_frame) override {
    STGS_TRY(check_open());
    if (end_frame <= frames_) {
      return usage_error("{}: a stretch that ends at frame {} is appended to {} frames",
                         file_.path(), end_frame, frames_);
    }
    const std::uint32_t part_end = std::max(end_frame, last_frame);
    if (chunk_ticks_ > 0 && 2.0 * (part_end - frames_) >= kMostSlots * chunk_ticks_) {
      return usage_error("{}: {} frames are too many for chunks of {} ticks", file_.path(),
                         part_end, chunk_ticks_);
    }
    if (stretch.sh_degree != metadata_.sh_degree) {
      return usage_error("{}: a stretch of degree {} is appended to harmonics of degree {}",
                         file_.path(), stretch.sh_degree, metadata_.sh_degree);
    }
    try {
      return append_checked(stretch, end_frame, part_end, importance);
    } catch (const std::exception& e) {
      open_ = false;
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
  const SceneMetadata& metadata() const override { return metadata_.scene; }
  int sh_degree() const override { return metadata_.sh_degree; }

 private:
  Status check_open() const {
    if (open_) return {};
    return usage_error("{}: is closed, or an error has ended the recording", file_.path());
  }

  Status append_checked(const Gaussians4D& stretch, std::uint32_t end_frame, std::uint32_t part_end,
                        std::span<const float> importance) {
    Scene scene;
    scene.metadata = metadata_.scene;
    scene.metadata.frames = part_end;
    scene.gaussians = stretch;
    scene.importance.assign(importance.begin(), importance.end());
    scene.parts = {{static_cast<double>(frames_), static_cast<double>(part_end), stretch.size()}};
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
    stretch.part.skip = stretches_.empty() ? head_copy_bytes_ : stretches_.back().fragment_bytes;
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
  std::uint64_t head_copy_bytes_ = 0;  // that lie before the first stretch
  std::vector<Stretch> stretches_;
  std::uint64_t head_checksum_ = 0;
  std::uint32_t frames_ = 0;
  bool has_bounds_ = false;
  bool open_ = true;
};

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

}  // namespace stgs
