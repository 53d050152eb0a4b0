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
#include "stgs/format/quantisation.h"
#include "stgs/format/read_limits.h"
#include "stgs/format/segment_ends.h"
#include "stgs/format/status.h"
#include "stgs/format/write_parameters.h"

namespace stgs {

// The format version that this library writes. It reads every minor version of the same major one.
inline constexpr std::uint16_t kFormatMajor = 2;
inline constexpr std::uint16_t kFormatMinor = 0;

// The coding of a file's primitives.
enum class Profile : std::uint16_t {
  kLossless = 0,   // every float unchanged
  kQuantised = 1,  // bounded error, tiers by importance, Morton order
  kDraco = 2,      // kQuantised with positions as Draco point clouds
  // kQuantised with steps whose errors no render reveals, the same for all tiers; states the bounds
  kNearLossless = 3,
  kUnknown = 0xFFFF,  // of a later version; is read as kQuantised and cannot be written
};

// Returns "lossless", "quantised", "draco", "near-lossless" or "unknown".
const char* profile_name(Profile profile);
// Checks that this build can write the profile and decode its segments; kNotBuilt otherwise, kUsage
// for kUnknown.
Status check_profile(Profile profile);

// A pinhole camera to start playback from; world-to-camera, OpenCV axes.
struct StartCamera {
  float rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // row-major
  float translation[3] = {0, 0, 0};
  float fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  std::uint32_t width = 0, height = 0;   // pixels
};

// Converts a start camera for the renderers. `near_plane` is in scene units.
math::PinholeCamera pinhole_of(const StartCamera& camera, float near_plane);

// The position of a scene in the longer capture of which it is one training window (spec 4.5).
struct CaptureWindow {
  std::uint32_t first_frame = 0;     // frame of the capture at the scene's time 0
  std::uint32_t capture_frames = 0;  // length of the capture
  std::uint64_t capture = 0;         // equal for windows of one capture
  std::uint64_t training = 0;        // equal for windows trained with the same settings
  bool operator==(const CaptureWindow&) const = default;
};

// The metadata stored in a file.
struct SceneMetadata {
  TimeBase time_base;
  std::uint32_t frames = 0;         // duration in ticks: times [0, frames)
  float metres_per_unit = 0;        // > 0; 0: unknown
  float up[3] = {0, 0, 0};          // unit vector against gravity; 0, 0, 0: unknown
  float floor[3] = {0, 0, 0};       // a point of the floor, scene units; valid if `up` is known
  float background[3] = {0, 0, 0};  // in the encoding of `primaries` and `transfer`
  float bounds_min[3] = {0, 0, 0};  // of the positions; computed by the writer
  float bounds_max[3] = {0, 0, 0};
  float near_plane = 0.01f;  // scene units; content nearer than this was never trained
  std::optional<StartCamera> start_camera;
  std::string generator;  // program and version that wrote the file
  std::string title;
  // Location of the scene's audio: a URI reference relative to the location of the file (RFC 3986);
  // empty: none. It starts at audio_begin, ticks. The library does not fetch it.
  std::string audio;
  double audio_begin = 0;
  // Encoding of the colours: code points of ITU-T H.273 (spec 4.4). BT.709 primaries, sRGB.
  std::uint8_t primaries = 1, transfer = 13;
  // Conventions of later versions that may be treated as 0 (spec 4.2); kept when rewriting a file.
  std::uint8_t kernel = 0, sh_convention = 0;
  std::optional<CaptureWindow> window;
};

// Differences of an attribute to the source that was coded, over all primitives, in the attribute's
// unit: lengths of vectors for positions and velocities, radians for rotations. Spec 4.7 defines
// which properties of a source are compared.
struct ErrorBound {
  Attribute attribute = Attribute::kPosition;
  float greatest = 0, rms = 0;
};

// A range of times [begin, end), ticks.
struct TickRange {
  double begin = 0, end = 0;
  bool operator==(const TickRange&) const = default;
};

// A run of successive primitives that is rendered only at times in [begin_ticks, end_ticks), or in
// `cut` (spec 5.4). A part that reaches the end of the timeline includes that end. The times of
// its primitives count from begin_ticks, so single precision is sufficient however late the part
// is; read_scene() states how long it may be. A part may begin before the timeline and end after
// it, but is displayed within it. All times are multiples of 2^-20, at most 2^32, and no part is
// longer than that.
struct ScenePart {
  double begin_ticks = 0, end_ticks = 0;
  std::uint64_t primitives = 0;
  // The times at which it is displayed, if they are not the complete range; at or after 0.
  std::optional<TickRange> cut = {};

