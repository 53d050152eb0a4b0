// SPDX-License-Identifier: Apache-2.0
#include "cuda/segment_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "stgs/format/parallel.h"

namespace stgs::player::cuda {
namespace {

constexpr std::size_t kArrays = 9;       // of DeviceGaussians
constexpr std::size_t kFloatAlign = 64;  // floats; as cudaMalloc aligns

std::size_t floats_each(int sh_degree) {
  return static_cast<std::size_t>(17 + 3 * (sh_degree + 1) * (sh_degree + 1));
}

// Room for a segment's floats, of which `memory` then points to the end.
DeviceGaussians take(float*& memory, std::size_t n, int sh_degree) {
  const auto array = [&](std::size_t each) {
    float* const at = memory;
    memory += (each * n + kFloatAlign - 1) / kFloatAlign * kFloatAlign;
    return at;
  };
  DeviceGaussians out;
  out.position = array(3);
  out.log_scale = array(3);
  out.rotation = array(4);
  out.opacity_logit = array(1);
  out.sh = array(3 * static_cast<std::size_t>((sh_degree + 1) * (sh_degree + 1)));
  out.time = array(1);
  out.velocity = array(3);
  out.sigma = array(1);
  out.radius = array(1);
  return out;
}

}  // namespace

Status SegmentCache::create() {
  STGS_TRY(cuda_status(cudaStreamCreateWithFlags(stream_.fresh(), cudaStreamNonBlocking),
                       "creating a stream"));
  cudaMemPoolProps properties{};
  properties.allocType = cudaMemAllocationTypePinned;
  properties.location.type = cudaMemLocationTypeDevice;
  STGS_TRY(cuda_status(cudaGetDevice(&properties.location.id), "asking for the device"));
  STGS_TRY(cuda_status(cudaMemPoolCreate(pool_.fresh(), &properties), "creating a memory pool"));
  // What is dropped is used again by what comes, without asking the system.
  std::uint64_t keep = ~std::uint64_t{0};
  return cuda_status(cudaMemPoolSetAttribute(pool_.get(), cudaMemPoolAttrReleaseThreshold, &keep),
                     "setting up a memory pool");
}

Status SegmentCache::begin(const SceneReader& reader) {
  return decoder_.set_tables(reader.tables());
}

std::uint64_t SegmentCache::bytes_of(std::uint64_t primitives) const {
  return packed_bytes(static_cast<std::uint32_t>(primitives), sh_degree());
}

void SegmentCache::give_back(std::uint8_t* memory) {
  if (memory != nullptr) cudaFreeAsync(memory, stream_.get());
}

void SegmentCache::release(std::uint32_t segment) {
  const auto found = resident_.find(segment);
  give_back(found->second);
  resident_.erase(found);
}

void SegmentCache::take_in(std::uint32_t segment, std::uint64_t primitives, std::uint8_t* fresh) {
  resident_.emplace(segment, fresh);
  keep(segment, primitives, bytes_of(primitives));
}

Status SegmentCache::send(std::uint32_t segment, const Gaussians4D& set) {
  std::uint8_t* fresh = nullptr;
  STGS_TRY(lay_out(set, fresh));
  take_in(segment, set.size(), fresh);
  return {};
}

Status SegmentCache::decode(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const SceneReader& reader = timeline.reader();
  std::vector<std::optional<Result<CodedSegment>>> read(segments.size());
  parallel_for(std::size_t{0}, read.size(),
               [&](std::size_t k) { read[k].emplace(reader.read(segments[k], true)); });
  std::vector<CodedSegment> coded;
  std::vector<std::uint32_t> numbers;
  for (std::size_t k = 0; k < read.size(); ++k) {
    if (!read[k]->ok()) {
      STGS_TRY(decode_here(timeline, segments[k]));
      continue;
    }
    coded.push_back(std::move(**read[k]));
    numbers.push_back(segments[k]);
  }
  return coded.empty() ? Status() : decode_batch(timeline, coded, numbers);
}

Status SegmentCache::allocate(std::uint32_t primitives, std::uint8_t*& fresh) {
  const std::size_t bytes = std::max<std::size_t>(bytes_of(primitives), 1);
  void* memory = nullptr;
  if (cudaMallocFromPoolAsync(&memory, bytes, pool_.get(), stream_.get()) != cudaSuccess) {
    (void)cudaGetLastError();  // told here, and remembered no longer
    return runtime_error("no {} MiB of GPU memory left for segments", (bytes >> 20) + 1);
  }
  fresh = static_cast<std::uint8_t*>(memory);
  return {};
}

Status SegmentCache::decode_batch(Timeline& timeline, std::span<const CodedSegment> coded,
                                  std::span<const std::uint32_t> segments) {
  std::vector<std::uint8_t*> fresh(coded.size(), nullptr);
  const Result<std::vector<bool>> sound = decode_into(fresh, coded);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (sound.ok() && (*sound)[k]) {
      take_in(segments[k], coded[k].primitives, fresh[k]);
    } else {
      give_back(fresh[k]);
    }
  }
  STGS_TRY(sound.status());
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (!(*sound)[k]) STGS_TRY(decode_here(timeline, segments[k]));
  }
  return {};
}

