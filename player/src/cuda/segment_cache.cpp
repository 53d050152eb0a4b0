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
constexpr std::uint32_t kCopied = 2048;  // primitives per task

std::size_t floats_each(int sh_degree) {
  return static_cast<std::size_t>(17 + 3 * (sh_degree + 1) * (sh_degree + 1));
}

// Lays out the arrays of n primitives at `memory` and advances it to their end.
DeviceGaussians lay_out_arrays(float*& memory, std::size_t n, int sh_degree) {
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

// Copies a range of a set's arrays with several threads, since one thread is slower than the bus.
void copy_range(const Gaussians4D& set, const PrimitiveRange& range, const DeviceGaussians& to) {
  const std::pair<float*, const FloatArray*> arrays[kArrays] = {
      {to.position, &set.position},
      {to.log_scale, &set.log_scale},
      {to.rotation, &set.rotation},
      {to.opacity_logit, &set.opacity_logit},
      {to.sh, &set.sh},
      {to.time, &set.time},
      {to.velocity, &set.velocity},
      {to.sigma, &set.sigma},
      {to.radius, &set.radius}};
  parallel_blocks(0u, range.count, kCopied, [&](std::uint32_t begin, std::uint32_t end) {
    for (const auto& [copy, array] : arrays) {
      const std::size_t each = array->size() / range.of;
      const float* const from = array->data() + each * range.first;
      std::copy(from + each * begin, from + each * end, copy + each * begin);
    }
  });
}

}  // namespace

Status SegmentCache::create() {
  STGS_TRY(cuda_status(cudaStreamCreateWithFlags(stream_.fresh(), cudaStreamNonBlocking),
                       "creating a stream"));
  cudaMemPoolProps properties{};
  properties.allocType = cudaMemAllocationTypePinned;
  properties.location.type = cudaMemLocationTypeDevice;
  STGS_TRY(cuda_status(cudaGetDevice(&properties.location.id), "querying the current device"));
  STGS_TRY(cuda_status(cudaMemPoolCreate(pool_.fresh(), &properties), "creating a memory pool"));
  // Reuse freed memory without returning it to the system.
  std::uint64_t threshold = ~std::uint64_t{0};
  return cuda_status(
      cudaMemPoolSetAttribute(pool_.get(), cudaMemPoolAttrReleaseThreshold, &threshold),
      "setting up a memory pool");
}

Status SegmentCache::begin(const SceneReader& reader) {
  return decoder_.set_tables(reader.tables(), stream_.get());
}

// Freed memory stays in the pool. Trims it first, since blocks of another scene may not fit.
void SegmentCache::reserve(std::uint64_t bytes) {
  (void)cudaStreamSynchronize(stream_.get());
  (void)cudaMemPoolTrimTo(pool_.get(), 0);
  void* memory = nullptr;
  if (cudaMallocFromPoolAsync(&memory, bytes, pool_.get(), stream_.get()) == cudaSuccess) {
    cudaFreeAsync(memory, stream_.get());
  } else {
    (void)cudaGetLastError();  // reported once an allocation of a segment fails
  }
}

std::uint64_t SegmentCache::bytes_of(std::uint64_t primitives) const {
  return packed_bytes(static_cast<std::uint32_t>(primitives), sh_degree());
}

void SegmentCache::free(std::uint8_t* memory) {
  if (memory != nullptr) cudaFreeAsync(memory, stream_.get());
}

void SegmentCache::release(std::uint32_t segment) {
  if (const auto found = resident_.extract(segment)) free(found.mapped());
}

void SegmentCache::replace(std::uint32_t segment, const CodedSegment& coded, std::uint8_t* fresh) {
  release(segment);
  resident_.emplace(segment, fresh);
  insert(segment, coded.primitives, bytes_of(coded.primitives), coded.time_origin);
}

Status SegmentCache::upload(std::uint32_t segment, const Gaussians4D& set, std::size_t first) {
  const auto n = static_cast<std::uint32_t>(set.size());
  if (first == 0) {
    cancel_upload(segment);
    STGS_TRY(allocate(n, incomplete_[segment]));
  }
  const auto count = static_cast<std::uint32_t>(std::min(kMaxUploadPrimitives, n - first));
  STGS_TRY(
      upload_range(set, {static_cast<std::uint32_t>(first), count, n}, incomplete_.at(segment)));
  if (first + count < n) return {};
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream_.get()), "packing a segment"));
  release(segment);
  resident_.insert(incomplete_.extract(segment));
  insert(segment, n, bytes_of(n), set.time_origin);
  return {};
}

