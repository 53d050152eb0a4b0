// SPDX-License-Identifier: Apache-2.0
#include "codec/partial_band.h"

#include <algorithm>

namespace stgs {

bool PartialBand::decode_block(const SegmentContext& context) {
  const AttributeBits bit = attribute_bit(band_);
  if (!decoder_->decode_range({bit, end_, end_ + kRansBlock}, rows_)) return false;
  tasks_.clear();
  decoder_->add_tasks(bit, rows_, tasks_);
  if (end_ == 0) carries_ = first_carries(tasks_, context);
  end_ = std::min<std::size_t>(end_ + kRansBlock, decoder_->symbols_of(band_));
  return true;
}

void PartialBand::map(std::span<const std::uint32_t> members, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set, bool& in_range, bool& renderable) {
  for (StreamTask& task : tasks_) task.members = members;
  const MapResult result = map_streams(tasks_, context, n, set, carries_);
  for (const bool good : result.in_range) in_range = in_range && good;
  renderable = renderable && result.renderable;
}

bool PartialBand::decode(std::span<const std::uint32_t> members, const SegmentContext& context,
                         std::size_t n, Gaussians4D* set, bool& in_range, bool& renderable) {
  const std::size_t symbols = decoder_->symbols_of(band_);
  members = members.first(std::min(members.size(), symbols - next_));
  while (!members.empty()) {
    if (next_ == end_ && !decode_block(context)) return false;
    const std::size_t count = std::min(members.size(), end_ - next_);
    if (set != nullptr) map(members.first(count), context, n, *set, in_range, renderable);
    rows_.skip(count);
    next_ += count;
    members = members.subspan(count);
  }
  return true;
}

}  // namespace stgs
