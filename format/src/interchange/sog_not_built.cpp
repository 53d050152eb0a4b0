// SPDX-License-Identifier: Apache-2.0
// Replaces the readers of SOG, .sogst and .tsog in builds without libwebp or libzip.
#include "interchange/sog_models.h"
#include "stgs/format/timed_formats.h"

namespace stgs {
namespace {

Status needs_libraries(const std::string& path, const char* format) {
  return not_built(
      "{}: this build lacks libwebp or libzip, which {} needs; install libwebp-dev and libzip-dev "
      "and rebuild",
      path, format);
}

}  // namespace

SogKind sog_kind(const std::string& path, const ReadLimits&) {
  return sog_kind_of_extension(path);
}

Result<Scene> read_sog(const std::string& path, const ReadLimits&, ConversionNotes*) {
  return needs_libraries(path, "SOG");
}

Result<Scene> read_sogst(const std::string& path, const CurveSettings&, const ReadLimits&,
                         CurveReport*, ConversionNotes*) {
  return needs_libraries(path, ".sogst");
}

Result<Scene> read_tsog(const std::string& path, const ClipSettings&, const ReadLimits&,
                        ConversionNotes*) {
  return needs_libraries(path, ".tsog");
}

}  // namespace stgs