// Sends a set that is decoded, and waits for it.
Status SegmentCache::lay_out(const Gaussians4D& set, std::uint8_t*& fresh) {
  const auto n = static_cast<std::uint32_t>(set.size());
  STGS_TRY(floats_.ensure((floats_each(sh_degree()) * n + kArrays * kFloatAlign) * sizeof(float)));
  auto* memory = reinterpret_cast<float*>(floats_.data());
  const DeviceGaussians to = take(memory, n, sh_degree());
  const std::pair<float*, const FloatArray*> arrays[] = {{to.position, &set.position},
                                                         {to.log_scale, &set.log_scale},
                                                         {to.rotation, &set.rotation},
                                                         {to.opacity_logit, &set.opacity_logit},
                                                         {to.sh, &set.sh},
                                                         {to.time, &set.time},
                                                         {to.velocity, &set.velocity},
                                                         {to.sigma, &set.sigma},
                                                         {to.radius, &set.radius}};
  for (const auto& [there, here] : arrays) {
    STGS_TRY(cuda_status(cudaMemcpyAsync(there, here->data(), sizeof(float) * here->size(),
                                         cudaMemcpyHostToDevice, stream_.get()),
                         "sending a segment"));
  }
  Status status = allocate(n, fresh);
  if (status.ok()) {
    pack_segment(to, n, sh_degree(), packed_at(fresh, n), stream_.get());
    status = cuda_status(cudaGetLastError(), "starting to lay a segment out");
  }
  const Status ended = cuda_status(cudaStreamSynchronize(stream_.get()), "laying a segment out");
  if (status.ok()) status = ended;
  if (!status.ok()) give_back(fresh);
  return status;
}

Result<std::vector<bool>> SegmentCache::decode_into(std::span<std::uint8_t*> fresh,
                                                    std::span<const CodedSegment> coded) {
  std::vector<const CodedSegment*> pointers;
  std::size_t floats = 0;
  for (std::size_t k = 0; k < coded.size(); ++k) {
    pointers.push_back(&coded[k]);
    floats += floats_each(sh_degree()) * coded[k].primitives + kArrays * kFloatAlign;
    STGS_TRY(allocate(coded[k].primitives, fresh[k]));
  }
  STGS_TRY(floats_.ensure(floats * sizeof(float)));
  auto* memory = reinterpret_cast<float*>(floats_.data());
  std::vector<DeviceGaussians> to;
  for (const CodedSegment& one : coded) to.push_back(take(memory, one.primitives, sh_degree()));
  STGS_TRY(decoder_.prepare(pointers, to));
  STGS_TRY(decoder_.launch(stream_.get()));
  for (std::size_t k = 0; k < coded.size(); ++k) {
    const std::uint32_t n = coded[k].primitives;
    pack_segment(to[k], n, sh_degree(), packed_at(fresh[k], n), stream_.get());
  }
  const cudaError_t started = cudaGetLastError();
  Result<std::vector<bool>> sound = decoder_.finish();
  STGS_TRY(cuda_status(started, "starting to lay segments out"));
  return sound;
}

}  // namespace stgs::player::cuda
