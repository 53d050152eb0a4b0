// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/scene_recorder.h"

#include <algorithm>
#include <exception>

#include "quantise/segmenter.h"
#include "scene/recorded_segments.h"
#include "scene/recording.h"
#include "scene/write.h"
#include "stgs/format/output_file.h"

namespace stgs {
namespace {

// Properties of all fragments together.
struct Recorded {
  std::uint32_t frames = 0;
  double chunk_ticks = 0;  // 0: not chosen yet
  std::uint64_t primitives = 0;
  float bounds_min[3] = {}, bounds_max[3] = {};

  void add(const EncodedScene& part) {
    const SceneMetadata& scene = part.metadata.scene;
    const std::uint64_t added = part.body.index.primitives;
    for (std::size_t axis = 0; axis < 3 && added > 0; ++axis) {
      float &low = bounds_min[axis], &high = bounds_max[axis];
      low = primitives > 0 ? std::min(low, scene.bounds_min[axis]) : scene.bounds_min[axis];
      high = primitives > 0 ? std::max(high, scene.bounds_max[axis]) : scene.bounds_max[axis];
    }
    primitives += added;
    chunk_ticks = part.body.parts.front().chunk_ticks;
  }
};

Status check_recorded_profile(Profile profile) {
  STGS_TRY(check_profile(profile));
  if (profile != Profile::kNearLossless) return {};
  return usage_error(
      "cannot record in the profile {}: its errors are known only at the end; record in the "
      "profile "
      "{}",
      profile_name(profile), profile_name(Profile::kLossless));
}

}  // namespace

class SceneRecorder::State {
 public:
  using Locations = std::vector<std::vector<StoredPrimitive>>;

  explicit State(const RecordSettings& settings) : settings_(settings) {
    settings_.write.own_layouts = true;
  }

  Status create(const std::string& path, const FileMetadata& metadata) {
    metadata_ = metadata;
    recorded_.chunk_ticks = chunk_of_settings();
    FileHeader header;
    header.flags = kGrowing | (settings_.ends ? kHasEnds : 0);
    const std::vector<std::uint8_t> records = write_head_records(metadata_, {});
    header.head_bytes = static_cast<std::uint32_t>(kHeaderBytes + records.size());
    head_ = write_header(header);
    head_.insert(head_.end(), records.begin(), records.end());
    STGS_TRY(file_.create(path, head_, settings_.sync));
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
    STGS_TRY(check_recorded_profile(settings_.write.profile));
    metadata_ = head.metadata;
    recorded_.chunk_ticks = chunk_of_settings();
    settings_.ends = (head.header.flags & kHasEnds) != 0;
    head_ = *head.bytes;
    for (const SegmentEntry& segment : head.index.segments)
      recorded_segments_.add(head.parts[segment.part].number, segment.base);
    if (head.last_fragment) {
      const SceneMetadata& scene = metadata_.scene;
      recorded_.frames = scene.frames;
      recorded_.primitives = head.index.primitives;
      std::copy_n(scene.bounds_min, 3, recorded_.bounds_min);
      std::copy_n(scene.bounds_max, 3, recorded_.bounds_max);
      links_ = FragmentLinks(head);
    }
    for (const PartEntry& part : head.parts) {
      recorded_.chunk_ticks = part.chunk_ticks;
      next_part_ = std::max(next_part_, std::uint64_t{part.number} + 1);
    }
    STGS_TRY(file_.cut(head.header.file_bytes));
    open_ = true;
    return {};
  }

