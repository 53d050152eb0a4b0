// SPDX-License-Identifier: Apache-2.0
// Digits of the keys in a pass of the sort. Requires frame.glsl.

const uint kRowsAtOnce = 16u;  // loaded at once to hide memory latency

uint digit_of(uint key) {
  return key >> push.shift & (kDigits - 1u);
}

// Sums the counts of a digit over rows from `first` on. Returns the sum before `middle`; `all` is
// the sum before `end`.
uint sum_of_rows(uint digit, uint first, uint middle, uint end, out uint all) {
  uint before = 0u;
  all = 0u;
  for (uint row = first; row < end; row += kRowsAtOnce) {
    uint counts[kRowsAtOnce];
    [[unroll]] for (uint k = 0u; k < kRowsAtOnce; ++k) {
      counts[k] = digit_counts[min(row + k, end - 1u) * kDigits + digit];
    }
    [[unroll]] for (uint k = 0u; k < kRowsAtOnce; ++k) {
      before += row + k < middle ? counts[k] : 0u;
      all += row + k < end ? counts[k] : 0u;
    }
  }
  return before;
}

// Returns the number of keys with the digit in workgroups before `group`; `all`: in all `groups`.
uint digits_before(uint digit, uint group, uint groups, out uint all) {
  uint size = super_group_of(groups), super_group = group / size;
  uint before_those = sum_of_rows(digit, push.super_rows, push.super_rows + super_group,
                                  push.super_rows + (groups + size - 1u) / size, all);
  uint before;
  sum_of_rows(digit, super_group * size, group, group, before);
  return before_those + before;
}

#if STGS_BALLOT

// Returns the lanes of `among` that have the same digit.
uint match_lanes(uint digit, uint among) {
  uint matching = among;
  [[unroll]] for (uint bit = 0u; bit < 8u; ++bit) {
    bool set = (digit >> bit & 1u) != 0u;
    uint with = subgroupBallot(set).x;
    matching &= set ? with : ~with;
  }
  return matching;
}

#endif
