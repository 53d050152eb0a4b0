// SPDX-License-Identifier: Apache-2.0
#include "version.h"

#include <vector>

#include "stgs/encoder/ranks.h"
#ifdef STGS_HAS_ENCODER
#include "stgs/encoder/train.h"
#endif
#include "stgs/format/raster.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/renderer.h"
#include "stgs/player/source.h"

namespace stgs::tools {
namespace {

std::vector<std::string> features() {
  std::vector<std::string> names;
#ifdef STGS_HAS_PREPARE
  for (const char* name : {"prepare", "encode", "mp4"}) names.push_back(name);
#endif
#ifdef STGS_HAS_CALIBRATION
  names.push_back("calibration");
#endif
#ifdef STGS_HAS_EXR
  names.push_back("exr");
#endif
#ifdef STGS_HAS_SOG
  names.push_back("sog");
#endif
  if (check_profile(Profile::kDraco).ok()) names.push_back("draco");
#ifdef STGS_HAS_PLAY
  names.push_back("play");
#endif
  if (player::is_http_built()) names.push_back("http");
#ifdef STGS_HAS_SERVE
  names.push_back("serve");
#endif
#ifdef STGS_HAS_WEB
  names.push_back("web");
#endif
#ifdef STGS_HAS_CUDNN
  names.push_back("cudnn");
#endif
#ifdef STGS_HAS_NCCL
  names.push_back("nccl");
#endif
  if (encoder::World::is_built()) names.push_back("mpi");
  return names;
}

std::vector<std::string> training_backends() {
#ifdef STGS_HAS_ENCODER
  return encoder::train_backends();
#else
  return {};
#endif
}

}  // namespace

Json version_json() {
  return {{"version", STGS_VERSION},
          {"format", fmt::format("{}.{}", kFormatMajor, kFormatMinor)},
          {"vector_target", vector_target()},
          {"trains_with", training_backends()},
          {"renders_with", player::renderer_backends()},
          {"built_in", features()}};
}

std::string version_text() {
  const std::vector<std::string> names = features();
  return fmt::format(
      "stgs {}\nformat: {}.{}\nvector target: {}\ntrains with: {}\nrenders with: {}\nbuilt in: "
      "{}",
      STGS_VERSION, kFormatMajor, kFormatMinor, vector_target(),
      training_backends().empty() ? "-" : fmt::format("{}", fmt::join(training_backends(), " ")),
      fmt::join(player::renderer_backends(), " "),
      names.empty() ? "-" : fmt::format("{}", fmt::join(names, " ")));
}

}  // namespace stgs::tools
