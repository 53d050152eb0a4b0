// SPDX-License-Identifier: Apache-2.0
// A limit on what the tables of an MP4 or MOV file state. FFmpeg makes an entry of 24 bytes for
// each sample (ISO/IEC 14496-12: stsz, stz2, trun), and again for each edit (elst), when it opens
// the file; a table of samples of one size states any number of them in 12 bytes.
#pragma once

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// Returns kInvalidFile if the tables of an MP4 or MOV file state more samples than `bytes` bytes
// can hold, those of the file without holes: 65,536 and one for each 4 bytes, or for each 1 to 3
// bytes if all samples of a table are so small. More than 4 edits of a track count all samples so
// many times. Also if boxes nest more than 10 deep, or a table is in a box that is not for tables.
// Reads the file once, without its media data.
Status check_mov_samples(const ByteSource& file, std::uint64_t bytes);

}  // namespace stgs::encoder
