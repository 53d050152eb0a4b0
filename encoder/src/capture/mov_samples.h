// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Checks the memory that FFmpeg would allocate when it opens an MP4 or MOV file. `bytes`: size of
// the file without holes. Returns kInvalidFile if
// - its tables state more samples than the bytes can hold: 65,536 and one for each 4 bytes, or for
//   each 1 to 3 bytes if all samples of a table are so small; more than 4 edits of a track count
//   all samples so many times; fragments times tracks have the same limit;
// - a table has more entries than its box, or is in a box that is not for tables;
// - boxes nest more than 10 deep, or there are more than 1000 tracks;
// - tables are compressed, or tracks encrypted.
// Reads the file once, without its media data.
Status check_mov_samples(const ByteSource& file, std::uint64_t bytes);

}  // namespace stgs::encoder
