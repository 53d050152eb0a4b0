// SPDX-License-Identifier: Apache-2.0
// Selection of the rANS tables of a file.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/layout.h"

namespace stgs {

// Number of occurrences of each symbol of a plane.
using SymbolCounts = std::array<std::uint32_t, 256>;

struct TablePlan {
  std::vector<RansTable> tables;
  std::vector<std::uint16_t> table_of;  // by plane
};
// Selects tables for planes with these counts. Planes share a table unless another one saves more
// than it costs to store.
TablePlan plan_tables(const std::vector<SymbolCounts>& planes);

}  // namespace stgs
