// SPDX-License-Identifier: Apache-2.0
// The structures of .4dgs files, version 1, and their arithmetic. Times are in seconds.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/bytes.h"
#include "interchange/import_memory.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/scene_file.h"

namespace stgs::fourdgs {

using Bytes = std::vector<std::uint8_t>;
using View = std::span<const std::uint8_t>;

inline constexpr std::array<std::uint8_t, 8> kMagic = {0x89, '4', 'D', 'G', 'S', '1', '\r', '\n'};
inline constexpr std::size_t kVersionByte = 5;  // of the magic
inline constexpr std::size_t kRecordHead = 9;   // opcode and length
inline constexpr char kBirth[] = "gaussian-birth", kKeyframes[] = "keyframe-delta";
inline constexpr char kScheme[] = "uniform-v1";
inline constexpr char kDisplayColour[] = "srgb-rec709-display";
inline constexpr char kLinearColour[] = "linear-rec709-display";
// Keys of the header's attributes. The last one is ours: the duration of a frame, "1/30".
inline constexpr char kColourKey[] = "color_space", kTitleKey[] = "title",
                      kAxesKey[] = "coordinate_system", kFrameKey[] = "stgs_frame_seconds";

enum Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kQuantization = 0x03,
  kWindowTable = 0x04,
  kChunk = 0x05,
  kBand = 0x07,
  kChunkIndex = 0x08,
  kAudio = 0x09,
  kCamera = 0x0A,
  kMetadata = 0x0B,
  kStatistics = 0x0C,
  kAttachment = 0x0D,
  kSummaryOffset = 0x0F,
  kDeltaChunk = 0x10,
  kAudioSource = 0x11,
  kAudioData = 0x12,
  kFrame = 0x20,
  kObjectTable = 0x24,
  kObjectTrack = 0x25,
};

// The streams of a chunk, by their number in the file.
enum Attribute : std::uint8_t {
  kPosition,
  kScale,
  kRotationIndex,
  kRotation,
  kColour,
  kOpacity,
  kMotion,
  kTime,
  kSigma,
  kFlags,
  kWindow,
  kAttributes,  // those above are required
  kGaussianId = 13,
  kObjectId = 14,
};
inline constexpr std::array<std::size_t, kAttributes> kChannels = {3, 3, 1, 3, 3, 1, 3, 1, 1, 1, 1};
inline constexpr std::uint8_t kNeverFades = 1;  // bit of kFlags

// Gaussians per byte of a chunk, which may have constant streams only. zstd expands by as much.
inline constexpr std::uint64_t kMaxPerByte = 32768;

// The numbers of SH coefficients before a band and after it, of the list without degree 0.
struct BandRange {
  std::size_t first, last;
};
inline constexpr BandRange band_range(int band) {
  const auto b = static_cast<std::size_t>(band);
  return {b * b - 1, (b + 1) * (b + 1) - 1};
}
inline constexpr int kMaxBand = 3;
// An SH byte b is the coefficient -4 + b * 8 / 255.
inline constexpr double kShLow = -4.0, kShStep = 8.0 / 255.0;

struct Header {
  std::string profile, library, model;
  double duration = 0, cutoff = 0.05;
  std::uint64_t gaussians = 0;
  std::array<double, 6> bounds{};
  int sh_degree = 0;
  std::uint8_t flags = 0;
  std::map<std::string, std::string> attributes;
};

// The steps of the stored integers, and what the steps per Gaussian depend on.
struct Grid {
  std::array<double, 3> origin{};
  double position = 1, log_scale = 1, rotation = 1, colour = 1, opacity = 1, motion = 1, time = 1,
         log_sigma = 1;
  double cutoff = 0.05;

  // Standard deviations between the centre of a fade and the cut-off.
  double reach() const { return std::sqrt(-2 * std::log(cutoff)); }
  // Step of the velocity of a Gaussian, which is finer for long lifespans.
  double motion_step(std::int64_t sigma_bin, bool never_fades, double window_length) const;
  // Step of the centre of a fade: at most a twentieth of its width, within limits.
  double time_step(std::int64_t sigma_bin, bool never_fades) const;
};