  // Returns the times at which the part is displayed.
  TickRange displayed_range() const { return cut.value_or(TickRange{begin_ticks, end_ticks}); }
  // Returns whether the primitives are rendered at a time of a timeline of `frames` frames.
  bool shows(double ticks, std::uint32_t frames) const {
    const TickRange range = displayed_range();
    return ticks >= range.begin && (ticks < range.end || (range.end >= frames && ticks <= frames));
  }
  bool operator==(const ScenePart&) const = default;
};

struct Scene {
  SceneMetadata metadata;
  Gaussians4D gaussians;
  // Cover all primitives, in order. Empty: one part that spans the clip.
  std::vector<ScenePart> parts;
  // N values, or empty if unknown: over the pixels of many views, the sum of the squared blending
  // weight of the primitive. Writers derive tiers and quantisation steps from it.
  std::vector<float> importance;
  // The steps that the scene was trained for; requires importances. Its values are multiples of
  // them.
  std::optional<Quantisation> quantisation;
};

// A tier of a segment: primitives that are rendered only within [begin_ticks, end_ticks].
// Tier 0 has the most important ones. The first tiers, in any number and with or without their SH,
// give a complete image.
struct SegmentInfo {
  // -1: persistent, spans its part; otherwise it spans chunk * 2^level.
  std::int32_t level = 0;
  std::uint32_t primitives = 0;
  double begin_ticks = 0, end_ticks = 0;  // the times at which it is needed; see is_needed()
  std::uint64_t offset = 0, bytes = 0;    // of its base record in the file
  // Record of the SH above degree 0, if they can be fetched separately; else 0 bytes.
  std::uint64_t sh_offset = 0, sh_bytes = 0;
  std::uint32_t part = 0;  // index into SceneReader::parts()
  std::uint8_t tier = 0;
  // False: beyond the end of a truncated file. sh_available is true if there is no SH record.
  bool available = true, sh_available = true;
  // Whether end_ticks is one of these times: unless the part ends there before the timeline
  // does (spec 5.4).
  bool needed_at_end = false;

  // Returns whether the segment is needed at any time.
  bool is_needed() const {
    return begin_ticks < end_ticks || (begin_ticks == end_ticks && needed_at_end);
  }
};

// Content that the remaining index does not list, because a node of it is damaged (spec 9.5, 10.1).
struct LostFragment {
  TickRange range;  // closed; times at which the content would be needed, ticks
  // Bytes of the file that are lost: of a recording's fragment, or of the node alone.
  std::uint64_t offset = 0, bytes = 0;
  bool operator==(const LostFragment&) const = default;
};

// The layout of a file (spec 2.1).
enum class SceneForm {
  kFinished,  // index first
  kGrowing,   // recorded live, with the index in fragments; more may follow
  kRecorded,  // recorded live and closed: nothing follows
};

// Bytes spent on one attribute in the complete file, and its error.
struct StreamInfo {
  std::string name;                        // "position", "sh0", ...
  std::uint64_t bytes = 0, raw_bytes = 0;  // bytes: 0 if the file does not state them
  std::optional<ErrorBound> error;         // as the writer measured it, if the file states it
};

// One finding of a validation.
struct Issue {
  int number = 0;            // stable; listed in spec/conformance.md
  bool error = true;         // false: a warning
  std::uint64_t offset = 0;  // byte of the file
  std::string message;
};

// How much of an index is read when a file is opened.
enum class IndexLoading {
  kComplete,  // all of it
  kOnDemand   // 16 KiB or less of most files; SceneReader::load() reads the rest
};

// A file opened for random access. Opening reads and checks header, metadata and index; everything
// else is read on demand. Thread-safe after open(), except refresh() and load().
class SceneReader {
 public:
  // Opens a file. Decoded sets are allocated from `memory`, from several threads at once; it must
  // outlive the reader and those sets.
  static Result<std::unique_ptr<SceneReader>> open(
      std::unique_ptr<ByteSource> source, const ReadLimits& limits = {},
      std::pmr::memory_resource* memory = std::pmr::get_default_resource(),
      IndexLoading loading = IndexLoading::kComplete);
  // Opens the file at a path. Decoded sets use the default memory resource.
  static Result<std::unique_ptr<SceneReader>> open(const std::string& path,
                                                   const ReadLimits& limits = {});
  ~SceneReader();
  SceneReader(const SceneReader&) = delete;
  SceneReader& operator=(const SceneReader&) = delete;

