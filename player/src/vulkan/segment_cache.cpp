// SPDX-License-Identifier: Apache-2.0
#include "vulkan/segment_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "frame_layout.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"
#include "vulkan/packed_segment.h"

namespace stgs::player::vulkan {
namespace {

constexpr double kMiB = 1 << 20;
constexpr std::uint64_t kBlockBytes = std::uint64_t{256} << 20;
// Primitives that are sent, and that are decoded, at once, about.
constexpr std::uint32_t kSent = 1 << 18;
constexpr std::uint64_t kBatch = 1 << 19;

}  // namespace

void SegmentCache::create(Device& device, std::uint64_t block_bytes) {
  device_ = &device;
  const std::uint64_t wanted = block_bytes > 0 ? block_bytes : kBlockBytes;
  // A chunk of any degree fits a block.
  const std::uint64_t least = kGroup * packed_bytes_each(math::kShMaxDegree);
  const std::uint64_t bytes = std::max(least, std::min(wanted, device.most_range()));
  memory_.create(device, bytes / SegmentMemory::kAlign * SegmentMemory::kAlign);
}

void SegmentCache::give_back(const Held& held) {
  for (const Piece& piece : held.pieces) memory_.give_back(piece.room);
}

void SegmentCache::drop(Segments::iterator segment) {
  bytes_ -= segment->second.bytes;
  primitives_ -= segment->second.primitives;
  give_back(segment->second);
  held_.erase(segment);
}

bool SegmentCache::has(const Timeline::Needed& needed) {
  const auto found = held_.find(needed.segment);
  if (found == held_.end()) return false;
  const auto& set = found->second.set;
  const bool same = !set.owner_before(needed.set) && !needed.set.owner_before(set);
  if (same) {
    found->second.used = call_;
  } else {
    drop(found);
  }
  return same;
}

void SegmentCache::begin(const Timeline& timeline) {
  const auto known = timeline_.lock();
  if (known != nullptr && known == timeline.identity()) return;
  while (!held_.empty()) drop(held_.begin());
  sh_degree_ = timeline.reader().sh_degree();
  timeline_ = timeline.identity();
}

Status SegmentCache::hold(Timeline& timeline, std::span<const Timeline::Needed> needed,
                          double seconds) {
  begin(timeline);
  ++call_;
  const auto& segments = timeline.reader().segments();
  std::vector<std::uint32_t> missing;
  std::vector<const Timeline::Needed*> decoded;
  std::uint64_t together = 0, more = 0;
  for (const Timeline::Needed& one : needed) {
    const SegmentInfo& info = segments[one.segment];
    const std::uint64_t bytes = info.there ? packed_bytes(info.primitives, sh_degree_) : 0;
    together += bytes;
    if (has(one)) continue;
    more += bytes;
    if (one.set == nullptr) {
      missing.push_back(one.segment);
    } else {
      decoded.push_back(&one);
    }
  }
  if (together > timeline.memory_budget()) {
    return runtime_error(
        "{}: the segments alive at {} s take {:.1f} MiB decoded, more than the budget of "
        "{:.1f} MiB; allow more memory",
        timeline.name(), seconds, static_cast<double>(together) / kMiB,
        static_cast<double>(timeline.memory_budget()) / kMiB);
  }
  while (bytes_ + more > timeline.memory_budget()) {
    drop(std::min_element(held_.begin(), held_.end(), [](const auto& a, const auto& b) {
      return a.second.used < b.second.used;
    }));
  }
  for (const Timeline::Needed* one : decoded) STGS_TRY(keep(one->segment, *one->set, one->set));
  return decode(timeline, missing);
}

Status SegmentCache::decode(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const SceneReader& reader = timeline.reader();
  for (std::size_t first = 0; first < segments.size();) {
    std::size_t end = first;
    std::uint64_t primitives = 0;
    while (end < segments.size() && (end == first || primitives < kBatch)) {
      primitives += reader.segments()[segments[end++]].primitives;
    }
    std::vector<std::optional<Result<Gaussians4D>>> read(end - first);
    parallel_for(std::size_t{0}, read.size(),
                 [&](std::size_t k) { read[k].emplace(reader.decode(segments[first + k])); });
    for (std::size_t k = 0; k < read.size(); ++k) {
      if (read[k]->ok()) {
        STGS_TRY(keep(segments[first + k], **read[k], nullptr));
      } else {
        // As the timeline wants damage dealt with.
        STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segments[first + k]));
        if (set) STGS_TRY(keep(segments[first + k], *set, nullptr));
      }
      read[k].reset();
    }
    first = end;
  }
  return {};
}

Status SegmentCache::keep(std::uint32_t segment, const Gaussians4D& set,
                          const std::shared_ptr<const Gaussians4D>& owner) {
  Held held;
  held.set = owner;
  held.used = call_;
  held.primitives = set.size();
  const std::uint64_t fitting =
      memory_.block_bytes() / (packed_bytes_each(sh_degree_) * kGroup) * kGroup;
  const std::size_t most = std::min<std::uint64_t>(kSent, fitting);
  for (std::size_t first = 0; first < set.size(); first += most) {
    Piece piece;
    piece.primitives = static_cast<std::uint32_t>(std::min(most, set.size() - first));
    if (const Status status = send(set, first, piece); !status.ok()) {
      give_back(held);
      return status;
    }
    held.bytes += piece.room.bytes;
    held.pieces.push_back(piece);
  }
  bytes_ += held.bytes;
  primitives_ += held.primitives;
  held_.emplace(segment, std::move(held));
  return {};
}

Status SegmentCache::send(const Gaussians4D& set, std::size_t first, Piece& piece) {
  const std::uint64_t bytes = packed_bytes(piece.primitives, sh_degree_);
  STGS_TRY(staging_.ensure(*device_, bytes, Place::kHost));
  pack_segment(set, first, piece.primitives, sh_degree_, staging_.mapped());
  STGS_ASSIGN(const Room room, memory_.take(bytes));
  const auto copy = [&]() -> Status {
    VkCommandBuffer commands = VK_NULL_HANDLE;
    STGS_TRY(device_->begin(&commands));
    const VkBufferCopy region{0, room.offset, bytes};
    device_->vk.vkCmdCopyBuffer(commands, staging_.handle(), memory_.buffer(room.block), 1,
                                &region);
    barrier(*device_, commands);
    return device_->finish(commands);
  };
  const Status status = copy();
  if (!status.ok()) memory_.give_back(room);
  piece.room = room;
  return status;
}

}  // namespace stgs::player::vulkan
