// SPDX-License-Identifier: Apache-2.0
// Compressed content of a model, which the browser decodes: its decoders run while no function of
// the module does, so importers request all content before they read any.
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

// Content to decode, for sdk/web/src/viewer/host_decoding.ts. Its fields have 32 bits there. A
// task is done once `output_bytes` bytes are written, no more and no less.
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

// Identifies content by its coding and its label: an image may be compressed in an archive, too.
class HostDecoding {
 public:
  // Adds a task, and charges and allocates its output of `bytes` bytes; adds none if there was such
  // a task. `input` must stay valid until the task is done, and `memory` outlive this object.
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

// Returns that of the module, which importers of the shared code use.
HostDecoding& host_decoding();

}  // namespace stgs::web
