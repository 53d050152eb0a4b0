// SPDX-License-Identifier: Apache-2.0
// From a lossless scene to a compressed .stgs file.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "stgs/encoder/held_out.h"
#include "stgs/encoder/progress.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct PackSettings {
  Profile profile = Profile::kQuantised;  // or kDraco; a build without libdraco answers kNotBuilt
  double quality = 87;                    // 0..100; not looked at where there is a target_kbps
  double target_kbps = 0;  // mean bit rate not to be passed, thousands of bits a second; 0: none
  // How far a primitive may come to lie from where it was at any moment at which it is seen, in
  // thousandths of a scene unit (millimetres, where that is a metre); 0: as quality has it.
  double max_error = 0;
  double chunk_seconds = 0;  // 0: chosen for the lifespans of the scene
  int tiers = 0;             // 1..16; 0: as WriteSettings chooses
  // A prepared capture: the loss is measured on its test cameras too. Empty: none. For one scene.
  std::string against;
  // What the file is to say of its space and its sound, where the scene does not or says it
  // otherwise.
  std::optional<float> metres_per_unit;       // > 0
  std::optional<std::array<float, 3>> up;     // against gravity, of any length but 0
  std::optional<std::array<float, 3>> floor;  // a point of the floor; where up is known
  // Where the scene's sound is (SceneMetadata::audio), and when it begins, seconds.
  std::optional<std::string> audio;
  double audio_begin = 0;
};

// What pack() would refuse of up and floor for a scene that says nothing of them: kUsage.
Status check_up_and_floor(const PackSettings& settings);

// A merged window: the frames at which its primitives are drawn.
struct PackedPart {
  std::string input;
  double begin_ticks = 0, end_ticks = 0;
  std::uint64_t primitives = 0;  // written
};

struct PackReport {
  Profile input_profile = Profile::kLossless;
  std::uint64_t primitives = 0;  // written
  std::uint64_t dropped = 0;     // never visible within the clip
  // Segments of damaged inputs that are left out, and those that lost their harmonics alone.
  std::uint64_t damaged_segments = 0, damaged_sh_segments = 0;
  std::uint64_t bytes_in = 0, bytes_out = 0;
  double bytes_per_primitive = 0;
  double quality = 0;             // that it was packed with
  double kbps = 0;                // mean bit rate
  std::vector<PackedPart> parts;  // in the order of time; empty for one scene
  // Largest and root-mean-square errors of what was written, measured by decoding it.
  double position_max = 0, position_rms = 0;  // scene units, at the moment where it is greatest
  double colour_rms = 0;                      // of the degree-0 colour, sRGB-encoded, 0..1
  double opacity_max = 0;                     // 0..1
  // Of opacity and lifespan together: opacity at a frame, 0..1. Then of T and r, frames, and sigma,
  // natural log, of what is not seen alike throughout its part.
  double visibility_max = 0, time_max = 0, radius_max = 0, sigma_max = 0;
  // PSNR of its pictures against the scene's, dB (src/pack/render_psnr.h); none without a start
  // camera.
  std::optional<double> images_psnr;
  // On the test cameras of PackSettings::against: the scene and what was written.
  std::optional<HeldOutScore> held_out_before, held_out_after;
};

// Reads a scene, or the windows of a capture, which are merged (windows.h); writes it packed
// (atomically), decodes the result and reports its errors; `report` may be null. Stage "pack";
// where `progress` says to stop, nothing is written (kRuntime). kUsage where nothing is small
// enough for target_kbps, kUnsupported where positions cannot keep max_error. A scene that is
// quantised already is packed with a warning: its errors stay, new ones come. So is what is sound
// of a damaged one (damage_report.h).
Status pack(const std::vector<std::string>& scene_paths, const std::string& output_path,
            const PackSettings& settings, PackReport* report, const ProgressSink& progress = {},
            const LogSink& log = {});

}  // namespace stgs::encoder
