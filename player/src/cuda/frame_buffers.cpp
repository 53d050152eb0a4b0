// SPDX-License-Identifier: Apache-2.0
#include "cuda/frame_buffers.h"

#include <algorithm>

namespace stgs::player::cuda {
namespace {

constexpr std::size_t kAlign = 256;

// Lays out arrays in memory; if `memory` is null, computes their total size.
class Layout {
 public:
  explicit Layout(std::uint8_t* memory) : memory_(memory) {}

  template <typename T>
  void take(T*& array, std::size_t n) {
    array = memory_ == nullptr ? nullptr : reinterpret_cast<T*>(memory_ + used_);
    used_ += (n * sizeof(T) + kAlign - 1) / kAlign * kAlign;
  }
  std::size_t used() const { return used_; }

 private:
  std::uint8_t* memory_;
  std::size_t used_ = 0;
};

std::size_t sort_tiles(std::uint64_t keys) {
  return static_cast<std::size_t>((keys + kSortTile - 1) / kSortTile);
}

std::size_t lay_out_cleared(Layout layout, const FrameNeed& need, Workspace& w) {
  layout.take(w.counters, 1);
  layout.take(w.depth_digits, std::size_t{kDepthPasses} * kDigits);
  layout.take(w.tile_digits, std::size_t{kMaxPasses} * kDigits);
  layout.take(w.select_status, (need.chunks + kSelectChunks - 1) / kSelectChunks);
  layout.take(w.project_status, need.chunks);
  // An upper bound of the chunks in list.cu.
  layout.take(w.list_status, kNearChunks + (need.splats + kListSplats - 1) / kListSplats);
  for (int p = 0; p < kDepthPasses; ++p) {
    layout.take(w.sort_status[p], kDigits * sort_tiles(need.splats));
  }
  for (int p = 0; p < tile_passes(need.tiles); ++p) {
    layout.take(w.sort_status[kMaxPasses + p], kDigits * sort_tiles(need.instances));
  }
  layout.take(w.tile_ranges, need.tiles);
  return layout.used();
}

std::size_t lay_out_pairs(Layout layout, std::size_t n, std::uint32_t* (&keys)[2],
                          std::uint32_t* (&values)[2]) {
  for (int half = 0; half < 2; ++half) {
    layout.take(keys[half], n);
    layout.take(values[half], n);
  }
  return layout.used();
}

}  // namespace

Status FrameBuffers::ensure(const FrameNeed& need) {
  FrameNeed target = capacity_;
  // Adds a quarter, since times differ a little.
  const auto grow = [](auto& have, auto required) {
    if (required <= have) return false;
    have = required + required / 4;
    return true;
  };
  bool grown = grow(target.chunks, need.chunks);
  grown |= grow(target.tiles, need.tiles);
  grown |= grow(target.splats, need.splats);
  grown |= grow(target.instances, need.instances);
  if (!grown && generation_ > 0) return {};
  target.splats = std::min(target.splats, kMaxSplats);
  target.instances = std::min(target.instances, kMaxFrameViews * kMaxInstances);
  capacity_ = {};
  ++generation_;
  Workspace w;
  const std::size_t splats = target.splats;
  STGS_TRY(cleared_.ensure(lay_out_cleared(Layout(nullptr), target, w)));
  STGS_TRY(candidates_.ensure(std::size_t{target.chunks} * kChunk * sizeof(Candidate)));
  STGS_TRY(splats_.ensure(splats * sizeof(ScreenSplat)));
  STGS_TRY(depths_.ensure(lay_out_pairs(Layout(nullptr), splats, w.depth_keys, w.depth_order)));
  STGS_TRY(instances_.ensure(
      lay_out_pairs(Layout(nullptr), target.instances, w.tile_keys, w.tile_splats)));
  STGS_TRY(patches_.ensure(std::size_t{kPatchClasses} * target.tiles * sizeof(std::uint32_t)));
  cleared_bytes_ = lay_out_cleared(Layout(cleared_.data()), target, w);
  lay_out_pairs(Layout(depths_.data()), splats, w.depth_keys, w.depth_order);
  lay_out_pairs(Layout(instances_.data()), target.instances, w.tile_keys, w.tile_splats);
  w.candidates = reinterpret_cast<Candidate*>(candidates_.data());
  w.splats = reinterpret_cast<ScreenSplat*>(splats_.data());
  w.patches = reinterpret_cast<std::uint32_t*>(patches_.data());
  w.patch_capacity = target.tiles;
  w.splat_capacity = static_cast<std::uint32_t>(target.splats);
  w.instance_capacity = static_cast<std::uint32_t>(target.instances);
  laid_out_ = w;
  capacity_ = target;
  return {};
}

void FrameBuffers::reset() {
  for (DeviceBuffer* buffer :
       {&cleared_, &candidates_, &splats_, &depths_, &instances_, &patches_}) {
    buffer->reset();
  }
  capacity_ = {};
}

Workspace FrameBuffers::workspace(std::uint32_t tiles) const {
  Workspace w = laid_out_;
  w.tile_passes = tile_passes(tiles);
  return w;
}

cudaError_t FrameBuffers::clear(cudaStream_t stream) const {
  return cudaMemsetAsync(cleared_.data(), 0, cleared_bytes_, stream);
}

}  // namespace stgs::player::cuda
