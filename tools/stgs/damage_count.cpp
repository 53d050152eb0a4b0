// SPDX-License-Identifier: Apache-2.0
#include "damage_count.h"

namespace stgs::tools {

void warn_of_issue(Session& session, const std::string& file, const std::string& message,
                   double complete) {
  session.log(1, fmt::format("{}: {}; it is complete up to {:.3f} s", file, message, complete));
}

void warn_of_damage(Session& session, const std::string& file, const DamageCount& damage) {
  if (damage.skipped + damage.without_sh == 0) return;
  std::string text;
  if (damage.skipped > 0) {
    text = fmt::format("skipped {} of segments", plural(damage.skipped, "damaged tier"));
  }
  if (damage.without_sh > 0) {
    text += fmt::format("{}rendered {} of segments without SH", text.empty() ? "" : ", ",
                        plural(damage.without_sh, "tier"));
  }
  session.log(1, fmt::format("{}: {}; first: {}", file, text, damage.first));
}

Json damage_json(const DamageCount& damage) {
  return {{"segments", damage.skipped}, {"sh", damage.without_sh}};
}

}  // namespace stgs::tools
