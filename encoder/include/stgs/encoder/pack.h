// SPDX-License-Identifier: Apache-2.0
// Compresses a lossless scene to a packed .stgs file.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stgs/encoder/held_out.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/rate_parameters.h"
#include "stgs/format/parameter.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// PackParameters describes the numbers.
struct PackSettings {
  // Or kDraco (kNotBuilt in a build without libdraco), or kNearLossless, which takes neither a
  // quality nor a limit or target.
  Profile profile = Profile::kQuantised;
  // 0: the steps that the scene was trained for or, without any, WriteSettings::quality. Ignored if
  // there is a limit.
  double quality = 0;
  // Limits and target of the file, of which at most one is set. For a limit, a scene with steps of
  // its own keeps them, and the primitives of least importance are left out. Otherwise the quality
  // falls first, but not below 70.
  double target_kbps = 0;
  double target_size = 0;  // bytes
  double target_psnr = 0;  // dB, of renders against those of the scene: the smallest such file
  double max_error = 0;
  double chunk_seconds = WriteSettings{}.chunk_seconds;
  int tiers = WriteSettings{}.tiers;
  // Folder of a prepared capture whose test cameras measure the packing loss; empty: none. Valid
  // for a single scene only, not for windows.
  std::string against;
  // Or that capture itself, with frames that may be in memory alone; null: none.
  std::shared_ptr<const PreparedCapture> against_capture = nullptr;
  // The score of the scene itself on these cameras, if it is known (TrainReport::held_out).
  std::optional<HeldOutScore> held_out_before = std::nullopt;
  bool allow_outside = false;  // links in `against` may lead out of it
  bool foreground = false;     // the scene was trained with TrainSettings::foreground
  // Metadata to write in place of the scene's; unset or 0: the scene's.
  double metres_per_unit = 0;
  std::optional<std::array<float, 3>> up;     // against gravity, of any length but 0
  std::optional<std::array<float, 3>> floor;  // a point of the floor; requires a known up vector
  // Location of the scene's audio (SceneMetadata::audio), and the time at which it begins.
  std::optional<std::string> audio;
  double audio_begin = 0;
  ReadLimits limits = {};  // of each scene
};

// Bounds of the components of vectors in metadata.
inline constexpr Parameter kUp = {"up", -1e9, 1e9, "Metadata: up direction, against gravity"};
inline constexpr Parameter kFloor = {"floor", -1e9, 1e9, "Metadata: a point on the floor",
                                     "scene units"};

inline constexpr Parameter kPackQuality = {
    "quality", 0.1,
    100,       "0.1 (smallest file) to 100 (closest to the trained scene)",
    "",        "the steps that the scene was trained for, or else 87"};

// Numbers that pack and the recorder share.
inline constexpr Parameter kMaxError = {"max_error",
                                        1e-6,
                                        1e9,
                                        "Largest position error of a primitive at any time",
                                        "thousandths of a scene unit (mm if the unit is a metre)",
                                        "the value of quality"};
inline constexpr Parameter kChunkSeconds = {
    "chunk_seconds",         0.01,     3600, "Shortest segment of the timeline", "seconds",
    "a choice by lifespans", "--chunk"};
inline constexpr Parameter kMetresPerUnit = {
    "metres_per_unit", 1e-9, 1e9, "Metadata: metres per scene unit", "", "the value of the scene"};
inline constexpr Parameter kAudioBegin = {"audio_begin",
                                          -1e6,
                                          1e6,
                                          "Metadata: time in the clip at which the audio starts",
                                          "seconds",
                                          nullptr,
                                          "--audio-offset"};

// The table (stgs/format/parameter.h) of PackSettings and stgs_pack_settings.
struct PackParameters {
  template <typename Visit>
  static void for_each(Visit visit) {
    visit(kPackQuality, STGS_MEMBER(quality));
    visit(kTargetKbps, STGS_MEMBER(target_kbps));
    visit(kTargetSize, STGS_MEMBER(target_size));
    visit(kTargetPsnr, STGS_MEMBER(target_psnr));
    visit(kMaxError, STGS_MEMBER(max_error));
    visit(kChunkSeconds, STGS_MEMBER(chunk_seconds));
    visit(kTiers, STGS_MEMBER(tiers));
    visit(kMetresPerUnit, STGS_MEMBER(metres_per_unit));
    visit(kAudioBegin, STGS_MEMBER(audio_begin));
  }
};

// Checks the settings as pack() does before it reads a scene; `up` and `floor` for a scene that has
// neither. Returns kUsage or kNotBuilt if pack() would reject them.
Status check_packing(const PackSettings& settings);

struct PackReport {
  Profile input_profile = Profile::kLossless;
  std::uint64_t primitives = 0;  // written
  std::uint64_t dropped = 0;     // never visible within the clip
  // Segments of a damaged input: left out, and packed without their SH coefficients.
  std::uint64_t damaged_segments = 0, damaged_sh_segments = 0;
  std::uint64_t bytes_in = 0, bytes_out = 0;
  double bytes_per_primitive = 0;
  double quality = 0;          // used or found for a limit; 0: near-lossless
  std::uint64_t left_out = 0;  // for the limit: primitives of least importance
  double kbps = 0;             // mean bit rate
  // Largest and root-mean-square errors of the written file, measured by decoding it.
  double position_max = 0, position_rms = 0;  // scene units, at the time of the largest error
  double colour_rms = 0;                      // of the degree-0 colour, sRGB-encoded, 0..1
  double opacity_max = 0;                     // 0..1
  // visibility_max: opacity times lifespan at a frame, 0..1. The others cover primitives whose
  // visibility varies over their part: T and r in frames, sigma as a natural logarithm.
  double visibility_max = 0, time_max = 0, radius_max = 0, sigma_max = 0;
  // PSNR of renders of the packed scene against renders of the input scene, dB
  // (src/pack/render_psnr.h); unset if the scene has no start camera.
  std::optional<double> images_psnr;
  // Scores on the test cameras of PackSettings::against: of the input scene, and of the packed one.
  std::optional<HeldOutScore> held_out_before, held_out_after;
};

// Reads a scene, writes it packed (atomically), decodes the result and reports its errors.
// - `report`, `progress` and `log` may be null. The progress stage is "pack".
// - kRuntime if `progress` cancels; nothing is written then.
// - kUsage if a setting is out of range or no file is within the limit; kUnsupported if
// positions cannot meet max_error.
// - Warns about an input that is already quantised: its errors remain and new ones are added.
// - Packs the intact part of a damaged input, with a warning (damage_report.h).
Status pack(const std::string& scene_path, const std::string& output_path,
            const PackSettings& settings, PackReport* report, const ProgressSink& progress = {},
            const LogSink& log = {});

}  // namespace stgs::encoder