  Status append(std::span<const FragmentPart> parts, std::span<const PrimitiveEnd> ends,
                std::uint32_t end_frame, Locations* stored) {
    STGS_TRY(check_open());
    const std::uint32_t frames = recorded_.frames;
    if (end_frame <= frames) {
      return usage_error(
          "{}: cannot append a fragment that ends at frame {} (expected more than {})",
          file_.path(), end_frame, frames);
    }
    if (next_part_ + parts.size() + 1 > std::uint64_t{1} << 32)
      return unsupported("{}: no number is left for another part", file_.path());
    if (!ends.empty() && !settings_.ends)
      return usage_error("{}: created without RecordSettings::ends", file_.path());
    STGS_TRY(recorded_segments_.check(file_.path(), ends, end_frame));
    std::size_t primitives = 0;
    for (const FragmentPart& part : parts) {
      STGS_TRY(check_part(part, end_frame));
      primitives += part.primitives.size();
    }
    try {
      return append_checked(parts, ends, end_frame, stored);
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: cannot append {} primitives: {}", file_.path(),
                                            primitives, e.what()));
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

  Status check_part(const FragmentPart& part, std::uint32_t end_frame) const {
    const std::uint32_t part_end = std::max(end_frame, part.last_frame);
    const double chunk_ticks = recorded_.chunk_ticks;
    if (chunk_ticks > 0 && 2.0 * (part_end - recorded_.frames) >= kMaxSlots * chunk_ticks) {
      return usage_error("{}: {} frames are too many for chunks of {} ticks; use longer chunks",
                         file_.path(), part_end, chunk_ticks);
    }
    if (part.primitives.sh_degree != metadata_.sh_degree) {
      return usage_error("{}: SH degree mismatch (expected {}, got {})", file_.path(),
                         metadata_.sh_degree, part.primitives.sh_degree);
    }
    return {};
  }

  double chunk_of_settings() const {
    return to_chunk(metadata_.scene.time_base.ticks(settings_.write.chunk_seconds));
  }

  Status close_checked() {
    FragmentRecord last = fragment_at(file_.bytes(), recorded_);
    last.flags = kFragmentClosed;
    last.frames = std::max(last.frames, 1u);
    STGS_TRY(append_bytes(write_fragment(last)));
    open_ = false;
    return file_.close();
  }

  Status append_checked(std::span<const FragmentPart> parts, std::span<const PrimitiveEnd> ends,
                        std::uint32_t end_frame, Locations* stored) {
    Recorded after = recorded_;
    std::vector<Body> bodies;
    Locations locations;
    std::optional<EndRecord> end_record;
    if (!ends.empty()) end_record = recorded_segments_.record_of(ends, recorded_.chunk_ticks);
    std::uint64_t appended = 0;
    for (const FragmentPart& part : parts) {
      STGS_ASSIGN(EncodedScene encoded, encode_part(part, end_frame, after.chunk_ticks));
      after.add(encoded);
      bodies.push_back(std::move(encoded.body));
      appended += part.primitives.size();
    }
    after.frames = end_frame;
    for (std::size_t p = 0; stored != nullptr && p < parts.size(); ++p)
      locations.emplace_back(parts[p].primitives.size());
    STGS_TRY(append_fragment(bodies, end_record, after, locations));
    if (stored != nullptr) *stored = std::move(locations);
    dropped_ += appended - (after.primitives - recorded_.primitives);
    recorded_ = after;
    return {};
  }

  Result<EncodedScene> encode_part(const FragmentPart& part, std::uint32_t end_frame,
                                   double chunk_ticks) const {
    const std::uint32_t part_end = std::max(end_frame, part.last_frame);
    Scene scene;
    scene.metadata = metadata_.scene;
    scene.metadata.frames = part_end;
    scene.gaussians = part.primitives;
    scene.importance.assign(part.importance.begin(), part.importance.end());
    scene.parts = {{static_cast<double>(recorded_.frames), static_cast<double>(part_end),
                    part.primitives.size()}};
    WriteSettings check = settings_.write;
    check.chunk_seconds = 0;  // already checked; must not be checked against the whole timeline
    if (part.steps != nullptr) scene.quantisation = *part.steps;
    STGS_TRY(check_scene(scene, check));
    WriteSettings write = settings_.write;
    if (part.quality > 0) write.quality = part.quality;
    write.own_steps = part.steps != nullptr;
    return encode_records(scene, write, chunk_ticks, false);
  }

