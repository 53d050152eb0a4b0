// SPDX-License-Identifier: Apache-2.0
// Prefix sums over a workgroup, called by all invocations. Uses subgroups if their size is known
// (STGS_BALLOT), else shared memory only. Requires frame.glsl.

// Adds with saturation.
uint added(uint a, uint b) {
  return min(a + b, kManyInstances);
}

#if STGS_BALLOT

layout(constant_id = 0) const uint kLanes = 32u;  // per subgroup: 16 or 32
const uint kSubgroups = kGroup / kLanes;

shared uint scan_totals[2u * kSubgroups];
uint scan_half =
    0u;  // of the totals, used alternately: the next scan does not overwrite one still read

// Returns the index of the invocation, with successive indices in a subgroup.
uint thread_number() {
  return gl_SubgroupID * kLanes + gl_SubgroupInvocationID;
}

// Returns the sum of `value` over earlier invocations; `total`: over all.
uint sum_before(uint thread, uint value, out uint total) {
  uint lane = thread % kLanes, subgroup = thread / kLanes;
  // Uses shuffles, since sums saturate: subgroupInclusiveAdd would overflow.
  uint upto = value;
  [[unroll]] for (uint distance = 1u; distance < kLanes; distance *= 2u) {
    uint other = subgroupShuffleUp(upto, distance);
    upto = lane >= distance ? added(upto, other) : upto;
  }
  uint before = subgroupShuffleUp(upto, 1u);
  if (lane == 0u) before = 0u;
  if (lane == kLanes - 1u) scan_totals[scan_half + subgroup] = upto;
  barrier();
  uint all = 0u;
  [[unroll]] for (uint k = 0u; k < kSubgroups; ++k) {
    if (k == subgroup) before = added(before, all);
    all = added(all, scan_totals[scan_half + k]);
  }
  scan_half = kSubgroups - scan_half;
  total = all;
  return before;
}

#else

shared uint scan_values[kGroup];

uint thread_number() {
  return gl_LocalInvocationIndex;
}

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

#endif

const uint kScanEach = kScanTile / kGroup;  // numbers per invocation

// Replaces the values of each invocation with their exclusive prefix sums. Returns the total.
uint scan_tile(uint thread, inout uint values[kScanEach]) {
  uint sum = 0u;
  [[unroll]] for (uint k = 0u; k < kScanEach; ++k) {
    uint value = values[k];
    values[k] = sum;
    sum = added(sum, value);
  }
  uint total, before = sum_before(thread, sum, total);
  [[unroll]] for (uint k = 0u; k < kScanEach; ++k) values[k] = added(before, values[k]);
  return total;
}
