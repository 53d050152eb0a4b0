// SPDX-License-Identifier: Apache-2.0
// The functions that a decoding worker of the host calls (sdk/web/src/core/part_decoder.ts). An
// instance of the module has one decoder, on one thread.
#include <cstdint>
#include <exception>
#include <memory>

#include <fmt/format.h>
#include "export.h"
#include "page.h"
#include "part_decoder.h"

namespace {

using namespace stgs;

std::unique_ptr<web::PartDecoder> decoder;

// Passes parts to the host.
class HostParts final : public web::PartDecoder::Parts {
 public:
  void begin(std::uint32_t first, std::uint32_t count, std::uint64_t bytes) override {
    stgs_host_part(first, count, static_cast<std::uint32_t>(bytes));
  }
  void fill(std::uint64_t offset, std::span<const std::uint8_t> bytes) override {
    stgs_host_fill(static_cast<std::uint32_t>(offset), bytes.data(),
                   static_cast<std::uint32_t>(bytes.size()));
  }
};

std::string status_json(const Status& status) {
  return fmt::format(R"({{"code":{},"message":{}}})", static_cast<int>(status.code()),
                     web::quoted(status.message()));
}

}  // namespace

// Creates the decoder of a file.
STGS_EXPORT void stgs_decoder_create(const char* name, double file_bytes, double max_memory) {
  decoder = std::make_unique<web::PartDecoder>(name, static_cast<std::uint64_t>(file_bytes),
                                               static_cast<std::uint64_t>(max_memory));
}
// Returns memory for bytes of the file from `offset` on.
STGS_EXPORT std::uint8_t* stgs_decoder_provide(double offset, std::uint32_t bytes) {
  return decoder->source().provide(static_cast<std::uint64_t>(offset), bytes).data();
}
// Opens the file. Returns {"code": status code, "message": text}.
STGS_EXPORT const char* stgs_decoder_open() {
  Status status;
  try {
    status = decoder->open();
  } catch (const std::exception& e) {
    status = Status(code_of(e), e.what());
  }
  return web::give(status_json(status));
}
// Returns memory for the segment to decode, as stgs_host_decode() passed it.
STGS_EXPORT void* stgs_decoder_segment(std::uint32_t bytes) {
  return decoder->job(bytes).data();
}
// Decodes it, and passes its parts to the host. Returns {"origin": ticks, "base": status, "sh":
// status}, as DecodeResult.
STGS_EXPORT const char* stgs_decoder_decode(bool with_sh) {
  Status base, sh;
  try {
    HostParts parts;
    base = decoder->decode(with_sh, parts, sh);
  } catch (const std::exception& e) {
    base = Status(code_of(e), e.what());
  }
  return web::give(fmt::format(R"({{"origin":{},"base":{},"sh":{}}})", decoder->time_origin(),
                               status_json(base), status_json(sh)));
}
