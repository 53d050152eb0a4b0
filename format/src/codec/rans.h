// SPDX-License-Identifier: Apache-2.0
// The entropy coder of planes: interleaved rANS with static tables (spec 7).
//
// A plane has n symbols of 0 to 255 and a table. A group codes several planes of n symbols. The
// symbols are split into blocks that decode independently, with up to 32 lanes per block, so that a
// vector unit or a warp advances all lanes at once. The integers and their order are normative: all
// decoders give the same bytes, even for damaged input.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "core/bytes.h"
#include "stgs/format/rans_layout.h"
#include "stgs/format/status.h"

namespace stgs {

// Frequencies of the symbols; they add up to 4096. A symbol of frequency 0 cannot be coded.
struct RansTable {
  std::array<std::uint16_t, 256> frequency{};

  bool operator==(const RansTable&) const = default;
};

// Returns the table that codes symbols with these counts in the fewest bits; {4096, 0, 0 ...} if
// all are 0. Uses integer arithmetic, so that all machines agree.
RansTable rans_table(std::span<const std::uint32_t, 256> counts);

// Returns the bits that symbols with these counts take; infinite if the table lacks one of them.
double rans_cost(const RansTable& table, std::span<const std::uint32_t, 256> counts);

// Writes a table (spec 7.2), which must add up to 4096. Exact inverse of read_rans_table().
void write_rans_table(const RansTable& table, ByteWriter& out);
// Reads a table; kInvalidFile if the bytes are not a table.
Result<RansTable> read_rans_table(ByteReader& in);
// Reads a table into `table`, all of whose frequencies are 0. Sets `only` to its symbol if it has a
// single one, else to -1. Returns false if the bytes are not a table.
bool read_rans_table(ByteReader& in, RansTable& table, std::int16_t& only);

// Fills the lookup of a table, which must add up to 4096.
void rans_lookup(const RansTable& table, RansLookup& lookup);

struct RansPlane {
  std::span<const std::uint8_t> symbols;
  const RansTable* table = nullptr;
};

// Encodes a group of planes of n symbols each (spec 7.3); no bytes if there are no planes or n is
// 0. kUsage if there are more than kRansPlanes, a plane's size is not n, or a table does not add up
// to 4096 or lacks a symbol of its plane.
Result<std::vector<std::uint8_t>> rans_encode(std::span<const RansPlane> planes, std::size_t n);

struct RansBlock;  // rans_block.h

// Decodes a group plane by plane, in the order of encoding. Blocks are decoded on several threads.
// One thread at a time may use an object.
class RansGroupDecoder {
 public:
  // Checks the group as rans_layout() does. `bytes` must outlive the decoder. Uses at most about
  // three times the memory of `bytes`. `scalar`: do not use the vector unit; for tests.
  static Result<RansGroupDecoder> open(std::span<const std::uint8_t> bytes, std::size_t n,
                                       bool scalar = false);
  RansGroupDecoder(RansGroupDecoder&&) noexcept;
  RansGroupDecoder& operator=(RansGroupDecoder&&) noexcept;
  ~RansGroupDecoder();

  // Decodes the n symbols of the next plane. Damaged bytes give arbitrary symbols of the table;
  // finish() detects them. decode_groups() is faster for several groups.
  void next_plane(const RansLookup& lookup, std::uint8_t* out);

  // Returns whether every block has ended correctly after its last plane (spec 7.4): all words read
  // and no more, all states 2^16.
  [[nodiscard]] bool finish() const;

 private:
  friend void decode_groups(std::span<const struct RansQueue> groups, std::size_t begin,
                            std::size_t end);
  RansGroupDecoder(std::unique_ptr<RansBlock[]> blocks, std::size_t n, bool scalar);

  std::unique_ptr<RansBlock[]> blocks_;
  std::size_t n_ = 0;
  bool scalar_ = false;
};

// With fewer lanes than this, a vector unit is slower than the scalar loop.
inline constexpr std::size_t kRansVectorLanes = 16;

// A plane to decode: the lookup of its table, and where its symbols go. In a block of fewer lanes
// than kRansVectorLanes the lookup may be null, and is then made from the table.
struct RansPlaneTask {
  const RansLookup* lookup = nullptr;
  std::uint8_t* out = nullptr;
  const RansTable* table = nullptr;
};
// All planes of a group, in their order.
struct RansQueue {
  RansGroupDecoder* group = nullptr;
  std::span<const RansPlaneTask> planes;
};
// Decodes symbols [begin, end) of all planes of several groups, as far as they have so many, to
// out[0] and so on. `begin` is a multiple of kRansBlock, and `end`, too, unless it is not less than
// n; each block is decoded once. Blocks are decoded on several threads, and the planes of different
// groups in an interleaved way, which hides the latency of table lookups.
void decode_groups(std::span<const RansQueue> groups, std::size_t begin = 0,
                   std::size_t end = std::numeric_limits<std::size_t>::max());

// Returns the name of the instruction set that RansGroupDecoder uses.
const char* rans_vector_target();

}  // namespace stgs
