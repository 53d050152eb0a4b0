// SPDX-License-Identifier: Apache-2.0
// Replaces sog.cpp in builds without libwebp or libzip.
#include "stgs/format/interchange.h"

namespace stgs {

Result<Scene> read_sog(const std::string& path, const ReadLimits&, ConversionNotes*) {
  return not_built(
      "{}: this build lacks libwebp or libzip, which SOG needs; install libwebp-dev and libzip-dev "
      "and rebuild",
      path);
}

}  // namespace stgs
