// SPDX-License-Identifier: Apache-2.0
#include "part_decoder.h"

#include <algorithm>
#include <memory_resource>
#include <optional>
#include <utility>

#include "packed_segment.h"

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
  const auto free_records = [](ProvidedSource* source) { source->clear(); };
  const std::unique_ptr<ProvidedSource, decltype(free_records)> end(provided_, free_records);
  set_ = {};
  primitives_ = next_ = 0;
  segment_.replace_segments(*reader_);
  Status status = fill(with_sh);
  if (with_sh && is_damage(status.code()) && reader_->segments()[0].sh_bytes > 0) {
    Status base = fill(false);
    if (base.ok()) sh = std::move(status);
    status = std::move(base);
  }
  return status;
}

Status PartDecoder::fill(bool with_sh) {
  const std::uint32_t primitives = reader_->segments()[0].primitives;
  const auto visit = [&](const Gaussians4D& set, std::size_t begin) {
    pack_range(set, begin, primitives);
  };
  const TimeOrigin origin = reader_->render_origin(segment_.number);
  STGS_ASSIGN(std::optional<Gaussians4D> rest,
              reader_->decode_ranges(segment_.number, with_sh, origin, visit));
  primitives_ = primitives;
  if (!rest) return {};
  set_ = std::move(*rest);
  time_origin_ = set_.time_origin;
  return {};
}

void PartDecoder::allocate(std::size_t bytes) {
  if (bytes <= capacity_) return;
  capacity_ = 0;
  packed_.reset();
  packed_ = std::make_unique_for_overwrite<std::uint8_t[]>(bytes);
  capacity_ = bytes;
}

std::size_t PartDecoder::bytes_before(std::size_t begin) const {
  const auto bytes = player::packed_bytes(kPartPrimitives, reader_->sh_degree());
  return static_cast<std::size_t>(begin / kPartPrimitives * bytes);
}

void PartDecoder::pack_range(const Gaussians4D& set, std::size_t begin, std::uint32_t n) {
  const int degree = reader_->sh_degree();
  const std::uint32_t last = n / kPartPrimitives * kPartPrimitives;
  allocate(bytes_before(last) + static_cast<std::size_t>(player::packed_bytes(n - last, degree)));
  for (std::size_t done = 0; done < set.size();) {
    const auto at = static_cast<std::uint32_t>(begin + done);
    const std::uint32_t first = at / kPartPrimitives * kPartPrimitives;
    const std::uint32_t total = std::min(kPartPrimitives, n - first);
    const auto count =
        static_cast<std::uint32_t>(std::min<std::size_t>(set.size() - done, first + total - at));
    player::pack_primitives(set, done, count, degree, packed_.get() + bytes_before(first), total,
                            at - first);
    done += count;
  }
  time_origin_ = set.time_origin;
}

const PartDecoder::Part* PartDecoder::next_part() {
  if (next_ == primitives_) {
    set_ = {};
    return nullptr;
  }
  const int degree = reader_->sh_degree();
  part_.primitives = std::min(kPartPrimitives, primitives_ - next_);
  const auto bytes = static_cast<std::size_t>(player::packed_bytes(part_.primitives, degree));
  const bool is_packed = set_.size() == 0;
  if (!is_packed) {
    allocate(bytes);
    player::pack_segment(set_, next_, part_.primitives, degree, packed_.get());
  }
  part_.packed = {packed_.get() + (is_packed ? bytes_before(next_) : 0), bytes};
  next_ += part_.primitives;
  return &part_;
}

}  // namespace stgs::web
