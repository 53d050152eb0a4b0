// SPDX-License-Identifier: Apache-2.0
// Chooses layouts and tables for the records of a file.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "layout.h"

namespace stgs {

using SymbolCounts = std::array<std::uint32_t, 256>;

// Tables for planes of these counts, few enough that a table saves what it takes to store.
struct TablePlan {
  std::vector<RansTable> tables;
  std::vector<std::uint16_t> table_of;  // by plane
};
TablePlan plan_tables(const std::vector<SymbolCounts>& planes);

}  // namespace stgs
