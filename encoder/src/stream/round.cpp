// SPDX-License-Identifier: Apache-2.0
#include "stream/round.h"

namespace stgs::encoder {
namespace {

WindowPlan plan_window(std::vector<bool>& is_stored, const std::vector<MemberEnd>& ends) {
  WindowPlan plan;
  std::vector<bool> is_ended(is_stored.size(), false);
  for (const MemberEnd& end : ends) {
    is_ended[end.member] = true;
    if (is_stored[end.member]) {
      plan.ends.push_back(end);
    } else if (end.frame > 0) {
      plan.displayed_again.push_back(end);
    }
    is_stored[end.member] = false;
  }
  for (std::uint32_t m = 0; m < is_stored.size(); ++m) {
    if (is_stored[m] || is_ended[m]) continue;
    plan.stored_again.push_back(m);
    is_stored[m] = true;
  }
  return plan;
}

}  // namespace

std::vector<WindowPlan> plan_round(std::size_t members,
                                   std::span<const std::vector<MemberEnd>> ends) {
  std::vector<bool> is_stored(members, true);  // and displayed in the frame before the window
  std::vector<WindowPlan> plans;
  for (const std::vector<MemberEnd>& window : ends) plans.push_back(plan_window(is_stored, window));
  return plans;
}

}  // namespace stgs::encoder
