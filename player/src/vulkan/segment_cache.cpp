// SPDX-License-Identifier: Apache-2.0
#include "vulkan/segment_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "frame_layout.h"
#include "packed_segment.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/parallel.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint64_t kBlockBytes = std::uint64_t{256} << 20;
// Bytes of staged copies, for which buffers are allocated in advance. Frames in flight may return
// twice as many.
constexpr std::uint64_t kMaxStaged = std::uint64_t{64} << 20, kMaxSpare = 2 * kMaxStaged;

}  // namespace

void SegmentCache::create(Device& device, std::uint64_t block_bytes) {
  device_ = &device;
  const std::uint64_t preferred = block_bytes > 0 ? block_bytes : kBlockBytes;
  max_block_bytes_ = std::min(preferred, device.max_range());
  memory_.create(device);
}

Status SegmentCache::begin(const SceneReader& /*reader*/) {
  spare_.clear();  // sized for another scene
  // A block must hold a chunk of any SH degree, and need not hold more than the budget.
  const std::uint64_t min_bytes = kGroup * packed_bytes_each(math::kShMaxDegree);
  const std::uint64_t bytes = std::max(min_bytes, std::min(max_block_bytes_, memory_budget()));
  memory_.set_block_bytes(bytes / SegmentMemory::kAlign * SegmentMemory::kAlign);
  return {};
}

// Allocates staging buffers before playback, since allocation takes as long as a frame.
void SegmentCache::reserve(std::uint64_t bytes) {
  memory_.reserve(bytes);
  const std::uint64_t each = staging_bytes();
  for (std::uint64_t all = each; all <= std::min(bytes, kMaxStaged); all += each) {
    Buffer buffer;
    if (!buffer.create(*device_, each, MemoryLocation::kHost).ok())
      return;  // reported once one is needed
    spare_.push_back(std::move(buffer));
  }
}

// Returns the size of a staging buffer: any upload of the scene fits, so that all are
// interchangeable.
std::uint64_t SegmentCache::staging_bytes() const {
  return bytes_of(std::min<std::uint64_t>(peak().primitives, kMaxUploadPrimitives));
}

std::uint64_t SegmentCache::bytes_of(std::uint64_t primitives) const {
  return packed_bytes(static_cast<std::uint32_t>(primitives), sh_degree());
}

void SegmentCache::free(Uploads& uploads, std::uint32_t segment) {
  const auto found = uploads.find(segment);
  if (found == uploads.end()) return;
  for (const Upload& one : found->second) {
    if (one.allocation.bytes == 0) continue;  // the allocation failed
    const auto staged = std::find_if(copies_.begin(), copies_.end(), [&](const Copy& copy) {
      return copy.allocation.block == one.allocation.block &&
             copy.allocation.offset == one.allocation.offset;
    });
    if (staged != copies_.end()) copies_.erase(staged);
    memory_.free(one.allocation);
  }
  uploads.erase(found);
}

void SegmentCache::release(std::uint32_t segment) {
  free(resident_, segment);
}

void SegmentCache::cancel_upload(std::uint32_t segment) {
  free(incomplete_, segment);
}

Status SegmentCache::decode(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const SceneReader& reader = timeline.reader();
  std::uint64_t primitives = 0;
  for (const std::uint32_t one : segments) primitives += reader.segments()[one].primitives;
  STGS_ASSIGN(const Lease lease, charge_decoded(primitives));
  std::vector<std::optional<Result<Gaussians4D>>> read(segments.size());
  parallel_for(std::size_t{0}, read.size(), [&](std::size_t k) {
    read[k].emplace(reader.decode(segments[k], true, reader.render_origin(segments[k])));
  });
  for (std::size_t k = 0; k < read.size(); ++k) {
    STGS_TRY(read[k]->ok() ? upload_all(segments[k], **read[k])
                           : decode_on_cpu(timeline, segments[k]));
    read[k].reset();
  }
  return {};
}