  // Returns the metadata. Valid until refresh().
  const SceneMetadata& metadata() const;
  // Returns the profile.
  Profile profile() const;
  // Returns the major format version.
  std::uint16_t version_major() const;
  // Returns the minor format version.
  std::uint16_t version_minor() const;
  // Returns the SH degree, 0..3.
  int sh_degree() const;
  // Returns the number of primitives that the file states.
  std::uint64_t primitives() const;
  // Returns the length up to the end of the complete content, bytes.
  std::uint64_t file_bytes() const;
  // Returns the number of bytes of the head and of the index that were read, which is all that is
  // needed to locate the loaded segments.
  std::uint64_t head_bytes() const;
  // Returns the memory that the reader takes at most for the head and the loaded index, bytes.
  std::uint64_t memory_bytes() const;
  // Returns the offset up to which nothing of the file is read again when it has grown.
  std::uint64_t final_bytes() const;
  // Returns the layout of the file.
  SceneForm form() const;
  // Returns the number of bytes of a growing file after its last complete fragment: they are being
  // written, or were cut off.
  std::uint64_t incomplete_bytes() const;
  // Returns problems that open() found but could read past, such as truncation. Available segments
  // can still be decoded.
  const std::vector<Issue>& damage() const;
  // Returns the number of bytes missing at the end of a finished file.
  std::uint64_t missing_bytes() const;
  // Returns the content that damaged nodes of the index listed. damage() has an issue for each.
  const std::vector<LostFragment>& lost_fragments() const;
  // Returns the time up to which the scene is complete, ticks: the earliest time of a segment that
  // is missing, lacks its SH, or is lost; the duration if there is none.
  double complete_ticks() const;
  // Loads the segments that are needed at times of [t0, t1], ticks, and later ones so that the
  // loaded index grows by an eighth: the time of all calls is proportional to its size. New
  // segments follow the existing ones; references become invalid as by refresh(). No other thread
  // may use the reader meanwhile. After an error the reader is unchanged.
  Status load(double t0, double t1);
  // Returns whether all segments that are needed at times of [t0, t1] are loaded, or known to be
  // lost.
  bool is_loaded(double t0, double t1) const;
  // Returns the times, as closed ranges that may overlap, at which more segments may be needed than
  // are loaded.
  std::vector<TickRange> unloaded() const;
  // Returns a copy that reads from another source of the same file, after load(t0, t1).
  Result<std::unique_ptr<SceneReader>> loaded(std::unique_ptr<ByteSource> source, double t0,
                                              double t1) const;
  // Returns a copy that reads from another source of the same file, after refresh().
  Result<std::unique_ptr<SceneReader>> refreshed(std::unique_ptr<ByteSource> source) const;
  // Checks whether a growing file has grown. Returns true if there are new segments, which follow
  // the existing ones, and a larger metadata().frames. References returned by metadata(),
  // segments() and parts() become invalid; segment indices stay valid. No other thread may use the
  // reader meanwhile. After an error the reader is unchanged.
  Result<bool> refresh();
  // Returns the duration of the shortest segments of the first part, ticks; 1 if there is none.
  double chunk_ticks() const;
  // Returns whether the head has layouts for all records (spec 6.1); otherwise each record has its
  // own.
  bool has_layouts() const;
  // Returns the loaded segments: part after part if the index was loaded when the file was opened,
  // by offset in the file. Valid until refresh() or load().
  const std::vector<SegmentInfo>& segments() const;
  // Returns the parts of the loaded segments, without ends. Valid until refresh() or load().
  const std::vector<ScenePart>& parts() const;
  // Returns the latest beginning of a part, ticks; 0 if there is none.
  double latest_begin_ticks() const;
  // Returns the bytes of each attribute, in file order.
  std::vector<StreamInfo> streams() const;
  // Returns the indices, ascending, of the loaded segments that contain primitives active at some
  // time in [t0, t1], ticks. Uses the index alone.
  std::vector<std::uint32_t> segments_between(double t0, double t1) const;
  // Returns the origin with which the times of a segment are exact enough for rendering: kPart in a
  // part of at most 2^14 ticks, which rounds them by at most 2^-11 ticks, and kRecord in a longer
  // one.
  TimeOrigin render_origin(std::uint32_t segment) const;
  // Decodes one segment. With `with_sh` false, SH above degree 0 that are stored separately are not
  // read and become 0. Times that count from the beginning of the part are rounded to single
  // precision: at 2^k ticks, by up to 2^(k-24) ticks.
  Result<Gaussians4D> decode(std::uint32_t segment, bool with_sh,
                             TimeOrigin origin = TimeOrigin::kPart) const;
  // Decodes as decode() does, but passes the primitives to `visit` range by range, each small
  // enough for the CPU's cache, with SH up to the greatest degree that was read. After an error,
  // the ranges are invalid.
  Status decode_ranges(std::uint32_t segment, bool with_sh, TimeOrigin origin,
                       const RangeVisitor& visit) const;
  // Decodes the positions and times of one segment alone, in a fraction of the time: enough to sort
  // its primitives.
  Result<Placement> decode_placement(std::uint32_t segment) const;
  // Decodes one segment with its SH. Times count from the beginning of its part.
  Result<Gaussians4D> decode(std::uint32_t segment) const { return decode(segment, true); }
  // Decodes the intact records of a segment (spec 10.1). If only its SH record is damaged, missing
  // or of a later version, SH above degree 0 are 0 and `sh_status` has the reason; otherwise
  // `sh_status` is ok.
  Result<Gaussians4D> decode_intact(std::uint32_t segment, Status& sh_status,
                                    TimeOrigin origin = TimeOrigin::kPart) const;
  // Reads one segment without decoding it, for a decoder on another device. Verifies the checksums
  // of its records; damage that only decoding reveals (spec 7.4) is left to the decoder.
  Result<CodedSegment> read(std::uint32_t segment, bool with_sh,
                            TimeOrigin origin = TimeOrigin::kPart) const;
  // Returns whether the file may have ends.
  bool may_end() const;
  // Returns the loaded ends of a segment, ascending by primitive. Decoding applies them.
  std::vector<SegmentEnd> ends(std::uint32_t segment) const;
  // Returns the offsets of the loaded records of ends.
  std::vector<std::uint64_t> end_records() const;
  // Returns the segments, ascending, that have ends in loaded records other than `known`: those
  // decoded when only these were loaded are outdated.
  std::vector<std::uint32_t> ended_segments(std::vector<std::uint64_t> known) const;
  // Returns the tables of the file, which its records refer to by number. Valid until refresh().
  std::span<const RansLookup> tables() const;
  // Reads Scene::importance, segment after segment; empty if the file has none. kUsage unless the
  // index is loaded completely.
  Result<std::vector<float>> importance() const;
  // Returns Scene::quantisation, if the file has a valid one. Valid until refresh().
  const std::optional<Quantisation>& quantisation() const;
  // Returns the errors that the writer measured; empty if the file states none, as lossless files
  // and recordings. Valid until refresh().
  const std::vector<ErrorBound>& error_bounds() const;

