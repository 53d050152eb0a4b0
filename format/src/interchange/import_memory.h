// SPDX-License-Identifier: Apache-2.0
// The memory of one import. Each reader charges everything that the size or the content of a file
// makes it allocate, before it allocates: bytes and images, decoded arrays, tables, the
// primitives while they are read, and the working memory of libraries. Together they stay within
// ReadLimits::max_memory. Not counted: about 2 MiB of memory of fixed size, such as the header of a
// PLY and the notes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/format/gaussian4d.h"
#include "stgs/format/read_limits.h"
#include "stgs/format/status.h"

namespace stgs {

// A value and the charge for its memory.
template <typename T>
struct Charged {
  T value;
  Lease lease;
};
using ChargedBytes = Charged<std::vector<std::uint8_t>>;

// Working memory of a decoder of the library, at most: zlib has a window of 32 KiB and its tables,
// zstd the tables and the literals of a block.
inline constexpr std::uint64_t kInflateScratch = 48 << 10, kZstdScratch = 192 << 10;
// Memory of parsed JSON for each byte of text: a list entry `{},` takes 16 bytes, 32 more while its
// list grows, and 56 of its own.
inline constexpr std::uint64_t kJsonBytesPerByte = 40;

// Returns the memory of `count` primitives of this SH degree, bytes. `count` is below 2^32.
std::uint64_t import_bytes(std::uint64_t count, int sh_degree);

// Outlives its leases. One thread at a time.
class ImportMemory {
 public:
  // `name`: the file, for messages.
  ImportMemory(const ReadLimits& limits, std::string name);

  // Charges bytes. kUnsupported, with the limit, if they exceed the rest of it. `what`: those
  // bytes, a plural noun, for the message.
  Result<Lease> take(std::uint64_t bytes, std::string_view what);
  // Charges as many bytes more as the lease lacks to have `bytes`. Errors as of take().
  Status grow(Lease& lease, std::uint64_t bytes, std::string_view what);
  // Charges `count` primitives. kUnsupported also if they are more than the limits allow.
  Result<Lease> take_set(std::uint64_t count, int sh_degree);
  // Allocates memory for `count` primitives in total, which `lease` then charges. More than needed,
  // if that fits, so that a sequence of calls takes linear time.
  Status reserve(Gaussians4D& set, Lease& lease, std::uint64_t count);
  // kUnsupported for more primitives than the limits allow.
  Status check_count(std::uint64_t count);

  // Returns whether bytes or primitives have been refused: nothing that depends on them may be
  // omitted as if the file lacked it.
  bool has_refused() const { return has_refused_; }

  const std::string& name() const { return name_; }
  const ReadLimits& limits() const { return limits_; }
  // Returns the bytes that can still be charged.
  std::uint64_t available() const { return budget_.available(Budget::Pool::kImport); }

 private:
  Status check(std::uint64_t bytes, std::string_view what);

  Budget budget_;
  ReadLimits limits_;
  std::string name_;
  bool has_refused_ = false;
};

}  // namespace stgs
