// SPDX-License-Identifier: Apache-2.0
// The digits of the keys in a pass of the sort. After frame.glsl, on which it builds.

const uint kRowsAhead = 16u;  // that are asked for at once: what is waited for is memory

uint digit_of(uint key) {
  return key >> push.shift & (kDigits - 1u);
}

// The sums of a digit's numbers in the rows from `first` on: before `middle`, and in `all` before
// `end`.
uint sum_of_rows(uint digit, uint first, uint middle, uint end, out uint all) {
  uint before = 0u;
  all = 0u;
  for (uint row = first; row < end; row += kRowsAhead) {
    uint counts[kRowsAhead];
    [[unroll]] for (uint k = 0u; k < kRowsAhead; ++k) {
      counts[k] = digit_counts[min(row + k, end - 1u) * kDigits + digit];
    }
    [[unroll]] for (uint k = 0u; k < kRowsAhead; ++k) {
      before += row + k < middle ? counts[k] : 0u;
      all += row + k < end ? counts[k] : 0u;
    }
  }
  return before;
}

// How many keys of the workgroups before `group` have the digit; `all`: of all `groups`.
uint digits_before(uint digit, uint group, uint groups, out uint all) {
  uint size = super_group_of(groups), super_group = group / size;
  uint before_those = sum_of_rows(digit, push.super_rows, push.super_rows + super_group,
                                  push.super_rows + (groups + size - 1u) / size, all);
  uint before;
  sum_of_rows(digit, super_group * size, group, group, before);
  return before_those + before;
}

#if STGS_BALLOT

// The lanes of `among` with the same digit.
uint lanes_alike(uint digit, uint among) {
  uint alike = among;
  [[unroll]] for (uint bit = 0u; bit < 8u; ++bit) {
    bool set = (digit >> bit & 1u) != 0u;
    uint with = subgroupBallot(set).x;
    alike &= set ? with : ~with;
  }
  return alike;
}

#endif