void SegmentCache::cancel_upload(std::uint32_t segment) {
  if (const auto found = incomplete_.extract(segment)) free(found.mapped());
}

Status SegmentCache::decode(Timeline& timeline, std::span<const std::uint32_t> segments) {
  const SceneReader& reader = timeline.reader();
  std::vector<std::optional<Result<CodedSegment>>> read(segments.size());
  parallel_for(std::size_t{0}, read.size(), [&](std::size_t k) {
    read[k].emplace(reader.read(segments[k], true, reader.render_origin(segments[k])));
  });
  std::vector<CodedSegment> coded;
  std::vector<std::uint32_t> numbers;
  for (std::size_t k = 0; k < read.size(); ++k) {
    if (!read[k]->ok()) {
      STGS_TRY(decode_on_cpu(timeline, segments[k]));
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
  const cudaError_t error = cudaMallocFromPoolAsync(&memory, bytes, pool_.get(), stream_.get());
  if (error != cudaSuccess) {
    (void)cudaGetLastError();  // reported here; clear it
    // An earlier asynchronous error.
    if (error != cudaErrorMemoryAllocation) return cuda_status(error, "allocating memory");
    return {StatusCode::kNoMemory,
            fmt::format("out of GPU memory for segments (requested {} MiB)", (bytes >> 20) + 1)};
  }
  fresh = static_cast<std::uint8_t*>(memory);
  return {};
}

Status SegmentCache::decode_batch(Timeline& timeline, std::span<const CodedSegment> coded,
                                  std::span<const std::uint32_t> segments) {
  std::vector<std::uint8_t*> fresh(coded.size(), nullptr);
  const Result<std::vector<bool>> intact = decode_into(fresh, coded);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (intact.ok() && (*intact)[k]) {
      replace(segments[k], coded[k], fresh[k]);
    } else {
      free(fresh[k]);
    }
  }
  STGS_TRY(intact.status());
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (!(*intact)[k]) STGS_TRY(decode_on_cpu(timeline, segments[k]));
  }
  return {};
}

// Uploads a range of a set and starts packing it.
Status SegmentCache::upload_range(const Gaussians4D& set, const PrimitiveRange& range,
                                  std::uint8_t* fresh) {
  const auto bytes_of_floats = [this](std::uint64_t n) {
    return (floats_each(sh_degree()) * n + kArrays * kFloatAlign) * sizeof(float);
  };
  // Allocate for the largest upload at once, instead of growing with each larger one.
  const std::uint64_t max_primitives =
      std::clamp<std::uint64_t>(peak().primitives, range.count, kMaxUploadPrimitives);
  STGS_TRY(floats_.ensure(bytes_of_floats(max_primitives)));
  STGS_TRY(staging_.ensure(bytes_of_floats(max_primitives)));
  STGS_ASSIGN(std::uint8_t* const staged, staging_.next());
  auto *host = reinterpret_cast<float*>(staged), *device = reinterpret_cast<float*>(floats_.data());
  copy_range(set, range, lay_out_arrays(host, range.count, sh_degree()));
  const DeviceGaussians to = lay_out_arrays(device, range.count, sh_degree());
  STGS_TRY(staging_.upload(floats_.data(), bytes_of_floats(range.count), stream_.get()));
  pack_segment(to, range, sh_degree(), packed_at(fresh, range.of), stream_.get());
  return cuda_status(cudaGetLastError(), "launching the packing of a segment");
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
  for (const CodedSegment& one : coded)
    to.push_back(lay_out_arrays(memory, one.primitives, sh_degree()));
  STGS_TRY(decoder_.prepare(pointers, to));
  STGS_TRY(decoder_.launch(stream_.get()));
  for (std::size_t k = 0; k < coded.size(); ++k) {
    const std::uint32_t n = coded[k].primitives;
    pack_segment(to[k], {0, n, n}, sh_degree(), packed_at(fresh[k], n), stream_.get());
  }
  const cudaError_t started = cudaGetLastError();
  Result<std::vector<bool>> intact = decoder_.finish();
  STGS_TRY(cuda_status(started, "launching the packing of segments"));
  return intact;
}

}  // namespace stgs::player::cuda
