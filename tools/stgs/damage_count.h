// SPDX-License-Identifier: Apache-2.0
// The damaged tiers of segments that rendering has met, for the reports of verbs.
#pragma once

#include <cstddef>
#include <string>

#include "session.h"

namespace stgs::tools {

struct DamageCount {
  std::size_t skipped = 0, without_sh = 0;  // tiers of segments; without SH only
  std::string first;                        // the reason for the first of them
};

// Warns of an issue that was found when the file was opened. `complete`: seconds up to which no
// data is missing.
void warn_of_issue(Session& session, const std::string& file, const std::string& message,
                   double complete);
// Warns of damaged tiers of segments, if there are any.
void warn_of_damage(Session& session, const std::string& file, const DamageCount& damage);
// Returns {"segments", "sh"}: skipped, and without SH only.
Json damage_json(const DamageCount& damage);

}  // namespace stgs::tools
