// SPDX-License-Identifier: Apache-2.0
#include "scene/validate_ends.h"

#include <map>

namespace stgs {
namespace {

using N = IssueNumber;
using Primitives = std::map<TierKey, std::uint32_t>;  // of each record of content 0

// Checks the lists of a record of ends. Reports the first problem.
void check_lists(const LoadedEnds& ends, const Primitives& records, const FileHead& head,
                 Findings& findings) {
  for (const EndList& list : ends.lists) {
    const auto found = records.find(list.tier);
    // A damaged index may have listed it.
    if (found == records.end() && !head.lost_fragments.empty()) continue;
    const std::uint32_t primitives = found == records.end() ? 0 : found->second;
    if (list.primitives.back() < primitives) continue;
    findings.error(N::kEnds, ends.offset,
                   "ends of primitive {} of part {}, place {}, tier {}, which has {} primitives",
                   list.primitives.back(), list.tier.part, list.tier.place, list.tier.tier,
                   primitives);
    return;
  }
}

}  // namespace

void check_ends(const FileHead& head, Findings& findings) {
  Primitives records;
  for (const SegmentEntry& segment : head.index.segments) {
    records[tier_key(head.parts[segment.part].number, segment.base)] = segment.base.primitives;
  }
  for (const auto& ends : head.ends) check_lists(*ends, records, head, findings);
  for (const FurtherEntry& further : head.index.further) {
    const PartEntry& part = head.parts[further.part];
    const TickRange needed = needed_of(further.entry, part);
    if (!is_ends(further.entry) || needed.end >= head.metadata.scene.frames) continue;
    findings.error(N::kEnds, further.entry.offset,
                   "ends that are needed up to tick {} alone (expected the duration, {})",
                   needed.end, head.metadata.scene.frames);
  }
}

}  // namespace stgs
