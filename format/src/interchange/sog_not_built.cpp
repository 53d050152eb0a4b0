// SPDX-License-Identifier: Apache-2.0
// In the place of sog.cpp where libwebp or libzip is not there.
#include "stgs/format/interchange.h"

namespace stgs {

Result<Scene> read_sog(const std::string& path, const ReadLimits&, ConversionNotes*) {
  return not_built(
      "{}: this build has no libwebp or no libzip, which SOG models need: install libwebp-dev and "
      "libzip-dev and build again",
      path);
}

}  // namespace stgs