 private:
  struct State;
  friend struct ListedSegment;
  explicit SceneReader(std::unique_ptr<State> state);

  std::unique_ptr<State> state_;
};

// The coder of planes.
enum class SceneCoder {
  kRans,   // the default, where it saves bytes
  kBytes,  // the planes as they are, for tests and comparisons
};

struct WriteSettings {
  Profile profile = Profile::kLossless;
  double chunk_seconds = 0;  // chunk of the timeline; 0: chosen for the lifespans of the scene
  double quality = 87;       // kQuality; ignored by the lossless and the near-lossless profile
  // Use Scene::quantisation, if there is one, in place of `quality`. Ignored if max_error or tiers
  // are set, and by the near-lossless profile.
  bool own_steps = false;
  // Greatest displacement of a primitive while it is visible, scene units; 0: given by the quality.
  // Ignored by the lossless profile.
  double max_error = 0;
  // kTiers. 0: three of similar size, or a small one followed by larger ones if many primitives are
  // visible at once. Ignored by the lossless profile.
  int tiers = 0;
  SceneCoder coder = SceneCoder::kRans;
  bool own_layouts = false;  // each record contains its layout, as appended records must
  std::stop_token stop;      // makes encode_scene() return early, with kRuntime
};

// Encodes a complete file in memory. All profiles except the lossless one state the errors
// (SceneReader::error_bounds()). `order`, unless null, receives for each primitive of the file
// its index in `scene`. All profiles except the lossless one omit primitives that are never visible
// within the clip. kNotBuilt as check_profile().
Result<std::vector<std::uint8_t>> encode_scene(const Scene& scene, const WriteSettings& settings,
                                               std::vector<std::uint32_t>* order = nullptr);
// Encodes a scene and writes it with write_file_atomically().
Status write_scene(const std::string& path, const Scene& scene, const WriteSettings& settings);
// Reads all segments of a file; primitives in file order. Fails if any record is damaged. Does not
// report SceneReader::damage(); recover_scene() (damage_report.h) does. Times are rounded to single
// precision: at 2^k ticks after the beginning of a part, by up to 2^(k-24) ticks. kUnsupported if
// segments with quantised times begin more than 2^20 ticks, 4.9 hours at 60 ticks per second, after
// that of their part: SceneReader::decode() with TimeOrigin::kRecord is exact.
Result<Scene> read_scene(const std::string& path, const ReadLimits& limits = {});
// As above, from a source.
Result<Scene> read_scene(std::unique_ptr<ByteSource> source, const ReadLimits& limits = {});

// Checks structure, checksums, limits and values of a file. Continues after the first finding as
// far as the damage allows. An empty list means valid. Fails if the file cannot be read at all, or
// needs a feature that this build lacks (kNotBuilt).
Result<std::vector<Issue>> validate_scene(const ByteSource& source, const ReadLimits& limits = {});

}  // namespace stgs
