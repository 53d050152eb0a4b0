// SPDX-License-Identifier: Apache-2.0
// A band of SH that only some primitives of a record have, decoded range by range (spec 6.3).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/record_decode.h"

namespace stgs {

// Decodes the values of a band a block of symbols at a time, when primitives need them.
class PartialBand {
 public:
  // `decoder`: of the record, which must outlive this object. `band`: kSh1 to kSh3.
  PartialBand(RecordDecoder& decoder, Attribute band) : decoder_(&decoder), band_(band) {}

  Attribute attribute() const { return band_; }
  // Decodes the values of the next primitives that have the band, and maps them into rows `members`
  // of `set`, which has n primitives; without `set`, decodes only. Values beyond the last one of
  // the record are left out. Clears `in_range` if an integer is out of range, and `renderable` if a
  // value is not finite. Returns false if the bytes are damaged, which is reported.
  bool decode(std::span<const std::uint32_t> members, const SegmentContext& context, std::size_t n,
              Gaussians4D* set, bool& in_range, bool& renderable);

 private:
  // Decodes the next block.
  bool decode_block(const SegmentContext& context);
  // Maps the next values in the block.
  void map(std::span<const std::uint32_t> members, const SegmentContext& context, std::size_t n,
           Gaussians4D& set, bool& in_range, bool& renderable);

  RecordDecoder* decoder_;
  Attribute band_;
  std::size_t next_ = 0, end_ = 0;  // symbols: the next one, and the end of the block
  DecodedRows rows_;                // of the block; its planes begin at next_
  std::vector<StreamTask> tasks_;
  std::vector<Carries> carries_;
};

}  // namespace stgs
