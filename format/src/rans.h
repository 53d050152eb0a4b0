// SPDX-License-Identifier: Apache-2.0
// The entropy coder of planes: 32-lane interleaved rANS with static tables (spec annex A).
//
// A plane is n symbols of 0 to 255, one a primitive, with a table of its own; a group codes planes
// of the same n primitives together. Primitives are cut into blocks that decode apart from each
// other, with up to 32 lanes a block, so that a vector unit or a warp takes a step of all lanes at
// once. The integers and their order are normative: every decoder gives the same bytes, for damaged
// input too.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "bytes.h"
#include "stgs/format/rans_layout.h"
#include "stgs/format/status.h"

namespace stgs {

// Frequencies of the symbols, of 4096. A symbol of frequency 0 cannot be coded.
struct RansTable {
  std::array<std::uint16_t, 256> frequency{};

  bool operator==(const RansTable&) const = default;
};

// The table that codes symbols of these counts in the fewest bits; {4096, 0, 0 ...} without any.
// Integer arithmetic: the same on every machine.
RansTable rans_table(std::span<const std::uint32_t, 256> counts);

// Bits that symbols of these counts take with the table; infinite if it lacks one of them.
double rans_cost(const RansTable& table, std::span<const std::uint32_t, 256> counts);

// A table as bytes (spec A.2), and back: exact inverses. The table must add up to 4096.
void write_rans_table(const RansTable& table, ByteWriter& out);
// Takes a table from `in`; an error (kInvalidFile) if its bytes hold none.
Result<RansTable> read_rans_table(ByteReader& in);

// The table must add up to 4096.
void rans_lookup(const RansTable& table, RansLookup& lookup);

struct RansPlane {
  std::span<const std::uint8_t> symbols;
  const RansTable* table = nullptr;
};

// A group of planes of n primitives each, coded (spec A.3). An error (kUsage) if there are more
// than kRansPlanes, a plane's size is not n, a table does not add up to 4096 or lacks a symbol of
// its plane.
Result<std::vector<std::uint8_t>> rans_encode(std::span<const RansPlane> planes, std::size_t n);

struct RansBlock;  // rans_block.h

// Decodes a group plane after plane, in the order in which they were given to rans_encode. Blocks
// are decoded on several threads. One thread at a time may use an object.
class RansGroupDecoder {
 public:
  // Checks the group as rans_layout does; `bytes` must outlive the decoder. Takes about three times
  // the memory of `bytes` at most. `scalar`: without the vector unit, for tests.
  static Result<RansGroupDecoder> open(std::span<const std::uint8_t> bytes, std::size_t n,
                                       bool scalar = false);
  RansGroupDecoder(RansGroupDecoder&&) noexcept;
  RansGroupDecoder& operator=(RansGroupDecoder&&) noexcept;
  ~RansGroupDecoder();

  // The n symbols of the next plane. Damaged bytes give some symbols of the table; finish() tells.
  void next_plane(const RansLookup& lookup, std::uint8_t* out);

  // Whether every block has ended as it must after its last plane (spec A.5): all words read and no
  // more, all states 2^16.
  [[nodiscard]] bool finish() const;

 private:
  RansGroupDecoder(std::unique_ptr<RansBlock[]> blocks, std::size_t n, bool scalar);

  std::unique_ptr<RansBlock[]> blocks_;
  std::size_t n_ = 0;
  bool scalar_ = false;
};

// The name of the vector unit's instruction set that RansGroupDecoder uses.
const char* rans_vector_target();

}  // namespace stgs
