// SPDX-License-Identifier: Apache-2.0
// Reading and writing .stgs files (spec/stgs-format.md).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/coded_segment.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"
#include "stgs/format/status.h"

namespace stgs {

inline constexpr std::uint16_t kFormatMajor = 1;
inline constexpr std::uint16_t kFormatMinor = 1;

enum class Profile : std::uint16_t {
  kLossless = 0,      // every float as trained
  kQuantised = 1,     // bounded error, tiers by importance, Morton order
  kDraco = 2,         // kQuantised with its positions as Draco point clouds
  kUnknown = 0xFFFF,  // of a later version, which reads like kQuantised; cannot be written
};

// "lossless", "quantised", "draco" or "unknown".
const char* profile_name(Profile profile);
// Whether this build can write the profile and decode its segments: else kNotBuilt.
Status check_profile(Profile profile);

// A pinhole camera to start playback from; world-to-camera, OpenCV axes.
struct StartCamera {
  float rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // row-major
  float translation[3] = {0, 0, 0};
  float fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  std::uint32_t width = 0, height = 0;   // pixels
};

// What the renderers take. `near_plane` in scene units.
math::PinholeCamera pinhole_of(const StartCamera& camera, float near_plane);

// Of which longer capture a scene is one window (spec 4.5).
struct CaptureWindow {
  std::uint32_t first_frame = 0;     // of the capture: the scene's moment 0
  std::uint32_t capture_frames = 0;  // of the whole capture
  std::uint64_t capture = 0;         // equal for windows of one capture
  std::uint64_t training = 0;        // equal for windows that were trained alike
  bool operator==(const CaptureWindow&) const = default;
};

// What a file says about itself.
struct SceneMetadata {
  TimeBase time_base;
  std::uint32_t frames = 0;         // duration in ticks: moments [0, frames)
  float metres_per_unit = 0;        // > 0; 0: not known
  float up[3] = {0, 0, 0};          // unit vector against gravity; 0, 0, 0: not known
  float floor[3] = {0, 0, 0};       // a point of the floor, scene units, where `up` is known
  float background[3] = {0, 0, 0};  // sRGB-encoded
  float bounds_min[3] = {0, 0, 0};  // of the positions; computed by the writer
  float bounds_max[3] = {0, 0, 0};
  float near_plane = 0.01f;  // scene units; content nearer was never trained
  std::optional<StartCamera> start_camera;
  std::string generator;  // program and version that wrote the file
  std::string title;
  // Where the scene's sound is, a URI reference that is relative to the file's own place (RFC
  // 3986); empty: there is none. It begins at this moment, ticks. Nothing here fetches it.
  std::string audio;
  double audio_begin = 0;
  // Numbers of later versions that may be shown as 0 (spec 4.2), kept for whoever knows them.
  std::uint8_t kernel = 0, colour = 0, harmonics = 0;
  std::optional<CaptureWindow> window;
};

// Moments [begin, end), ticks.
struct TickRange {
  double begin = 0, end = 0;
  bool operator==(const TickRange&) const = default;
};

// Successive primitives that are drawn at the moments of [begin, end) alone (spec 5.10), or at
// those of these that are shown; a part that reaches the end of the timeline includes it. Their
// times count from begin_ticks, so that single precision holds them however late the part is. The
// part may begin before the timeline and end after it. All moments are multiples of 2^-20, to 2^32,
// and no part is longer than that.
struct ScenePart {
  double begin_ticks = 0, end_ticks = 0;
  std::uint64_t primitives = 0;
  std::optional<TickRange> cut =
      {};  // what of [begin, end) is shown, from 0 on, where that is not all