Status SegmentCache::upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) {
  if (first == 0) cancel_upload(segment);
  std::vector<Upload>& uploads = incomplete_[segment];
  const std::uint64_t fitting =
      memory_.block_bytes() / (packed_bytes_each(sh_degree()) * kGroup) * kGroup;
  const std::size_t end = std::min(first + kMaxUploadPrimitives, set.size());
  while (first < end) {
    uploads.emplace_back();  // registered first, so that an error frees its allocation
    Upload& one = uploads.back();
    one.primitives = static_cast<std::uint32_t>(std::min<std::uint64_t>(end - first, fitting));
    STGS_TRY(stage(set, first, one));
    first += one.primitives;
  }
  if (end < set.size()) return {};
  free(resident_, segment);
  std::uint64_t bytes = 0;
  for (const Upload& one : uploads) bytes += one.allocation.bytes;
  resident_.insert(incomplete_.extract(segment));
  insert(segment, set.size(), bytes, set.time_origin);
  return {};
}

// Small uploads share a buffer, since allocating one takes milliseconds.
Status SegmentCache::ensure_staging(std::uint64_t bytes) {
  if (!filled_.empty() && filled_.back().bytes() - filled_bytes_ >= bytes) return {};
  filled_.reserve(filled_.size() + 1);
  const auto spare = std::find_if(spare_.begin(), spare_.end(),
                                  [&](const Buffer& one) { return one.bytes() >= bytes; });
  Buffer buffer;
  if (spare != spare_.end()) {
    buffer = std::move(*spare);
    spare_.erase(spare);
  } else {
    STGS_TRY(buffer.create(*device_, std::max(bytes, staging_bytes()), MemoryLocation::kHost));
  }
  filled_.push_back(std::move(buffer));
  filled_bytes_ = 0;
  return {};
}

Status SegmentCache::stage(const Gaussians4D& set, std::size_t first, Upload& upload) {
  const std::uint64_t bytes = packed_bytes(upload.primitives, sh_degree());
  STGS_TRY(ensure_staging(bytes));
  pack_segment(set, first, upload.primitives, sh_degree(), filled_.back().mapped() + filled_bytes_);
  copies_.reserve(copies_.size() + 1);
  STGS_ASSIGN(upload.allocation, memory_.allocate(bytes));
  copies_.push_back({upload.allocation, filled_.size() - 1, filled_bytes_});
  filled_bytes_ += upload.allocation.bytes;
  staged_bytes_ += upload.allocation.bytes;
  return staged_bytes_ > kMaxStaged ? copy_now() : Status();
}

Status SegmentCache::copy_now() {
  VkCommandBuffer commands = VK_NULL_HANDLE;
  STGS_TRY(device_->begin(&commands));
  barrier(*device_, commands);  // after frames in flight have read the blocks
  record_copies(commands);
  std::vector<Buffer> copied;
  copied.reserve(filled_.size());
  STGS_TRY(device_->finish(commands));
  take_staging(copied);
  recycle(std::move(copied));
  return {};
}

void SegmentCache::record_copies(VkCommandBuffer commands) const {
  for (const Copy& copy : copies_) {
    const VkBufferCopy region{copy.offset, copy.allocation.offset, copy.allocation.bytes};
    device_->vk.vkCmdCopyBuffer(commands, filled_[copy.buffer].handle(),
                                memory_.buffer(copy.allocation.block), 1, &region);
  }
  if (!copies_.empty()) barrier(*device_, commands);
}

void SegmentCache::take_staging(std::vector<Buffer>& to) {
  for (Buffer& buffer : filled_) to.push_back(std::move(buffer));
  filled_.clear();
  copies_.clear();
  staged_bytes_ = 0;
}

void SegmentCache::recycle(std::vector<Buffer> buffers) {
  std::uint64_t bytes = 0;
  for (const Buffer& buffer : spare_) bytes += buffer.bytes();
  for (Buffer& buffer : buffers) {
    bytes += buffer.bytes();
    if (bytes <= kMaxSpare) spare_.push_back(std::move(buffer));
  }
}

}  // namespace stgs::player::vulkan
