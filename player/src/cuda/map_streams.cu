// SPDX-License-Identifier: Apache-2.0
// A thread block maps a chunk of a stream, its threads successive primitives. Float products and
// sums are rounded separately: fused operations would differ from the CPU.
#include "cuda/map_streams.h"

#include <cub/block/block_reduce.cuh>
#include <cub/block/block_scan.cuh>

#include "stgs/format/math/lifespan.h"

namespace stgs::player::cuda {
namespace {

constexpr std::uint32_t kThreads = 256, kWarp = 32;
constexpr std::uint32_t kRounds = kMapChunk / kThreads;
constexpr std::uint32_t kMaxWidth = 4;  // components mapped together, and floats they result in

using Reduce = cub::BlockReduce<std::uint32_t, kThreads>;
using Scan = cub::BlockScan<std::uint32_t, kThreads>;

// 2^e, |e| <= 126.
__device__ float power_of_two(int e) {
  return __int_as_float((e + 127) << 23);
}

// Exact, as is its product with an integer in range.
__device__ float size_of(int multiplier, int exponent) {
  return __fmul_rn(static_cast<float>(multiplier), power_of_two(exponent));
}

__device__ std::uint32_t symbol_at(const MapPlane& plane, std::uint32_t i) {
  return plane.symbols != nullptr ? plane.symbols[i] : plane.only;
}

// Returns the value of a component, composed from its digits.
__device__ std::uint32_t value_at(const MapJob& job, std::uint32_t component, std::uint32_t i) {
  const MapPlane* plane = job.planes + component * job.digits;
  std::uint32_t value = 0;
  int shift = 0;
  for (std::uint32_t d = 0; d < job.digits; ++d) {
    value |= symbol_at(plane[d], i) << shift;
    shift += job.digit_bits[d];
  }
  return value;
}

// Returns the low bits of a position.
__device__ std::uint32_t low_at(const MapJob& job, std::uint32_t axis, std::uint32_t i) {
  const MapPlane* plane = job.planes + job.digits + axis * job.low_digits;
  std::uint32_t value = 0;
  for (std::uint32_t d = 0; d < job.low_digits; ++d) value |= symbol_at(plane[d], i) << 8 * d;
  return value;
}

// Returns the difference of a value from the one before it.
__device__ std::uint32_t difference_at(const MapJob& job, std::uint32_t component,
                                       std::uint32_t i) {
  const std::uint32_t value = value_at(job, component, i);
  return job.prediction == Prediction::kMorton ? value : unzigzag(value);
}

__device__ bool in_range(const MapJob& job, std::uint32_t q) {
  return q + job.max_steps <= 2 * job.max_steps;
}

__device__ float number(std::uint32_t q) {
  return static_cast<float>(static_cast<std::int32_t>(q));
}

__device__ float linear(const MapJob& job, float origin, std::uint32_t q) {
  const float step = size_of(job.step.multiplier, job.step.exponent);
  return __fadd_rn(origin, __fmul_rn(step, number(q)));
}

// Replaces q by the bits b (spec 8.5).
__device__ bool truncated(const MapJob& job, std::uint32_t& q, float& out) {
  const std::uint32_t first = __float_as_uint(job.origin[0]);
  const std::uint32_t step = static_cast<std::uint32_t>(job.step.multiplier) << job.step.exponent;
  const bool good = in_range(job, q) && q <= (kMaxTruncated - first) / step;
  q = first + q * step;
  out = __fsub_rn(__uint_as_float(q), job.origin[1]);
  return good;
}

// spec 8.6. `i`: the primitive.
__device__ float displacement(const MapJob& job, std::uint32_t i, std::uint32_t q) {
  const int exponent =
      job.step.exponent - lifespan_exponent(job.sigma[i], job.radius[i], job.part_exponent);
  return __fmul_rn(number(q),
                   size_of(job.step.multiplier, min(max(exponent, kMinExponent), kMaxExponent)));
}

// spec 8.8. `i`: the primitive.
__device__ int rotation_exponent(const MapJob& job, std::uint32_t i) {
  int e = job.step.exponent;
  if (job.mapping == Mapping::kShapedRotation) {
    e += 3;
    for (const std::uint32_t bound : job.shape_bounds) e -= job.spread[i] >= bound ? 1 : 0;
  }
  return min(max(e, kMinRotationExponent), kMaxRotationExponent);
}

// spec 8.7.
__device__ bool rotation(const MapJob& job, int e, const std::uint32_t (&q)[kMaxWidth],
                         float (&out)[kMaxWidth]) {
  const auto m = static_cast<std::uint32_t>(job.step.multiplier), limit = 1u << -e;
  std::uint32_t rest = limit * limit;
  bool good = true;
  for (int c = 0; c < 3; ++c) {
    const std::uint32_t x = m * q[c];
    good = good && in_range(job, q[c]) && x + limit - 1 <= 2 * limit - 2;
    rest -= x * x;
    out[c + 1] = __fmul_rn(number(q[c]), size_of(job.step.multiplier, e));
  }
  good = good && static_cast<std::int32_t>(rest) > 0;
  out[0] = __fmul_rn(power_of_two(e), __fsqrt_rn(good ? number(rest) : 0.0f));
  return good;
}

// Maps components [c, c + width) of value i. Sigma and radius leave their bits in q. Returns false
// if a value is out of range.
__device__ bool map_values(const MapJob& job, std::uint32_t c, std::uint32_t i,
                           std::uint32_t (&q)[kMaxWidth], float (&out)[kMaxWidth]) {
  switch (job.mapping) {
    case Mapping::kFloat:
      for (std::uint32_t k = 0; k < kMaxWidth; ++k) {
        q[k] <<= job.step.exponent;
        out[k] = __uint_as_float(q[k]);
      }
      return true;
    case Mapping::kTruncated:
      return truncated(job, q[0], out[0]);
    case Mapping::kDisplacement:
      out[0] = displacement(job, i, q[0]);
      return in_range(job, q[0]);
    case Mapping::kRotation:
    case Mapping::kShapedRotation:
      return rotation(job, rotation_exponent(job, i), q, out);
    case Mapping::kColour: {
      const std::uint32_t luma = q[0], orange = q[1], chroma = q[2];
      out[0] = linear(job, 0.0f, luma - chroma + orange);
      out[1] = linear(job, 0.0f, luma + chroma);
      out[2] = linear(job, 0.0f, luma - chroma - orange);
      return in_range(job, luma) && in_range(job, orange) && in_range(job, chroma);
    }
    case Mapping::kTime:
      out[0] = __fadd_rn(linear(job, job.origin[0], q[0]), job.time_base);
      return in_range(job, q[0]);
    default: {
      bool good = true;
      for (std::uint32_t k = 0; k < job.width; ++k) {
        out[k] = linear(job, job.origin[(c + k) % 3], q[k]);
        good = good && in_range(job, q[k]);
      }
      return good;
    }
  }
}

// Leaves what other streams of primitive i depend on.
__device__ void keep(const MapJob& job, std::uint32_t i, const std::uint32_t (&q)[kMaxWidth]) {
  if (job.keep == nullptr) return;
  if (job.attribute != Attribute::kLogScale) {
    job.keep[i] = q[0];
    return;
  }
  const int x = static_cast<int>(q[0]), y = static_cast<int>(q[1]), z = static_cast<int>(q[2]);
  job.keep[i] =
      static_cast<std::uint32_t>(max(max(x, y), z)) - static_cast<std::uint32_t>(min(min(x, y), z));
}

// Returns whether a primitive with these values of the attribute can be rendered (spec 6.3).
__device__ bool is_renderable(const MapJob& job, const float* v, std::uint32_t count) {
  bool finite = true, zero = true;
  for (std::uint32_t k = 0; k < count; ++k) {
    finite = finite && isfinite(v[k]);
    zero = zero && v[k] == 0.0f;
  }
  if (job.attribute == Attribute::kSigma) return finite && v[0] > 0.0f;
  if (job.attribute == Attribute::kRadius) return finite && v[0] >= 0.0f;
  return finite && !(zero && job.attribute == Attribute::kRotation);
}

// Returns `before` plus the inclusive prefix sum of the differences; adds their total to `before`.
// All threads of the block call it.
__device__ std::uint32_t running_sum(std::uint32_t difference, std::uint32_t& before) {
  __shared__ typename Scan::TempStorage storage;
  std::uint32_t sum = 0, total = 0;
  Scan(storage).InclusiveSum(difference, sum, total);
  __syncthreads();
  sum += before;
  before += total;
  return sum;
}

__global__ void __launch_bounds__(kThreads) sum_kernel(const MapJob* jobs, const MapWork* works) {
  __shared__ typename Reduce::TempStorage storage;
  const MapWork work = works[blockIdx.x];
  const MapJob& job = jobs[work.job];
  std::uint32_t sum = 0;
  for (std::uint32_t r = 0; r < kRounds; ++r) {
    const std::uint32_t i = work.chunk * kMapChunk + r * kThreads + threadIdx.x;
    if (i < job.values) sum += difference_at(job, work.component, i);
  }
  sum = Reduce(storage).Sum(sum);
  if (threadIdx.x == 0) job.sums[std::uint64_t{work.chunk} * job.components + work.component] = sum;
}

// One thread block per job, one warp per component: scans its chunks, 32 at a time.
__global__ void __launch_bounds__(kThreads)
    chunk_kernel(const MapJob* jobs, const std::uint32_t* summed) {
  const MapJob& job = jobs[summed[blockIdx.x]];
  const std::uint32_t lane = threadIdx.x % kWarp, chunks = job.chunks;
  for (std::uint32_t c = threadIdx.x / kWarp; c < job.components; c += kThreads / kWarp) {
    std::uint32_t before = job.prediction == Prediction::kMorton ? job.first_key : 0;
    for (std::uint32_t first = 0; first < chunks; first += kWarp) {
      const std::uint32_t chunk = first + lane;
      std::uint32_t* const at = job.sums + std::uint64_t{chunk} * job.components + c;
      const std::uint32_t own = chunk < chunks ? *at : 0;
      std::uint32_t sum = own;
      for (std::uint32_t step = 1; step < kWarp; step *= 2) {
        const std::uint32_t other = __shfl_up_sync(0xFFFFFFFFu, sum, step);
        if (lane >= step) sum += other;
      }
      if (chunk < chunks) *at = before + sum - own;
      before += __shfl_sync(0xFFFFFFFFu, sum, kWarp - 1);
    }
  }
}

// Maps Morton keys and low bits to positions (spec 8.4). Returns false if the first key, a
// difference or a key has more than 30 bits, or a value is invalid.
__device__ bool map_keys(const MapJob& job, std::uint32_t chunk) {
  std::uint32_t before = job.sums[chunk];
  bool valid = job.first_key >> (3 * kKeyBits) == 0;
  for (std::uint32_t r = 0; r < kRounds; ++r) {
    const std::uint32_t i = chunk * kMapChunk + r * kThreads + threadIdx.x;
    const bool inside = i < job.values;
    const std::uint32_t step = inside ? value_at(job, 0, i) : 0;
    const std::uint32_t key = running_sum(step, before);
    if (!inside) continue;
    valid = valid && (step | key) >> (3 * kKeyBits) == 0;
    float v[3];
    for (std::uint32_t axis = 0; axis < 3; ++axis) {
      const std::uint32_t q = (compact3(key >> axis) << job.low) + low_at(job, axis, i);
      v[axis] = linear(job, job.origin[axis], q);
      valid = valid && in_range(job, q);
      job.to[std::uint64_t{i} * job.stride + axis] = v[axis];
    }
    valid = valid && is_renderable(job, v, 3);
  }
  return valid;
}

// Maps components [c, c + width) of a chunk. Returns false if a value must be rejected.
__device__ bool map_components(const MapJob& job, std::uint32_t chunk, std::uint32_t c,
                               std::uint32_t width) {
  const bool summed = job.prediction == Prediction::kDelta;
  const std::uint32_t floats =
      width == 3 && job.attribute == Attribute::kRotation ? kMaxWidth : width;
  std::uint32_t before[kMaxWidth] = {};
  for (std::uint32_t k = 0; summed && k < width; ++k) {
    before[k] = job.sums[std::uint64_t{chunk} * job.components + c + k];
  }
  bool valid = true;
  for (std::uint32_t r = 0; r < kRounds; ++r) {
    const std::uint32_t i = chunk * kMapChunk + r * kThreads + threadIdx.x;
    const bool inside = i < job.values;
    std::uint32_t q[kMaxWidth] = {};
    for (std::uint32_t k = 0; k < width; ++k) {
      const std::uint32_t v = inside ? value_at(job, c + k, i) : 0u;
      q[k] = job.prediction == Prediction::kPlain ? v : unzigzag(v);
      if (summed) q[k] = running_sum(q[k], before[k]);
    }
    if (!inside) continue;
    float v[kMaxWidth] = {};
    valid = map_values(job, c, i, q, v) && valid;
    keep(job, i, q);
    const std::uint64_t at = job.members != nullptr ? job.members[i] : i;
    for (std::uint32_t k = 0; k < floats; ++k) job.to[at * job.stride + c + k] = v[k];
    valid = is_renderable(job, v, floats) && valid;
  }
  return valid;
}

__global__ void __launch_bounds__(kThreads) map_kernel(const MapJob* jobs, const MapWork* works) {
  const MapWork work = works[blockIdx.x];
  const MapJob& job = jobs[work.job];
  const bool valid = job.prediction == Prediction::kMorton
                         ? map_keys(job, work.chunk)
                         : map_components(job, work.chunk, work.component, job.width);
  if (!valid) *job.is_invalid = 1;
}

constexpr unsigned kClearBlocks = 16;  // per range

__global__ void __launch_bounds__(kThreads) clear_kernel(const ClearJob* jobs) {
  const ClearJob job = jobs[blockIdx.x];
  const std::uint64_t fours = job.floats / 4;
  const std::uint64_t first = blockIdx.y * kThreads + threadIdx.x;
  for (std::uint64_t i = first; i < fours; i += kClearBlocks * kThreads)
    reinterpret_cast<float4*>(job.to)[i] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
  if (first < job.floats % 4) job.to[4 * fours + first] = 0.0f;
}

constexpr unsigned kEndBlocks = 16;  // per job

__global__ void __launch_bounds__(kThreads) end_kernel(const EndJob* jobs) {
  const EndJob job = jobs[blockIdx.x];
  for (std::uint32_t k = blockIdx.y * kThreads + threadIdx.x; k < job.count;
       k += kEndBlocks * kThreads) {
    const CodedEnd end = job.ends[k];
    const std::size_t i = end.primitive;
    const float before = job.set.time[i];
    const math::Lifespan ended =
        math::ended_lifespan(before, job.set.radius[i], job.begin, end.time);
    job.set.time[i] = ended.time;
    job.set.radius[i] = ended.radius;
    const float dt = __fsub_rn(ended.time, before);
    for (std::size_t c = 3 * i; c < 3 * i + 3; ++c)
      job.set.position[c] = __fadd_rn(job.set.position[c], __fmul_rn(job.set.velocity[c], dt));
  }
}

}  // namespace

void apply_ends(const EndJob* jobs, std::uint32_t count, cudaStream_t stream) {
  if (count > 0) end_kernel<<<dim3(count, kEndBlocks), kThreads, 0, stream>>>(jobs);
}

void clear_ranges(const ClearJob* jobs, std::uint32_t count, cudaStream_t stream) {
  if (count > 0) clear_kernel<<<dim3(count, kClearBlocks), kThreads, 0, stream>>>(jobs);
}

void sum_differences(const MapJob* jobs, const MapWork* work, std::uint32_t count,
                     const std::uint32_t* summed, std::uint32_t jobs_summed, cudaStream_t stream) {
  if (count == 0) return;
  sum_kernel<<<count, kThreads, 0, stream>>>(jobs, work);
  chunk_kernel<<<jobs_summed, kThreads, 0, stream>>>(jobs, summed);
}

void map_streams(const MapJob* jobs, const MapWork* work, std::uint32_t count,
                 cudaStream_t stream) {
  if (count > 0) map_kernel<<<count, kThreads, 0, stream>>>(jobs, work);
}

}  // namespace stgs::player::cuda