  // Adds a run with the next number.
  IndexRun& add_run(PartEntry part, FragmentRecord& fragment) const {
    part.number = static_cast<std::uint32_t>(next_part_ + fragment.node.runs.size());
    fragment.node.runs.emplace_back().part = part;
    return fragment.node.runs.back();
  }

  // Writes the records and their FRAG record in one write. Sets the locations of the primitives, if
  // `locations` has them.
  Status append_fragment(std::vector<Body>& bodies, std::optional<EndRecord>& ends,
                         const Recorded& after, Locations& locations) {
    std::vector<std::uint8_t> bytes;
    const std::uint64_t begin = file_.bytes();
    for (Body& body : bodies) append_records(body, begin, bytes);
    if (ends) {
      ends->entry.entry.offset = begin + bytes.size();
      bytes.insert(bytes.end(), ends->bytes.begin(), ends->bytes.end());
    }
    FragmentRecord fragment = fragment_at(begin + bytes.size(), after);
    RecordedSegments added;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const std::vector<SegmentEntry>& segments = bodies[b].index.segments;
      if (segments.empty()) continue;
      IndexRun& run = add_run(bodies[b].parts.front(), fragment);
      run.segments = segments.size();
      fragment.node.segments.insert(fragment.node.segments.end(), segments.begin(), segments.end());
      if (!locations.empty()) locate(bodies[b], locations[b]);
      for (const SegmentEntry& segment : segments)
        if (settings_.ends) added.add(run.part.number, segment.base);
    }
    if (ends) {
      add_run(ends->part, fragment).further = 1;
      fragment.node.further.push_back(ends->entry);
    }
    const std::vector<std::uint8_t> record = write_fragment(fragment);
    fragment.end = fragment.offset + record.size();
    bytes.insert(bytes.end(), record.begin(), record.end());
    FragmentLinks links = links_;
    links.add(fragment);
    STGS_TRY(append_bytes(bytes));
    links_ = std::move(links);
    recorded_segments_.merge(std::move(added));
    next_part_ += fragment.node.runs.size();
    return {};
  }

  Status append_bytes(std::span<const std::uint8_t> bytes) {
    open_ = false;
    STGS_TRY(file_.append(bytes, settings_.sync));
    open_ = true;
    return {};
  }

  // Returns the FRAG record at `offset`, without segments.
  FragmentRecord fragment_at(std::uint64_t offset, const Recorded& recorded) const {
    FragmentRecord fragment;
    fragment.offset = offset;
    fragment.frames = recorded.frames;
    fragment.primitives = recorded.primitives;
    fragment.head = head_;
    std::copy_n(recorded.bounds_min, 3, fragment.bounds_min);
    std::copy_n(recorded.bounds_max, 3, fragment.bounds_max);
    links_.take(fragment);
    return fragment;
  }

  AppendedFile file_;
  FileMetadata metadata_;
  RecordSettings settings_;
  std::vector<std::uint8_t> head_;
  FragmentLinks links_;
  RecordedSegments recorded_segments_;
  std::uint64_t next_part_ = 0;  // number of the next part
  Recorded recorded_;
  std::uint64_t dropped_ = 0;
  bool open_ = false;
};

SceneRecorder::SceneRecorder(std::unique_ptr<State> state) : state_(std::move(state)) {}
SceneRecorder::~SceneRecorder() = default;

Status SceneRecorder::append(std::span<const FragmentPart> parts, std::uint32_t end_frame) {
  return state_->append(parts, {}, end_frame, nullptr);
}

Status SceneRecorder::append(std::span<const FragmentPart> parts,
                             std::span<const PrimitiveEnd> ends, std::uint32_t end_frame,
                             std::vector<std::vector<StoredPrimitive>>* stored) {
  return state_->append(parts, ends, end_frame, stored);
}

Status SceneRecorder::append(const Gaussians4D& primitives, std::uint32_t end_frame,
                             std::span<const float> importance, std::uint32_t last_frame) {
  const FragmentPart part{primitives, importance, last_frame};
  return state_->append({&part, 1}, {}, end_frame, nullptr);
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
  STGS_TRY(check_recorded_profile(settings.write.profile));
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
