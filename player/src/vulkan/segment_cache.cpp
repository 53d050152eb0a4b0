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

constexpr std::uint64_t kBlockBytes = std::uint64_t{256} << 20;
// Bytes that wait to be copied at most, and that buffers are made for before play; frames on their
// way may give back twice as much.
constexpr std::uint64_t kWaiting = std::uint64_t{64} << 20, kSpare = 2 * kWaiting;

}  // namespace

void SegmentCache::create(Device& device, std::uint64_t block_bytes) {
  device_ = &device;
  const std::uint64_t wanted = block_bytes > 0 ? block_bytes : kBlockBytes;
  // A chunk of any degree fits a block.
  const std::uint64_t least = kGroup * packed_bytes_each(math::kShMaxDegree);
  const std::uint64_t bytes = std::max(least, std::min(wanted, device.most_range()));
  memory_.create(device, bytes / SegmentMemory::kAlign * SegmentMemory::kAlign);
}

Status SegmentCache::begin(const SceneReader& /*reader*/) {
  spare_.clear();  // of another scene's size
  return {};
}

// What is sent while it plays finds its buffers made, as the time for that would be a picture's.
void SegmentCache::reserve(std::uint64_t bytes) {
  memory_.reserve(bytes);
  const std::uint64_t each = host_bytes();
  for (std::uint64_t all = each; all <= std::min(bytes, kWaiting); all += each) {
    Buffer buffer;
    if (!buffer.create(*device_, each, Place::kHost).ok()) return;  // told where one is needed
    spare_.push_back(std::move(buffer));
  }
}

// Of a host buffer: what any piece of the scene fits in, so that each serves for all.
std::uint64_t SegmentCache::host_bytes() const {
  return bytes_of(std::min<std::uint64_t>(peak().primitives, kMaxUploadPrimitives));
}

std::uint64_t SegmentCache::bytes_of(std::uint64_t primitives) const {
  return packed_bytes(static_cast<std::uint32_t>(primitives), sh_degree());
}

void SegmentCache::give_back(Pieces& pieces, std::uint32_t segment) {
  const auto found = pieces.find(segment);
  if (found == pieces.end()) return;
  for (const Piece& piece : found->second) {
    if (piece.room.bytes == 0) continue;  // it got none
    const auto waits = std::find_if(copies_.begin(), copies_.end(), [&](const Copy& copy) {
      return copy.room.block == piece.room.block && copy.room.offset == piece.room.offset;
    });
    if (waits != copies_.end()) copies_.erase(waits);
    memory_.give_back(piece.room);
  }
  pieces.erase(found);
}

void SegmentCache::release(std::uint32_t segment) {
  give_back(resident_, segment);
}

void SegmentCache::cancel_upload(std::uint32_t segment) {
  give_back(arriving_, segment);
}

Status SegmentCache::decode(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const SceneReader& reader = timeline.reader();
  std::vector<std::optional<Result<Gaussians4D>>> read(segments.size());
  parallel_for(std::size_t{0}, read.size(),
               [&](std::size_t k) { read[k].emplace(reader.decode(segments[k])); });
  for (std::size_t k = 0; k < read.size(); ++k) {
    STGS_TRY(read[k]->ok() ? send_all(segments[k], **read[k])
                           : decode_on_cpu(timeline, segments[k]));
    read[k].reset();
  }
  return {};
}

Status SegmentCache::upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) {
  if (first == 0) cancel_upload(segment);
  std::vector<Piece>& pieces = arriving_[segment];
  const std::uint64_t fitting =
      memory_.block_bytes() / (packed_bytes_each(sh_degree()) * kGroup) * kGroup;
  const std::size_t end = std::min(first + kMaxUploadPrimitives, set.size());
  while (first < end) {
    pieces.emplace_back();  // it holds what the room takes, whatever happens
    Piece& piece = pieces.back();
    piece.primitives = static_cast<std::uint32_t>(std::min<std::uint64_t>(end - first, fitting));
    STGS_TRY(send_room(set, first, piece));
    first += piece.primitives;
  }
  if (end < set.size()) return {};
  give_back(resident_, segment);
  std::uint64_t bytes = 0;
  for (const Piece& piece : pieces) bytes += piece.room.bytes;
  resident_.insert(arriving_.extract(segment));
  insert(segment, set.size(), bytes);
  return {};
}

// Many pieces are small: they share buffers, of which making one takes milliseconds.
Status SegmentCache::fill(std::uint64_t bytes) {
  if (!filled_.empty() && filled_.back().bytes() - filled_bytes_ >= bytes) return {};
  filled_.reserve(filled_.size() + 1);
  const auto spare = std::find_if(spare_.begin(), spare_.end(),
                                  [&](const Buffer& one) { return one.bytes() >= bytes; });
  Buffer buffer;
  if (spare != spare_.end()) {
    buffer = std::move(*spare);
    spare_.erase(spare);
  } else {
    STGS_TRY(buffer.create(*device_, std::max(bytes, host_bytes()), Place::kHost));
  }
  filled_.push_back(std::move(buffer));
  filled_bytes_ = 0;
  return {};
}

Status SegmentCache::send_room(const Gaussians4D& set, std::size_t first, Piece& piece) {
  const std::uint64_t bytes = packed_bytes(piece.primitives, sh_degree());
  STGS_TRY(fill(bytes));
  pack_segment(set, first, piece.primitives, sh_degree(), filled_.back().mapped() + filled_bytes_);
  copies_.reserve(copies_.size() + 1);
  STGS_ASSIGN(piece.room, memory_.take(bytes));
  copies_.push_back({piece.room, filled_.size() - 1, filled_bytes_});
  filled_bytes_ += piece.room.bytes;
  waiting_ += piece.room.bytes;
  return waiting_ > kWaiting ? copy_now() : Status();
}

Status SegmentCache::copy_now() {
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device_->begin(&commands));
  barrier(*device_, commands);  // what frames on their way read of the blocks
  record_copies(commands);
  std::vector<Buffer> copied;
  copied.reserve(filled_.size());
  STGS_TRY(device_->finish(commands));
  take_copied(copied);
  take_back(std::move(copied));
  return {};
}

void SegmentCache::record_copies(VkCommandBuffer commands) const {
  for (const Copy& copy : copies_) {
    const VkBufferCopy region{copy.offset, copy.room.offset, copy.room.bytes};
    device_->vk.vkCmdCopyBuffer(commands, filled_[copy.buffer].handle(),
                                memory_.buffer(copy.room.block), 1, &region);
  }
  if (!copies_.empty()) barrier(*device_, commands);
}

void SegmentCache::take_copied(std::vector<Buffer>& to) {
  for (Buffer& buffer : filled_) to.push_back(std::move(buffer));
  filled_.clear();
  copies_.clear();
  waiting_ = 0;
}

void SegmentCache::take_back(std::vector<Buffer> buffers) {
  std::uint64_t bytes = 0;
  for (const Buffer& buffer : spare_) bytes += buffer.bytes();
  for (Buffer& buffer : buffers) {
    bytes += buffer.bytes();
    if (bytes <= kSpare) spare_.push_back(std::move(buffer));
  }
}

}  // namespace stgs::player::vulkan
