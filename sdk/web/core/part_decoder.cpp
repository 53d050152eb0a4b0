// SPDX-License-Identifier: Apache-2.0
#include "part_decoder.h"

#include <algorithm>
#include <memory_resource>
#include <utility>

#include "packed_segment.h"
#include "stream/decode_executor.h"

namespace stgs::web {

PartDecoder::PartDecoder(std::string name, std::uint64_t file_bytes, std::uint64_t max_memory)
    : opening_(std::make_unique<ProvidedSource>(std::move(name), file_bytes)),
      provided_(opening_.get()) {
  limits_.max_memory = max_memory;
}

Status PartDecoder::open() {
  // Null until the reader has the source.
  ProvidedSource* const provided = std::exchange(provided_, nullptr);
  STGS_ASSIGN(reader_, SceneReader::open(std::move(opening_), limits_,
                                         std::pmr::new_delete_resource(), IndexLoading::kOnDemand));
  provided_ = provided;
  provided_->clear();
  return {};
}

Status PartDecoder::decode(bool with_sh, Status& sh) {
  set_ = {};
  packed_ = 0;
  segment_.replace_segments(*reader_);
  Result<Gaussians4D> set = player::decode_to_render(*reader_, segment_.number, with_sh, sh);
  provided_->clear();
  STGS_TRY(set.status());
  set_ = std::move(set).value();
  return {};
}

const PartDecoder::Part* PartDecoder::next_part() {
  if (packed_ == set_.size()) {
    set_ = {};
    packed_ = 0;
    return nullptr;
  }
  const int degree = reader_->sh_degree();
  part_.primitives =
      static_cast<std::uint32_t>(std::min<std::size_t>(kPartPrimitives, set_.size() - packed_));
  part_.packed.resize(static_cast<std::size_t>(player::packed_bytes(part_.primitives, degree)));
  player::pack_segment(set_, packed_, part_.primitives, degree, part_.packed.data());
  packed_ += part_.primitives;
  return &part_;
}

}  // namespace stgs::web
