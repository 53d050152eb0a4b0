// SPDX-License-Identifier: Apache-2.0
// The timeline of a scene that is being streamed.
#pragma once

#include <memory>

#include "stgs/player/timeline.h"
#include "stream/segment_store.h"

namespace stgs::player {

// Creates a timeline over `store`, which outlives it. at() returns the segments that are resident
// and never waits.
std::unique_ptr<Timeline> make_stream_timeline(SegmentStore& store, std::string name);

}  // namespace stgs::player
