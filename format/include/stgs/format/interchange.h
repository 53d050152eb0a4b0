// SPDX-License-Identifier: Apache-2.0
// Conversion from and to formats of static Gaussian splats: 3DGS PLY, packed PLY, SPZ, SOG, glTF;
// and export to USD.
//
// A static set is a Scene of one frame whose primitives have the static lifespan (see below). Axes:
// .stgs scenes and 3DGS PLY files use OpenCV's (x right, y down, z forward). The axes of another
// format are stated with its functions, which convert positions, rotations and SH.
//
// Readers check every count against the bytes present and the caller's limits before they allocate.
// They drop primitives that cannot be rendered (a NaN, or a rotation of length 0) and add a note
// with the number dropped. Writers reject such a set (kUsage). All functions are stateless and may
// run on any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/math/project.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {

// Changes and omissions of a conversion, one sentence each, for display. Functions append to it.
using ConversionNotes = std::vector<std::string>;

// Returns the metadata of a scene as a list for a note, such as "the background colour, the audio
// location"; "" if there is none. `camera`: the name of the start camera in the list. `described`:
// whether the list includes the title and the metres per unit.
std::string list_metadata(const SceneMetadata& metadata, const char* camera, bool described);
// Adds a note if the splats are band-limited, for a format that cannot state it.
void note_kernel(int kernel, const char* format, ConversionNotes* notes);

// Makes primitives static and fully visible over a clip of `frames` ticks: T = frames / 2, u = 0,
// sigma = 1, r = frames.
void set_static_lifespan(Gaussians4D& set, std::uint32_t frames = 1);
// Returns a scene of one frame of 1/30 s. Its primitives get the static lifespan.
Scene static_scene(Gaussians4D set);

// Returns the primitives visible at a time, in the order of the scene, as a static set: positions
// are moved, opacities are multiplied by l(t), and lifespans are static. Omits primitives whose
// opacity is then below 1/255, and those of parts that are not displayed at that time. kUsage if
// `ticks` is outside [0, frames].
Result<Gaussians4D> snapshot_at(const Scene& scene, double ticks);

// Mirrors the axes whose sign is -1, in positions, velocities, rotations and SH. Mirroring two axes
// is a half turn about the third. The function is its own inverse.
void flip_axes(Gaussians4D& set, int x, int y, int z);

// Reads a 3DGS PLY, binary little-endian or ASCII. Properties are found by name, in any order and
// with any scalar type; others are skipped. The number of f_rest properties determines the SH
// degree, up to 3. Also reads the packed PLY of PlayCanvas (elements chunk, vertex, sh).
// kUnsupported for other kinds of PLY.
Result<Scene> read_ply(const ByteSource& source, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);
// Writes a binary little-endian PLY as 3DGS does. Every float is written unchanged. Lifespans are
// ignored.
Result<std::vector<std::uint8_t>> write_ply(const Gaussians4D& set);

// Reads SOG version 2 of PlayCanvas: a .sog bundle, a meta.json, a folder that contains one, or a
// folder of such bundles and folders, which are merged in name order. Axes: as 3DGS PLY.
// kUnsupported for version 1 and for streamed sets with levels of detail; kNotBuilt without libwebp
// or libzip.
Result<Scene> read_sog(const std::string& path, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);

// Reads SPZ (github.com/nianticlabs/spz) versions 2 and 3 (gzip) and 4. Axes: x right, y up, z back
// unless the file states others. SH of degree 4 are dropped, with a note.
Result<Scene> read_spz(const ByteSource& source, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);
// Writes SPZ version 4, primitives in their order. kUnsupported for a set without primitives.
//
// Rounds:
// - positions to 2^-12, or as fine as the farthest one allows
// - log scales to 1/16
// - opacity and colour to 8 bits
// - rotations to 10 bits per component
// - SH to 5 bits (degree 1) and 4 bits (above)
//
// Clips, with a note:
// - log scales to [-10, 5.94]
// - colours to [-0.44, 1.44]
// - SH to [-1, 1]
// The file states whether its splats are band-limited (`kernel`).
Result<std::vector<std::uint8_t>> write_spz(Gaussians4D set, ConversionNotes* notes = nullptr,
                                            int kernel = math::kDilated);

// Writes binary glTF (.glb) with KHR_gaussian_splatting, all attributes as floats. Axes: x left,
// y up, z forward. kUnsupported for a set without primitives, and for one that exceeds the 4 GiB of
// a .glb.
Result<std::vector<std::uint8_t>> write_glb(Gaussians4D set);

// Writes a scene as USD text (.usda) with prims of the schema ParticleField3DGaussianSplat (OpenUSD
// 26.03). Axes: x right, y up, z back. A frame is a time code; primitives are visible and move as
// time samples describe, which USD interpolates linearly. Static primitives have no samples; those
// whose opacity changes by at most 1/255 and that move by at most 0.04 of their size are written as
// static. Opacities with samples have steps of 1e-4, other floats are exact. `notes` receives the
// greatest errors, and the omissions. kUnsupported if the text could exceed `max_memory` bytes: up
// to 18 for each float, and 8 for each sample of an opacity.
Result<std::vector<std::uint8_t>> write_usda(const Scene& scene, ConversionNotes* notes = nullptr,
                                             std::uint64_t max_memory = ReadLimits::kDefaultMemory);

// Differences between a set and the result of writing it and reading it back, per primitive.
struct ConversionErrors {
  // Scene units; for each primitive the greatest distance while it is visible.
  double position_max = 0, position_rms = 0;
  // Natural log, and degrees of the smallest rotation: a writer may permute the axes.
  double log_scale_max = 0, rotation_max = 0;
  double opacity_max = 0;                 // 0..1
  double colour_max = 0, colour_rms = 0;  // of the degree-0 colour, sRGB-encoded, 0..1
  double sh_max = 0, sh_rms = 0;          // of the coefficients above degree 0
  // As in LifespanError: 0..1, frames, frames, natural log.
  double visibility_max = 0, time_max = 0, radius_max = 0, sigma_max = 0;
};
// Compares a set with the scene that was read back. Both must have the same size, SH degree and
// order; kRuntime if size or degree differ.
Result<ConversionErrors> conversion_errors(const Gaussians4D& expected, const Scene& actual);

}  // namespace stgs
