// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <bit>
#include <exception>

#include "quantise/segmenter.h"
#include "scene/recording.h"
#include "scene/write.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

// Returns the index of successive fragments.
std::vector<std::uint8_t> index_of(std::span<const Fragment> fragments, double chunk_ticks) {
  FileIndex index;
  index.chunk_ticks = chunk_ticks;
  std::vector<PartEntry> parts;
  for (const Fragment& fragment : fragments) {
    for (SegmentEntry segment : fragment.segments) {
      segment.part = static_cast<std::uint32_t>(parts.size());
      index.segments.push_back(segment);
    }
    parts.push_back(fragment.part);
    index.primitives += fragment.primitives;
    if (index.attributes.empty())
      index.attributes = fragment.attributes;
    else
      for (std::size_t a = 0; a < fragment.attributes.size(); ++a) {
        index.attributes[a].bytes += fragment.attributes[a].bytes;
      }
  }
  return write_index(index, parts);
}

// Properties of all fragments together.
struct Recorded {
  std::uint32_t frames = 0;
  double chunk_ticks = 0;  // 0: not chosen yet
  std::uint64_t primitives = 0;
  float bounds_min[3] = {}, bounds_max[3] = {};

  void add(const EncodedScene& fragment, std::uint32_t end_frame) {
    const SceneMetadata& scene = fragment.metadata.scene;
    const std::uint64_t added = fragment.body.index.primitives;
    for (std::size_t axis = 0; axis < 3 && added > 0; ++axis) {
      float &low = bounds_min[axis], &high = bounds_max[axis];
      low = primitives > 0 ? std::min(low, scene.bounds_min[axis]) : scene.bounds_min[axis];
      high = primitives > 0 ? std::max(high, scene.bounds_max[axis]) : scene.bounds_max[axis];
    }
    primitives += added;
    frames = end_frame;
    chunk_ticks = fragment.body.index.chunk_ticks;
  }
};

}  // namespace

class SceneRecorder::State {
 public:
  explicit State(const RecordSettings& settings) : settings_(settings) {
    settings_.write.own_layouts = true;
  }

  Status create(const std::string& path, const FileMetadata& metadata) {
    metadata_ = metadata;
    recorded_.chunk_ticks = chunk_of_settings();
    FileHeader header;
    header.flags = kGrowing;
    auto [head, copy] = write_copied_head(header, write_head_records(metadata_, {}), 0);
    head_checksum_ = checksum(head);
    head_copy_bytes_ = copy.size();
    head.insert(head.end(), copy.begin(), copy.end());
    STGS_TRY(file_.create(path, head, settings_.sync));
    open_ = true;
    return {};
  }

  // Truncates the file after its last complete fragment.
  Status resume(const std::string& path) {
    STGS_TRY(file_.open(path));
    STGS_ASSIGN(const std::unique_ptr<ByteSource> source, file_.source());
    STGS_ASSIGN(const FileHead head, read_resumable(*source));
    if (head.metadata.profile != settings_.write.profile) {
      return usage_error("{}: cannot resume with another profile (expected {}, got {})", path,
                         profile_name(head.metadata.profile),
                         profile_name(settings_.write.profile));
    }
    STGS_TRY(check_profile(settings_.write.profile));
    metadata_ = head.metadata;
    recorded_.chunk_ticks = chunk_of_settings();
    head_checksum_ = head.head_checksum;
    // Correct if there are no fragments; otherwise unused.
    head_copy_bytes_ = head.header.file_bytes - head.header.head_bytes;
    if (!head.fragments.empty()) {
      const SceneMetadata& scene = metadata_.scene;
      recorded_ = {scene.frames, head.index.chunk_ticks, head.index.primitives};
      std::copy_n(scene.bounds_min, 3, recorded_.bounds_min);
      std::copy_n(scene.bounds_max, 3, recorded_.bounds_max);
      fragments_ = fragments_of(head);
    }
    STGS_TRY(file_.cut(head.header.file_bytes));
    open_ = true;
    return {};
  }