  TickRange shown_range() const { return cut.value_or(TickRange{begin_ticks, end_ticks}); }
  // Whether its primitives are drawn at a moment of a timeline of so many frames.
  bool shows(double ticks, std::uint32_t frames) const {
    const TickRange moments = shown_range();
    return ticks >= moments.begin &&
           (ticks < moments.end || (moments.end >= frames && ticks <= frames));
  }
  bool operator==(const ScenePart&) const = default;
};

struct Scene {
  SceneMetadata metadata;
  Gaussians4D gaussians;
  std::vector<ScenePart> parts;  // of all the primitives, in their order; empty: one, all the clip
  // N, or empty where it is not known: the sum over the pixels of many views of the square of the
  // share that the primitive has in them. A writer makes layers and steps by it.
  std::vector<float> importance;
};

// Upper bounds that a reader refuses to pass, checked before anything is allocated.
struct ReadLimits {
  std::uint64_t max_primitives = 200'000'000;
  // Bytes that a segment may take with all that decoding it needs; for a whole scene, its floats
  // (spec/conformance.md, 1.5).
  std::uint64_t max_memory = std::uint64_t{16} << 30;
};

// The primitives of one tier that are drawn inside [begin, end) alone. Tier 0 has those that matter
// most; any number of first tiers, with or without their harmonics, is a picture.
struct SegmentInfo {
  std::int32_t level = 0;  // -1: persistent, all of its part; else span = chunk << level
  double begin_ticks = 0, end_ticks = 0;  // what is shown of it, see shown()
  std::uint32_t primitives = 0;
  std::uint64_t offset = 0, bytes = 0;  // in the file
  std::uint32_t part = 0;               // of SceneReader::parts()
  int tier = 0;
  // The harmonics above degree 0, where they can be fetched apart; else 0 bytes.
  std::uint64_t sh_offset = 0, sh_bytes = 0;
  // False: beyond the end of a file that is truncated. Where there are no harmonics of their own
  // these are there.
  bool available = true, sh_available = true;

  bool is_shown() const { return begin_ticks < end_ticks; }
};

// A stretch of a recording that no fragment of its index lists any more, since the one that did is
// damaged (spec 5.12).
struct LostFragment {
  // At which what it holds is first seen, ticks; begin == end: it is not known up to when.
  TickRange range;
  std::uint64_t offset = 0, bytes = 0;  // in the file
  bool operator==(const LostFragment&) const = default;
};

// How a file is laid out (spec 2.4).
enum class SceneForm {
  kFinished,  // index first
  kGrowing,   // recorded live, the index in fragments; more may follow
  kRecorded,  // the same, closed: nothing follows
};

// Bytes spent on one attribute over the whole file.
struct StreamInfo {
  std::string name;  // "position", "sh", ...
  std::uint64_t bytes = 0, raw_bytes = 0;
};

// One finding of a validation.
struct Issue {
  int number = 0;            // stable; listed in spec/conformance.md
  bool error = true;         // else a warning
  std::uint64_t offset = 0;  // byte where it was found
  std::string message;
};

// A file opened for random access: header, metadata and index are read and checked, the rest is
// read when asked for. Thread-safe after open.
class SceneReader {
 public:
  // `memory` is where decode() takes that of what it gives, from several threads at once; it
  // outlives both.
  static Result<std::unique_ptr<SceneReader>> open(
      std::unique_ptr<ByteSource> source, const ReadLimits& limits = {},
      std::pmr::memory_resource* memory = std::pmr::get_default_resource());
  static Result<std::unique_ptr<SceneReader>> open(const std::string& path,
                                                   const ReadLimits& limits = {});
  virtual ~SceneReader() = default;

