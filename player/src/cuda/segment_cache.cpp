// SPDX-License-Identifier: Apache-2.0
#include "cuda/segment_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "stgs/format/parallel.h"

namespace stgs::player::cuda {
namespace {

constexpr double kMiB = 1 << 20;
// Primitives that are decoded at once, about: their floats are held beside what is drawn from.
constexpr std::uint64_t kBatch = 1 << 19;

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

void SegmentCache::clear() {
  while (!held_.empty()) drop(held_.begin());
}

void SegmentCache::drop(Segments::iterator segment) {
  bytes_ -= segment->second.bytes;
  primitives_ -= segment->second.primitives;
  cudaFreeAsync(segment->second.memory, stream_.get());
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

Status SegmentCache::begin(const Timeline& timeline) {
  const auto known = timeline_.lock();
  if (known != nullptr && known == timeline.identity()) return {};
  clear();
  timeline_.reset();
  STGS_TRY(decoder_.set_tables(timeline.reader().tables()));
  sh_degree_ = timeline.reader().sh_degree();
  timeline_ = timeline.identity();
  return {};
}

Status SegmentCache::hold(Timeline& timeline, std::span<const Timeline::Needed> needed,
                          double seconds) {
  STGS_TRY(begin(timeline));
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
  for (const Timeline::Needed* one : decoded) {
    Held held;
    STGS_TRY(send(*one->set, held));
    held.set = one->set;
    keep(one->segment, held);
  }
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
    std::vector<std::optional<Result<CodedSegment>>> read(end - first);
    parallel_for(std::size_t{0}, read.size(),
                 [&](std::size_t k) { read[k].emplace(reader.read(segments[first + k], true)); });
    std::vector<CodedSegment> coded;
    std::vector<std::uint32_t> numbers;
    for (std::size_t k = 0; k < read.size(); ++k) {
      if (!read[k]->ok()) {
        STGS_TRY(decode_here(timeline, segments[first + k]));
        continue;
      }
      coded.push_back(std::move(**read[k]));
      numbers.push_back(segments[first + k]);
    }
    if (!coded.empty()) STGS_TRY(decode_batch(timeline, coded, numbers));
    first = end;
  }
  return {};
}

void SegmentCache::keep(std::uint32_t segment, const Held& held) {
  bytes_ += held.bytes;
  primitives_ += held.primitives;
  held_.emplace(segment, held);
}

Status SegmentCache::allocate(std::uint32_t primitives, Held& held) {
  held.bytes = packed_bytes(primitives, sh_degree_);
  held.primitives = primitives;
  held.used = call_;
  const std::size_t bytes = std::max<std::size_t>(held.bytes, 1);
  if (cudaMallocFromPoolAsync(&held.memory, bytes, pool_.get(), stream_.get()) != cudaSuccess) {
    (void)cudaGetLastError();  // told here, and remembered no longer
    held.memory = nullptr;
    return runtime_error("no {} MiB of GPU memory left for segments", (bytes >> 20) + 1);
  }
  held.packed = packed_at(static_cast<std::uint8_t*>(held.memory), primitives);
  return {};
}

Status SegmentCache::decode_batch(Timeline& timeline, std::span<const CodedSegment> coded,
                                  std::span<const std::uint32_t> segments) {
  std::vector<Held> fresh(coded.size());
  const Result<std::vector<bool>> sound = decode_into(fresh, coded);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (sound.ok() && (*sound)[k]) {
      keep(segments[k], fresh[k]);
    } else if (fresh[k].memory != nullptr) {
      cudaFreeAsync(fresh[k].memory, stream_.get());
    }
  }
  STGS_TRY(sound.status());
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (!(*sound)[k]) STGS_TRY(decode_here(timeline, segments[k]));
  }
  return {};
}

Status SegmentCache::decode_here(Timeline& timeline, std::uint32_t segment) {
  STGS_ASSIGN(const std::optional<Gaussians4D> set, timeline.decode(segment));
  if (!set) return {};
  Held held;
  STGS_TRY(send(*set, held));
  keep(segment, held);
  return {};
}

Status SegmentCache::send(const Gaussians4D& set, Held& held) {
  const auto n = static_cast<std::uint32_t>(set.size());
  STGS_TRY(floats_.ensure((floats_each(sh_degree_) * n + kArrays * kFloatAlign) * sizeof(float)));
  auto* memory = reinterpret_cast<float*>(floats_.data());
  const DeviceGaussians to = take(memory, n, sh_degree_);
  const std::pair<float*, const std::vector<float>*> arrays[] = {
      {to.position, &set.position},
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
  Status status = allocate(n, held);
  if (status.ok()) {
    pack_segment(to, n, sh_degree_, held.packed, stream_.get());
    status = cuda_status(cudaGetLastError(), "starting to lay a segment out");
  }
  const Status ended = cuda_status(cudaStreamSynchronize(stream_.get()), "laying a segment out");
  if (status.ok()) status = ended;
  if (!status.ok() && held.memory != nullptr) cudaFreeAsync(held.memory, stream_.get());
  return status;
}

Result<std::vector<bool>> SegmentCache::decode_into(std::span<Held> fresh,
                                                    std::span<const CodedSegment> coded) {
  std::vector<const CodedSegment*> pointers;
  std::size_t floats = 0;
  for (std::size_t k = 0; k < coded.size(); ++k) {
    pointers.push_back(&coded[k]);
    floats += floats_each(sh_degree_) * coded[k].primitives + kArrays * kFloatAlign;
    STGS_TRY(allocate(coded[k].primitives, fresh[k]));
  }
  STGS_TRY(floats_.ensure(floats * sizeof(float)));
  auto* memory = reinterpret_cast<float*>(floats_.data());
  std::vector<DeviceGaussians> to;
  for (const CodedSegment& one : coded) to.push_back(take(memory, one.primitives, sh_degree_));
  STGS_TRY(decoder_.prepare(pointers, to));
  STGS_TRY(decoder_.launch(stream_.get()));
  for (std::size_t k = 0; k < coded.size(); ++k) {
    pack_segment(to[k], coded[k].primitives, sh_degree_, fresh[k].packed, stream_.get());
  }
  const cudaError_t started = cudaGetLastError();
  Result<std::vector<bool>> sound = decoder_.finish();
  STGS_TRY(cuda_status(started, "starting to lay segments out"));
  return sound;
}

}  // namespace stgs::player::cuda