  Status append(const Gaussians4D& fragment, std::uint32_t end_frame,
                std::span<const float> importance, std::uint32_t last_frame) {
    STGS_TRY(check_open());
    const std::uint32_t frames = recorded_.frames;
    if (end_frame <= frames) {
      return usage_error(
          "{}: cannot append a fragment that ends at frame {} (expected more than {})",
          file_.path(), end_frame, frames);
    }
    const std::uint32_t part_end = std::max(end_frame, last_frame);
    const double chunk_ticks = recorded_.chunk_ticks;
    if (chunk_ticks > 0 && 2.0 * (part_end - frames) >= kMaxSlots * chunk_ticks) {
      return usage_error("{}: {} frames are too many for chunks of {} ticks; use longer chunks",
                         file_.path(), part_end, chunk_ticks);
    }
    if (fragment.sh_degree != metadata_.sh_degree) {
      return usage_error("{}: SH degree mismatch (expected {}, got {})", file_.path(),
                         metadata_.sh_degree, fragment.sh_degree);
    }
    const std::size_t before = fragments_.size();
    try {
      Status status = append_checked(fragment, end_frame, part_end, importance);
      if (!status.ok()) fragments_.resize(before);
      return status;
    } catch (const std::exception& e) {
      fragments_.resize(before);
      return Status(code_of(e), fmt::format("{}: cannot append {} primitives: {}", file_.path(),
                                            fragment.size(), e.what()));
    }
  }

  Status close() {
    STGS_TRY(check_open());
    try {
      return close_checked();
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: cannot close: {}", file_.path(), e.what()));
    }
  }

  bool is_open() const { return open_; }
  std::uint32_t frames() const { return recorded_.frames; }
  std::uint64_t primitives() const { return recorded_.primitives; }
  std::uint64_t dropped() const { return dropped_; }
  std::uint64_t bytes() const { return file_.bytes(); }
  const SceneMetadata& metadata() const { return metadata_.scene; }
  int sh_degree() const { return metadata_.sh_degree; }

 private:
  Status check_open() const {
    if (open_) return {};
    return usage_error("{}: recording is closed or was ended by an error", file_.path());
  }

  double chunk_of_settings() const {
    return to_chunk(metadata_.scene.time_base.ticks(settings_.write.chunk_seconds));
  }

  Status close_checked() {
    FragmentHeader header = fragment_header(recorded_, file_.bytes());
    header.flags = kFragmentClosed;
    if (recorded_.frames == 0) header.frames = 1;  // no fragments
    if (!fragments_.empty()) header.before = fragments_.back().record_offset;
    const double chunk_ticks = recorded_.chunk_ticks > 0 ? recorded_.chunk_ticks : 1.0;
    STGS_TRY(append_bytes(write_fragment(header, index_of(fragments_, chunk_ticks))));
    open_ = false;
    return file_.close();
  }

  Status append_checked(const Gaussians4D& fragment, std::uint32_t end_frame,
                        std::uint32_t part_end, std::span<const float> importance) {
    const std::uint32_t begin = recorded_.frames;
    Scene scene;
    scene.metadata = metadata_.scene;
    scene.metadata.frames = part_end;
    scene.gaussians = fragment;
    scene.importance.assign(importance.begin(), importance.end());
    scene.parts = {{static_cast<double>(begin), static_cast<double>(part_end), fragment.size()}};
    WriteSettings check = settings_.write;
    check.chunk_seconds = 0;  // already checked; must not be checked against the whole timeline
    STGS_TRY(check_scene(scene, check));
    STGS_ASSIGN(EncodedScene encoded,
                encode_records(scene, settings_.write, recorded_.chunk_ticks));
    Recorded after = recorded_;
    after.add(encoded, end_frame);
    STGS_TRY(append_fragment(encoded.body, after));
    dropped_ += fragment.size() - (after.primitives - recorded_.primitives);
    recorded_ = after;
    return {};
  }

  // Writes the records and their FRAG record in one write, and adds the fragment to fragments_,
  // where it may remain after an error.
  Status append_fragment(Body& body, const Recorded& after) {
    Fragment fragment;
    fragment.part = body.parts.front();
    fragment.part.skip = fragments_.empty() ? head_copy_bytes_ : fragments_.back().record_bytes;
    fragment.attributes = body.index.attributes;
    fragment.primitives = body.index.primitives;
    std::vector<std::uint8_t> bytes;
    const auto add = [&bytes](const std::vector<std::uint8_t>& record) {
      bytes.insert(bytes.end(), record.begin(), record.end());
    };
    std::vector<SegmentEntry>& segments = body.index.segments;
    for (std::size_t i = 0; i < segments.size(); ++i) segments[i].base.offset = i;
    for (std::size_t i = 0; i < segments.size(); ++i) segments[i].sh.offset = i;
    for (const IndexEntry* record : records_of(segments)) {
      const bool base = content_of(record->layer) == static_cast<int>(Content::kPrimitives);
      add((base ? body.bases : body.sh)[record->offset]);
    }
    fragment.segments = std::move(segments);
    fragments_.push_back(std::move(fragment));
    // FRAG record i lists as many fragments as the greatest power of two that divides i, so that
    // log2(n) records list all n fragments.
    const std::size_t count = std::size_t{1} << std::countr_zero(fragments_.size());
    const std::size_t first = fragments_.size() - count;
    fragments_.back().record_offset = file_.bytes() + bytes.size();
    FragmentHeader header = fragment_header(after, fragments_.back().record_offset);
    if (fragments_.size() > 1) header.before = fragments_[fragments_.size() - 2].record_offset;
    if (first > 0) header.previous = fragments_[first - 1].record_offset;
    const std::vector<std::uint8_t> record =
        write_fragment(header, index_of(std::span(fragments_).subspan(first), after.chunk_ticks));
    fragments_.back().record_bytes = record.size();
    add(record);
    return append_bytes(bytes);
  }

