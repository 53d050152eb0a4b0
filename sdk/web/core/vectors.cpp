// SPDX-License-Identifier: Apache-2.0
// Functions of vectors that all sources share. Compiled for size, the destructor of a vector of
// bytes takes a step for each byte.
#include <cstdint>
#include <vector>

template class std::vector<std::uint8_t>;
