// SPDX-License-Identifier: Apache-2.0
#include "part_decoder.h"

#include <algorithm>
#include <cstring>
#include <memory_resource>
#include <utility>

#include "packed_segment.h"

namespace stgs::web {

std::vector<std::uint8_t> write_job(const SceneReader& reader, std::uint32_t segment) {
  const ListedSegment listed = ListedSegment::of(reader, segment);
  const std::vector<SegmentEnd> ends = reader.ends(segment);
  std::vector<std::uint8_t> out(sizeof listed + ends.size() * sizeof(SegmentEnd));
  std::memcpy(out.data(), &listed, sizeof listed);
  if (!ends.empty())
    std::memcpy(out.data() + sizeof listed, ends.data(), out.size() - sizeof listed);
  return out;
}

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

Status PartDecoder::decode(bool with_sh, Parts& parts, Status& sh) {
  const auto free_records = [](ProvidedSource* source) { source->clear(); };
  const std::unique_ptr<ProvidedSource, decltype(free_records)> end(provided_, free_records);
  STGS_TRY(read_job());
  Status status = decode_records(with_sh, parts);
  if (with_sh && is_damage(status.code()) && reader_->segments()[0].sh_bytes > 0) {
    Status base = decode_records(false, parts);
    if (base.ok()) sh = std::move(status);
    status = std::move(base);
  }
  return status;
}

Status PartDecoder::read_job() {
  if (job_.size() < sizeof segment_) return usage_error("a segment to decode is incomplete");
  std::memcpy(&segment_, job_.data(), sizeof segment_);
  std::vector<SegmentEnd> ends((job_.size() - sizeof segment_) / sizeof(SegmentEnd));
  if (!ends.empty())
    std::memcpy(ends.data(), job_.data() + sizeof segment_, ends.size() * sizeof(SegmentEnd));
  segment_.replace_segments(*reader_, ends);
  return {};
}

Status PartDecoder::decode_records(bool with_sh, Parts& parts) {
  const std::uint32_t primitives = reader_->segments()[0].primitives;
  const TimeOrigin origin = reader_->render_origin(segment_.number);
  return reader_->decode_ranges(segment_.number, with_sh, origin,
                                [&](const Gaussians4D& set, std::size_t begin) {
                                  pack_range(set, begin, primitives, parts);
                                });
}

void PartDecoder::pack_range(const Gaussians4D& set, std::size_t begin, std::uint32_t n,
                             Parts& parts) {
  time_origin_ = set.time_origin;
  for (std::size_t done = 0; done < set.size();) {
    const auto at = static_cast<std::uint32_t>(begin + done);
    const std::uint32_t first = at / kPartPrimitives * kPartPrimitives;
    const std::uint32_t total = std::min(kPartPrimitives, n - first);
    if (at == first) parts.begin(first, total, player::packed_bytes(total, reader_->sh_degree()));
    const auto count =
        static_cast<std::uint32_t>(std::min<std::size_t>(set.size() - done, first + total - at));
    pack(set, done, count, total, at - first, parts);
    done += count;
  }
}

void PartDecoder::pack(const Gaussians4D& set, std::size_t first, std::uint32_t count,
                       std::uint32_t total, std::uint32_t entry, Parts& parts) {
  const int degree = reader_->sh_degree();
  const auto bytes = static_cast<std::size_t>(player::packed_bytes(count, degree));
  if (packed_.size() < bytes) packed_.resize(bytes);
  player::pack_segment(set, first, count, degree, packed_.data());
  const std::uint64_t all = player::padded(total), own = player::padded(count);
  std::uint64_t begin = 0;  // bytes per primitive of the arrays so far
  for (const std::uint32_t width : player::packed_widths(degree)) {
    const std::span array(packed_.data() + begin * own, static_cast<std::size_t>(width * own));
    parts.fill(begin * all + std::uint64_t{width} * entry, array);
    begin += width;
  }
}

}  // namespace stgs::web