  Status append_bytes(std::span<const std::uint8_t> bytes) {
    open_ = false;
    STGS_TRY(file_.append(bytes, settings_.sync));
    open_ = true;
    return {};
  }

  // Returns the header of a FRAG record at `offset`.
  FragmentHeader fragment_header(const Recorded& recorded, std::uint64_t offset) const {
    FragmentHeader header;
    header.frames = recorded.frames;
    header.offset = offset;
    header.head = head_checksum_;
    std::copy_n(recorded.bounds_min, 3, header.bounds_min);
    std::copy_n(recorded.bounds_max, 3, header.bounds_max);
    return header;
  }

  AppendedFile file_;
  FileMetadata metadata_;
  RecordSettings settings_;
  std::uint64_t head_copy_bytes_ = 0;  // before the first fragment
  std::vector<Fragment> fragments_;
  std::uint64_t head_checksum_ = 0;
  Recorded recorded_;
  std::uint64_t dropped_ = 0;
  bool open_ = false;
};

SceneRecorder::SceneRecorder(std::unique_ptr<State> state) : state_(std::move(state)) {}
SceneRecorder::~SceneRecorder() = default;

Status SceneRecorder::append(const Gaussians4D& fragment, std::uint32_t end_frame,
                             std::span<const float> importance, std::uint32_t last_frame) {
  return state_->append(fragment, end_frame, importance, last_frame);
}

Status SceneRecorder::close() {
  return state_->close();
}

bool SceneRecorder::is_open() const {
  return state_->is_open();
}

std::uint32_t SceneRecorder::frames() const {
  return state_->frames();
}

std::uint64_t SceneRecorder::primitives() const {
  return state_->primitives();
}

std::uint64_t SceneRecorder::dropped() const {
  return state_->dropped();
}

std::uint64_t SceneRecorder::bytes() const {
  return state_->bytes();
}

const SceneMetadata& SceneRecorder::metadata() const {
  return state_->metadata();
}

int SceneRecorder::sh_degree() const {
  return state_->sh_degree();
}

Result<std::unique_ptr<SceneRecorder>> SceneRecorder::create(const std::string& path,
                                                             const SceneMetadata& metadata,
                                                             int sh_degree,
                                                             const RecordSettings& settings) {
  if (metadata.window) return usage_error("{}: a recording cannot be a window of a capture", path);
  try {
    FileMetadata head{metadata, settings.write.profile, sh_degree};
    head.scene.frames = 1;  // the FRAG records have the actual values
    std::fill_n(head.scene.bounds_min, 3, 0.0f);
    std::fill_n(head.scene.bounds_max, 3, 0.0f);
    Scene none;
    none.metadata = head.scene;
    none.gaussians.sh_degree = sh_degree;
    STGS_TRY(check_scene(none, settings.write));
    Findings findings;
    check_metadata_values(head, 0, findings);
    if (!findings.ok()) return usage_error("{}: {}", path, findings.take().front().message);
    // Allocated before the file is created, so that a failure leaves no file.
    std::unique_ptr<SceneRecorder> recorder(new SceneRecorder(std::make_unique<State>(settings)));
    STGS_TRY(recorder->state_->create(path, head));
    return recorder;
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", path, e.what()));
  }
}

Result<std::unique_ptr<SceneRecorder>> SceneRecorder::resume(const std::string& path,
                                                             const RecordSettings& settings) {
  try {
    std::unique_ptr<SceneRecorder> recorder(new SceneRecorder(std::make_unique<State>(settings)));
    STGS_TRY(recorder->state_->resume(path));
    return recorder;
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", path, e.what()));
  }
}

}  // namespace stgs
