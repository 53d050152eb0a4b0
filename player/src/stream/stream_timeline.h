// SPDX-License-Identifier: Apache-2.0
// The timeline of a scene that is still coming.
#pragma once

#include <memory>

#include "stgs/player/timeline.h"
#include "stream/segment_store.h"

namespace stgs::player {

// at() gives what the store has of the moment, and never waits.
std::unique_ptr<Timeline> make_stream_timeline(SegmentStore& store, std::string name);

}  // namespace stgs::player
