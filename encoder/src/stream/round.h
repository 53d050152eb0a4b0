// SPDX-License-Identifier: Apache-2.0
// A round: successive windows that were trained at the same time, all against the set that the
// round begins with. Each is displayed exactly as it was trained, and the set after the round is
// that of the last window.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "stgs/encoder/persistent_set.h"

namespace stgs::encoder {

// How the fragment of a window treats the members of the set that the round begins with.
struct WindowPlan {
  std::vector<MemberEnd> ends;  // members that end in the window, where they are stored
  // Members that an earlier window of the round has ended, but that this one displays: those that
  // it displays to its end are stored again and stay, the others are stored for their part of it.
  std::vector<std::uint32_t> stored_again;
  std::vector<MemberEnd> displayed_again;
};

// Plans the fragments of a round. `ends`: by window, the members that it has ended, each once.
// `members`: size of the set, above all members of `ends`.
std::vector<WindowPlan> plan_round(std::size_t members,
                                   std::span<const std::vector<MemberEnd>> ends);

}  // namespace stgs::encoder
