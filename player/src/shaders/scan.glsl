// SPDX-License-Identifier: Apache-2.0
// Sums over the invocations of a workgroup, through shared memory: whatever the subgroups' size.

shared uint scan_values[kGroup];

uint added(uint a, uint b) {
  return min(a + b, kManyInstances);
}

// The sum of the values of the invocations before; `total` is that of all.
uint sum_before(uint thread, uint value, out uint total) {
  scan_values[thread] = value;
  barrier();
  for (uint distance = 1u; distance < kGroup; distance *= 2u) {
    uint other = thread >= distance ? scan_values[thread - distance] : 0u;
    barrier();
    scan_values[thread] = added(scan_values[thread], other);
    barrier();
  }
  total = scan_values[kGroup - 1u];
  uint before = thread == 0u ? 0u : scan_values[thread - 1u];
  barrier();
  return before;
}