  virtual const SceneMetadata& metadata() const = 0;
  virtual Profile profile() const = 0;
  virtual std::uint16_t version_major() const = 0;
  virtual std::uint16_t version_minor() const = 0;
  virtual int sh_degree() const = 0;
  virtual std::uint64_t primitives() const = 0;
  // Up to the end of what is complete.
  virtual std::uint64_t file_bytes() const = 0;
  // Bytes that open() read: all that is needed for finding segments.
  virtual std::uint64_t head_bytes() const = 0;
  virtual SceneForm form() const = 0;
  // Bytes of a growing file after its last complete fragment: being written, or cut off.
  virtual std::uint64_t incomplete_bytes() const = 0;
  // The frames that a fragment among these says there are, to which the records before it do not
  // lead, since one is damaged (spec 5.12); 0: there is none.
  virtual std::uint32_t unreached_frames() const = 0;
  // What open() found wrong, or has to tell, and could read past: a file that is truncated, say.
  // Segments that are there can be decoded all the same.
  virtual const std::vector<Issue>& damage() const = 0;
  // Bytes that a finished file has too few.
  virtual std::uint64_t missing_bytes() const = 0;
  // Of a recording, ascending; damage() tells of each.
  virtual const std::vector<LostFragment>& lost_fragments() const = 0;
  // Where the first segment begins that is not there, not with its harmonics, or in a lost stretch,
  // ticks; the duration where all are.
  virtual double complete_ticks() const = 0;
  // Looks whether a growing file has grown; true: there are new segments, after those that there
  // were, and metadata().frames has grown. What metadata(), segments() and parts() gave before is
  // void then; indices of segments are not. Not while another thread uses the reader. After an
  // error it is as it was.
  virtual Result<bool> refresh() = 0;
  virtual double chunk_ticks() const = 0;  // the shortest segment of the timeline
  // Whether the head has layouts for all records (spec 6.2); else each has its own.
  virtual bool has_layouts() const = 0;
  virtual const std::vector<SegmentInfo>& segments() const = 0;
  // Segments are listed part after part; none where the file has no primitives and no parts.
  virtual const std::vector<ScenePart>& parts() const = 0;
  virtual std::vector<StreamInfo> streams() const = 0;
  // Indices of the segments that hold every primitive alive somewhere in [t0, t1], ticks; from the
  // index alone, ascending in file offset.
  virtual std::vector<std::uint32_t> segments_between(double t0, double t1) const = 0;
  // Decodes one segment, its times counted from the beginning of its part; without its harmonics
  // those above degree 0 are 0 where they are stored apart, and their bytes are not read.
  virtual Result<Gaussians4D> decode(std::uint32_t segment, bool with_harmonics) const = 0;
  Result<Gaussians4D> decode(std::uint32_t segment) const { return decode(segment, true); }
  // What is sound of a segment (spec 5.7): where only its harmonics are damaged, missing or of a
  // later version they are 0, and `lost` says why; else `lost` is ok.
  Result<Gaussians4D> decode_intact(std::uint32_t segment, Status& lost) const;
  // The same segment as stored, for a decoder on another device. Its checksum is checked, but not
  // that of the planes, which are not decoded here.
  virtual Result<CodedSegment> read(std::uint32_t segment, bool with_harmonics) const = 0;
  // The tables of the file, which the records of its segments name; as long as the reader, until
  // refresh().
  virtual std::span<const RansLookup> tables() const = 0;
  // Scene::importance, segment after segment; empty where the file does not have it.
  virtual Result<std::vector<float>> importance() const = 0;
};

// What the planes of the other profiles are coded with; the lossless one is always zstd's.
enum class SceneCoder {
  kRans,
  kZstd,  // larger and slower to decode: for comparing
};

struct WriteSettings {
  Profile profile = Profile::kLossless;
  double chunk_seconds = 0;  // the timeline's chunk C; 0: chosen for the lifespans of the scene
  double quality = 87;       // 0..100, not of the lossless profile
  // Not of the lossless profile: how far a primitive may come to lie from where it was, scene
  // units, at any moment at which it is seen; 0: as far as quality has it.
  double max_error = 0;
  // 1..16, not of the lossless profile: of the scene, by importance, of like size; 0: three, or a
  // small one and ever larger ones where a moment has many primitives.
  int tiers = 0;
  SceneCoder coder = SceneCoder::kRans;
  int zstd_level = 9;        // 1..19
  bool own_layouts = false;  // each record tells how it is coded, as one that is appended must
  std::stop_token stop;      // ends encode_scene early, with kRuntime
};

// The bytes of a whole file. `order`, where given, receives for each primitive of the file its
// index in `scene`. All but the lossless profile leave out what is never visible within the clip.
// kNotBuilt as check_profile.
Result<std::vector<std::uint8_t>> encode_scene(const Scene& scene, const WriteSettings& settings,
                                               std::vector<std::uint32_t>* order = nullptr);
// encode_scene, then write_file_atomically.
Status write_scene(const std::string& path, const Scene& scene, const WriteSettings& settings);
// All segments of a file, in which no record is damaged; primitives in file order. Of what
// SceneReader::damage() tells it says nothing: recover_scene (damage_report.h) does.
Result<Scene> read_scene(const std::string& path, const ReadLimits& limits = {});
Result<Scene> read_scene(std::unique_ptr<ByteSource> source, const ReadLimits& limits = {});

// Checks everything that can be checked: structure, checksums, limits, values. Goes on after the
// first finding where the damage allows. An empty list means valid. The error is for a file that
// cannot be read at all, or needs what this build lacks (kNotBuilt).
Result<std::vector<Issue>> validate_scene(const ByteSource& source, const ReadLimits& limits = {});

}  // namespace stgs
