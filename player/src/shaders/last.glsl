// SPDX-License-Identifier: Apache-2.0
// Dispatches whose last workgroup goes on alone with what all of them have found. None waits for
// another. After frame.glsl, on which it builds.

shared bool is_last_here;

// Whether all other workgroups of `groups` have called it: what their first invocations wrote to
// coherent buffers or added by atomics before is seen then. All invocations call it, once.
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

// A row of `work`: `each` items a workgroup.
uvec4 work_for(uint items, uint each) {
  uint groups = (items + each - 1u) / each;
  return uvec4(min(groups, kGroupsX), (groups + kGroupsX - 1u) / kGroupsX, 1u, items);
}
