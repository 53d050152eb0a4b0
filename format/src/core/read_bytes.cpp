// SPDX-License-Identifier: Apache-2.0
#include "core/read_bytes.h"

#include <algorithm>
#include <span>

namespace stgs {

Status read_bytes(const ByteSource& source, std::uint64_t offset, std::uint64_t bytes,
                  std::vector<std::uint8_t>& out) {
  constexpr std::uint64_t kFirst = 8 << 20;
  out.clear();
  while (out.size() < bytes) {
    const std::uint64_t read = out.size();
    const std::uint64_t piece = std::min(bytes - read, std::max(kFirst, read));
    out.resize(read + piece);
    STGS_TRY(source.read(offset + read, std::span(out).subspan(read)));
  }
  return {};
}

}  // namespace stgs
