// SPDX-License-Identifier: Apache-2.0
// Bridges to the formats of static Gaussian splats: 3DGS PLY, packed PLY, SPZ, SOG, glTF.
//
// A static set is a Scene of one frame whose primitives have the static lifespan (below). Axes: a
// .stgs scene and a 3DGS PLY have OpenCV's (x right, y down, z forward); what another format has is
// stated with it, and positions, rotations and harmonics are turned on the way.
//
// Readers check every count against the bytes present and the caller's limits before they allocate.
// A primitive that cannot be drawn (a value that is no number, a rotation of length 0) is left out,
// and a note says how many were. Writers refuse such a set (kUsage). All functions are free of
// state and may run on any thread.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {

// What a conversion changed or left out, a sentence each, for a person to read. Functions append.
using ConversionNotes = std::vector<std::string>;

// Makes primitives stand still and be fully visible over a clip of `frames` ticks: T = frames / 2,
// u = 0, sigma = 1, r = frames.
void set_static_lifespan(Gaussians4D& set, std::uint32_t frames = 1);
// A scene of one frame of 1/30 s; its primitives get the static lifespan.
Scene static_scene(Gaussians4D set);

// What is seen at a moment, in the order of the scene: positions moved, opacities multiplied by
// l(t), and the static lifespan. What is drawn at less than 1/255 then is left out, and so is what
// lies in a part of another time. kUsage where the moment is not within [0, frames].
Result<Gaussians4D> snapshot_at(const Scene& scene, double ticks);

// Mirrors the axes whose sign is -1: positions, velocities, rotations and harmonics. Two mirrored
// axes are a half turn about the third. Its own inverse.
void flip_axes(Gaussians4D& set, int x, int y, int z);

// 3DGS PLY: binary little-endian or ASCII; properties by name, in any order and of any scalar type,
// others skipped; harmonics to degree 3 from the number of f_rest. Also the packed PLY of
// PlayCanvas (elements chunk, vertex, sh). kUnsupported for other kinds of PLY.
Result<Scene> read_ply(const ByteSource& source, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);
// Binary little-endian, as 3DGS writes it; every float as it is. Lifespans are not looked at.
Result<std::vector<std::uint8_t>> write_ply(const Gaussians4D& set);

// SOG version 2 of PlayCanvas: a .sog bundle, a meta.json, a folder with one, or a folder of such
// bundles and folders, which are read in the order of their names and put together. Its axes are
// those of a 3DGS PLY. kUnsupported for version 1 and for streamed sets of several levels of
// detail; kNotBuilt without libwebp and libzip.
Result<Scene> read_sog(const std::string& path, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);

// SPZ (github.com/nianticlabs/spz), versions 2 and 3 (gzip) and 4; its axes are x right, y up, z
// back unless the file names others. Harmonics of degree 4 are left out, with a note.
Result<Scene> read_spz(const ByteSource& source, const ReadLimits& limits = {},
                       ConversionNotes* notes = nullptr);
// SPZ version 4, primitives in their order. What it rounds: positions to 2^-12 or what the farthest
// one allows, log scales to 1/16, opacity and colour to bytes, rotations to 10 bits a component,
// harmonics to 5 bits (degree 1) and 4 (above). What it clips, with a note: log scales to
// [-10, 5.94], colours to [-0.44, 1.44], harmonics to [-1, 1]. kUnsupported for no primitives at
// all.
Result<std::vector<std::uint8_t>> write_spz(Gaussians4D set, ConversionNotes* notes = nullptr);

// Binary glTF (.glb) with KHR_gaussian_splatting, all floats; its axes are x left, y up, z forward.
// kUnsupported for no primitives, and beyond the 4 GiB of a .glb.
Result<std::vector<std::uint8_t>> write_glb(Gaussians4D set);

// How far a set that was written and read back is from what was meant, primitive by primitive.
struct ConversionErrors {
  // Scene units, where it is seen and at the moment when it is greatest.
  double position_max = 0, position_rms = 0;
  // Natural log and degrees, of the least turn: a writer may give the axes other names.
  double log_scale_max = 0, rotation_max = 0;
  double opacity_max = 0;                 // 0..1
  double colour_max = 0, colour_rms = 0;  // of the degree-0 colour, sRGB-encoded, 0..1
  double sh_max = 0, sh_rms = 0;          // of the coefficients above degree 0
  // As LifespanError has them: 0..1, frames, frames, natural log.
  double visibility_max = 0, time_max = 0, radius_max = 0, sigma_max = 0;
};
// A set of the same size and degree as that of the scene, in the same order; kRuntime where it is
// not.
Result<ConversionErrors> conversion_errors(const Gaussians4D& meant, const Scene& got);

}  // namespace stgs
