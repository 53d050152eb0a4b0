// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Returns kInvalidFile if a track of a Matroska or WebM file is compressed (RFC 9559, 5.1.4.1.31),
// other than by leaving out equal first bytes: FFmpeg would expand the description of each track,
// when it opens the file, and each frame to up to 10 MB. Reads the whole file, because its tables
// can be anywhere.
Status check_matroska_tracks(const ByteSource& file);

}  // namespace stgs::encoder
