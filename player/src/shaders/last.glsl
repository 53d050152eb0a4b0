// SPDX-License-Identifier: Apache-2.0
// Dispatches whose last workgroup continues alone with the results of all. No workgroup waits for
// another. Requires frame.glsl.

shared bool is_last_here;

// Returns whether all other workgroups of `groups` have called this. If so, coherent writes and
// atomics of their first invocations before the call are visible. All invocations must call it,
// once.
bool is_last(uint number, uint groups, uint thread) {
  if (thread == 0u) {
    memoryBarrierBuffer();
    is_last_here = atomicAdd(ended[number], 1u) + 1u == groups;
    memoryBarrierBuffer();
  }
  barrier();
  if (is_last_here) memoryBarrierBuffer();
  return is_last_here;
}

// Returns a row of `work` with `each` items per workgroup.
uvec4 work_for(uint items, uint each) {
  uint groups = (items + each - 1u) / each;
  return uvec4(min(groups, kGroupsX), (groups + kGroupsX - 1u) / kGroupsX, 1u, items);
}
