// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sched.h>

namespace stgs::fuzz {

// Restricts this thread, and the threads that it starts later, to two cores, so that thread pools
// have two threads: more would take address space, and two are enough to provoke races.
inline void use_two_cores() {
  cpu_set_t usable;
  if (sched_getaffinity(0, sizeof usable, &usable) != 0) return;  // more than 1024 cores
  for (int core = 0, kept = 0; core < CPU_SETSIZE; ++core) {
    if (CPU_ISSET(core, &usable) && ++kept > 2) CPU_CLR(core, &usable);
  }
  (void)sched_setaffinity(0, sizeof usable, &usable);
}

}  // namespace stgs::fuzz
