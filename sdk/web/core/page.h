// SPDX-License-Identifier: Apache-2.0
// The functions of the host that the WASM core calls (HostImports in
// sdk/web/src/core/instance.ts). Offsets in a file are doubles, which are exact below 2^53.
#pragma once

#include <cstdint>

extern "C" {
// Begins to read `bytes` from `offset` of the file into `to`, which stays valid until the host
// calls stgs_read_done() with this id.
void stgs_host_read(std::uint32_t id, double offset, std::uint32_t bytes, std::uint8_t* to);
// Ends a read early; stgs_read_done() follows.
void stgs_host_cancel(std::uint32_t id);
// Starts to decode a segment, of write_job(), from its records, which the host copies: `bytes`
// bytes at `base`, located at `offset` of the file, and those of the spherical harmonics, if any.
// The host ends it by stgs_decode_done().
void stgs_host_decode(std::uint32_t id, const std::uint8_t* segment, std::uint32_t segment_bytes,
                      bool with_sh, double offset, const std::uint8_t* base, std::uint32_t bytes,
                      double sh_offset, const std::uint8_t* sh, std::uint32_t sh_bytes);
// The functions of PartDecoder::Parts, for the segment that is decoded. The host copies the bytes.
void stgs_host_part(std::uint32_t first, std::uint32_t count, std::uint32_t bytes);
void stgs_host_fill(std::uint32_t offset, const std::uint8_t* from, std::uint32_t bytes);
}
