// SPDX-License-Identifier: Apache-2.0
// Compressed content of a model, which the browser decodes. Its decoders are asynchronous and
// cannot run during a function of the module, so importers request all content before they read
// any.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "interchange/import_memory.h"

namespace stgs::web {

enum class Coding : std::uint32_t { kGzip, kDeflate, kWebp };

// Content to decode, for sdk/web/src/viewer/host_decoding.ts, where each field has 32 bits. The
// task writes exactly `output_bytes` bytes.
struct DecodeTask {
  Coding coding{};
  const char* label = nullptr;  // the content, for messages
  const std::uint8_t* input = nullptr;
  std::uint32_t input_bytes = 0;
  std::uint8_t* output = nullptr;
  std::uint32_t output_bytes = 0;
  std::uint32_t width = 0;  // of an image, whose pixels are R G B A, row after row from the top
};
static_assert(sizeof(void*) != 4 || sizeof(DecodeTask) == 7 * 4);

// Content is identified by its coding and its label, because an image may also be a compressed
// member of an archive.
class HostDecoding {
 public:
  // Adds a task, and charges and allocates its output of `bytes` bytes. Does nothing if the content
  // has already been requested. `input` must stay valid until the task is done; `memory` must
  // outlive this object.
  Status request(Coding coding, const std::string& label, std::span<const std::uint8_t> input,
                 std::uint64_t bytes, ImportMemory& memory, std::uint32_t width = 0);
  // Returns the next task, valid until the next call; null if none is left.
  const DecodeTask* next();
  // Returns the output of a task, valid as long as this object; empty if there was no such task.
  std::span<const std::uint8_t> content(Coding coding, const std::string& label) const;

 private:
  std::map<std::pair<Coding, std::string>, ChargedBytes> outputs_;
  std::deque<DecodeTask> tasks_;
  DecodeTask current_;
};

// Returns the object of this module, for the importers of the shared code.
HostDecoding& host_decoding();

}  // namespace stgs::web