// [begin, end), seconds.
struct Window {
  double begin = 0, end = 0;
};

// The integers of some Gaussians.
struct Population {
  std::vector<std::uint32_t> ids;  // keyframe-delta only
  std::array<std::vector<std::int32_t>, kAttributes> bins;
  std::vector<std::uint8_t> sh;        // coefficient then channel, without degree 0
  std::vector<std::uint32_t> objects;  // empty: all 0
  Lease lease;                         // of the arrays of a set that was read

  std::size_t size() const { return bins[kOpacity].size(); }
  // Returns the bytes of all arrays.
  std::uint64_t bytes() const;
};

// One Gaussian, dequantised.
struct Gaussian {
  std::array<double, 3> position, log_scale, rgb, motion;
  std::array<double, 4> rotation;  // w x y z
  double opacity, centre;
  double deviation;  // of its fade; infinite: it never fades
};

// Dequantises Gaussian i. Its rotation index must be valid.
Gaussian dequantise(const Population& set, std::size_t i, const Grid& grid, const Window& window);

// Returns the visibility of a Gaussian at a time in its window: 0 below the cut-off.
double visibility(const Gaussian& g, double seconds, double cutoff);

// Returns whether a Gaussian is invisible at all times of its window in a clip.
bool is_never_visible(const Gaussian& g, const Window& window, double duration, double cutoff);

// A list of integers with interleaved channels.
struct Stream {
  std::uint8_t attribute = 0;
  std::size_t channels = 0, count = 0;
  std::vector<std::int32_t> values;
  Lease lease;  // of the values
};

// Name and offset of the structure being read, for messages.
struct Place {
  std::string file;
  std::uint64_t byte = 0;

  std::string text() const { return fmt::format(" [byte {}]", byte); }
};

// Returns a string of a file for a message: its first characters, with dots for control characters.
std::string short_text(const std::string& text);

// The coders of streams and chunks.
enum Codec : std::uint8_t { kDeflate = 0, kZstd = 1 };
// Decompresses `packed` to exactly `bytes` bytes, after checking that it can contain that many.
Result<ChargedBytes> decompress(View packed, Codec codec, std::uint64_t bytes, ImportMemory& memory,
                                const Place& place);
// Returns the contents of a chunk, which it compresses with the named coder ("": none).
Result<ChargedBytes> unpack_chunk(View packed, const std::string& codec, std::uint64_t bytes,
                                  ImportMemory& memory, const Place& place);
// Reads the streams of `count` Gaussians from a block that contains nothing else. `required`: all
// attributes must be present; otherwise those absent stay empty. `with_ids`: the block must have
// identities. Charges the arrays to the lease of `out`.
Status read_population(View block, std::size_t count, bool required, bool with_ids,
                       ImportMemory& memory, const Place& place, Population& out);
// Reads an SH band of `count` Gaussians: component-major bytes 0..255.
Result<Stream> read_band(View content, std::size_t count, int& band, ImportMemory& memory,
                         const Place& place);
// Appends a stream, coded in the smallest of the ways that the format has.
void write_stream(ByteWriter& out, std::uint8_t attribute, std::size_t channels,
                  std::span<const std::int32_t> values);

// Reads a map of strings; sets ok to false if its length is wrong.
std::map<std::string, std::string> read_map(ByteReader& in, bool& ok);
void write_map(ByteWriter& out, const std::map<std::string, std::string>& map);
// Appends a record.
void write_record(ByteWriter& out, std::uint8_t opcode, View content);

Result<Header> parse_header(View content, const Place& place);
Result<Grid> parse_quantization(View content, const Place& place);
Result<std::vector<Window>> parse_windows(View content, const Place& place);

}  // namespace stgs::fourdgs
