// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/motion_lane.h"

#include <algorithm>

#include "backend/cuda/serial_gpu.h"
#include "geometry/masked_median.h"

namespace stgs::encoder::cuda {

using geometry::kLengthBins;
using geometry::MedianBackground;
using geometry::MotionSequence;

namespace {

constexpr std::size_t kAlignment = 256;  // of arrays, bytes
constexpr int kDeviations = 256;

Status checked(cudaError_t error, const char* operation) {
  return with_remedy(cuda_status(error, operation));
}

std::size_t pixels_of(MotionSize size) {
  return static_cast<std::size_t>(size.pixels());
}

bool has_flow(MotionSize size) {
  return std::min(size.width, size.height) >= geometry::kMinFlowSide;
}

FlowPyramid pyramid_of(MotionSize size) {
  FlowPyramid out{};
  out.levels = geometry::coarsest_flow_level(size.width, size.height) + 1;
  out.finest = geometry::finest_flow_level(size.width, size.height);
  for (int l = 0; l < out.levels; ++l) out.size[l] = {size.width >> l, size.height >> l};
  return out;
}

}  // namespace

// Arrays in one block of memory; without one, it only measures them.
class MotionLane::Layout {
 public:
  explicit Layout(std::uint8_t* memory) : memory_(memory) {}
  template <typename T>
  T* take(std::size_t n) {
    const std::size_t at = bytes_;
    bytes_ += (n * sizeof(T) + kAlignment - 1) / kAlignment * kAlignment;
    return memory_ == nullptr ? nullptr : reinterpret_cast<T*>(memory_ + at);
  }
  std::size_t bytes() const { return bytes_; }

 private:
  std::uint8_t* memory_;
  std::size_t bytes_ = 0;
};

Status MotionLane::start() {
  // The device is a setting of the thread.
  STGS_TRY(checked(cudaSetDevice(gpu_), "choosing the GPU"));
  STGS_TRY(with_remedy(stream_.create()));
  STGS_TRY(with_remedy(done_.create_blocking()));
  for (Event& uploaded : uploaded_) STGS_TRY(with_remedy(uploaded.create_blocking()));
  return {};
}

// Has the caller write an image while the ones before are copied.
Status MotionLane::upload(const geometry::FillImage& fill, int i, std::size_t bytes,
                          std::uint8_t* to) {
  PinnedArray<std::uint8_t>& stage = stages_[stage_];
  const Event& uploaded = uploaded_[stage_];
  stage_ = (stage_ + 1) % kStages;
  STGS_TRY(with_remedy(uploaded.wait()));
  STGS_TRY(with_remedy(stage.ensure(bytes)));
  STGS_TRY(fill(i, stage.data()));
  STGS_TRY(checked(cudaMemcpyAsync(to, stage.data(), bytes, cudaMemcpyHostToDevice, stream_),
                   "uploading a frame"));
  return checked(cudaEventRecord(uploaded, stream_), "uploading a frame");
}

Status MotionLane::download(const void* from, std::size_t bytes, void* to) {
  return checked(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToHost, stream_),
                 "reading motion masks");
}

Status MotionLane::clear(void* memory, int byte, std::size_t bytes) {
  return checked(cudaMemsetAsync(memory, byte, bytes, stream_), "clearing GPU memory");
}

Status MotionLane::wait() {
  STGS_TRY(checked(cudaGetLastError(), "detecting motion"));
  STGS_TRY(checked(cudaEventRecord(done_, stream_), "detecting motion"));
  return with_remedy(done_.wait());
}

Result<MedianBackground> MotionLane::find_background(const geometry::MedianSamples& samples) {
  STGS_TRY(start());
  const WaitAtEnd at_end{stream_};
  const MotionSize size{samples.width, samples.height};
  const std::size_t pixels = pixels_of(size), count = static_cast<std::size_t>(samples.count);
  const bool has_masks = samples.mask != nullptr;
  std::uint8_t *rgb = nullptr, *masks = nullptr, *colour = nullptr, *valid = nullptr;
  std::uint32_t* deviations = nullptr;
  for (const bool measures : {true, false}) {
    Layout layout(measures ? nullptr : memory_.data());
    rgb = layout.take<std::uint8_t>(3 * pixels * count);
    masks = layout.take<std::uint8_t>(has_masks ? pixels * count : 0);
    colour = layout.take<std::uint8_t>(3 * pixels);
    valid = layout.take<std::uint8_t>(pixels);
    deviations = layout.take<std::uint32_t>(kDeviations);
    if (measures) STGS_TRY(with_remedy(memory_.ensure(layout.bytes())));
  }
  for (int i = 0; i < samples.count; ++i) {
    const std::size_t at = static_cast<std::size_t>(i) * pixels;
    STGS_TRY(upload(samples.image, i, 3 * pixels, rgb + 3 * at));
    if (has_masks) STGS_TRY(upload(samples.mask, i, pixels, masks + at));
  }
  STGS_TRY(clear(deviations, 0, kDeviations * sizeof(*deviations)));
  launch_median(size, {rgb, has_masks ? masks : nullptr, samples.count}, colour, valid, deviations,
                stream_);
  STGS_TRY(with_remedy(masks_.ensure(4 * pixels)));
  STGS_TRY(with_remedy(counts_.ensure(kDeviations)));
  STGS_TRY(download(colour, 3 * pixels, masks_.data()));
  STGS_TRY(download(valid, pixels, masks_.data() + 3 * pixels));
  STGS_TRY(download(deviations, kDeviations * sizeof(*deviations), counts_.data()));
  STGS_TRY(wait());
  const std::uint8_t* const found = masks_.data();
  return MedianBackground{{found, found + 3 * pixels},
                          {found + 3 * pixels, found + 4 * pixels},
                          geometry::noise_of(counts_.data())};
}

MotionLane::Chunk MotionLane::lay_out(Layout& layout, MotionSize size, int frames) {
  const std::size_t pixels = pixels_of(size), n = static_cast<std::size_t>(frames);
  Chunk out{};
  out.rgb = layout.take<std::uint8_t>((n + 1) * 3 * pixels);
  out.flow.flow = layout.take<Vec2>(n * pixels);
  out.flow.lengths = layout.take<std::uint32_t>(n * kLengthBins);
  out.background = {layout.take<std::uint8_t>(3 * pixels), layout.take<std::uint8_t>(3 * pixels),
                    layout.take<std::uint8_t>(pixels), layout.take<std::uint8_t>(pixels),
                    layout.take<float>(pixels)};
  out.moving = layout.take<std::uint8_t>((n + 1) * pixels);
  out.packed =
      layout.take<std::int16_t>(n * 2 * pixels_of({size.width / 2 + 1, size.height / 2 + 1}));
  MotionMasks& masks = out.masks;
  masks.rgb = out.rgb;
  masks.moving = out.moving;
  masks.weak = layout.take<std::uint8_t>(n * pixels);
  masks.strong = layout.take<std::uint8_t>(n * pixels);
  masks.mask = layout.take<std::uint8_t>(n * pixels);
  masks.labels = layout.take<int>(n * pixels);
  masks.areas = layout.take<int>(n * pixels);
  masks.masked = layout.take<int>(n);
  if (!has_flow(size)) return out;
  FlowPyramid& pyramid = out.pyramid = pyramid_of(size);
  for (int l = 0; l < pyramid.levels; ++l) {
    const std::size_t values = (n + 1) * pixels_of(pyramid.size[l]);
    pyramid.grey[l] = layout.take<float>(values);
    if (l >= pyramid.finest) pyramid.gradient[l] = layout.take<Vec2>(values);
  }
  for (int k = 0; k < 2; ++k) {
    out.scratch.field[k] = layout.take<Vec2>(2 * n * flow_field_values(pyramid));
    out.scratch.patches[k] = layout.take<geometry::PatchFlow>(2 * n * flow_patches(pyramid));
  }
  return out;
}

Status MotionLane::allocate(MotionSize size, int frames) {
  size_ = size;
  Layout measured(nullptr);
  (void)lay_out(measured, size, frames);
  STGS_TRY(with_remedy(memory_.ensure(measured.bytes())));
  Layout layout(memory_.data());
  chunk_ = lay_out(layout, size, frames);
  chunk_.masks.slots = {0, frames + 1};
  const std::size_t n = static_cast<std::size_t>(frames);
  STGS_TRY(with_remedy(masks_.ensure(n * pixels_of(size))));
  STGS_TRY(with_remedy(counts_.ensure(n)));
  return with_remedy(packed_.ensure(n * packed_values()));
}

std::size_t MotionLane::packed_values() const {
  return 2 * pixels_of({(size_.width + 1) / 2, (size_.height + 1) / 2});
}

Status MotionLane::start_background(const MotionSequence& sequence) {
  const std::size_t bytes = 3 * pixels_of(size_);
  const auto copy = [&](int, std::uint8_t* out) -> Status {
    std::copy_n(sequence.background, bytes, out);
    return {};
  };
  STGS_TRY(upload(copy, 0, bytes, chunk_.background.colour));
  launch_background(size_, chunk_.background,
                    static_cast<float>(geometry::threshold_base(sequence.noise)), stream_);
  return clear(chunk_.moving, 0, (kMotionChunk + 1) * pixels_of(size_));
}

// Loads the images before `last`. `first`: image 0 of the slots.
Status MotionLane::load_images(const MotionSequence& sequence, int first, int last) {
  const std::size_t bytes = 3 * pixels_of(size_);
  const int loaded = loaded_;
  for (; loaded_ < last; ++loaded_) {
    STGS_TRY(upload(sequence.image, loaded_, bytes,
                    chunk_.rgb + bytes * chunk_.masks.slots.at(loaded_ - first)));
  }
  if (sequence.use_flow && !sequence.flow && has_flow(size_)) {
    launch_pyramid(chunk_.pyramid, chunk_.rgb, chunk_.masks.slots, loaded - first, loaded_ - first,
                   stream_);
  }
  return {};
}

// Finds the flow of the pairs, and the pixels that it moves. Flow of too small images is unknown.
Status MotionLane::start_flow(const MotionSequence& sequence, int first) {
  const std::size_t pixels = pixels_of(size_);
  CheckedFlow& flow = chunk_.flow;
  if (sequence.flow) {
    given_flow_.resize(2 * pixels);
    for (int k = 0; k < flow.pairs; ++k) {
      STGS_TRY(sequence.flow(first + k, given_flow_.data()));
      // Returns after it has read memory that is not page-locked.
      STGS_TRY(checked(
          cudaMemcpyAsync(flow.flow + static_cast<std::size_t>(k) * pixels, given_flow_.data(),
                          pixels * sizeof(Vec2), cudaMemcpyHostToDevice, stream_),
          "uploading flow"));
    }
  } else if (has_flow(size_)) {
    launch_flow(size_, chunk_.pyramid, chunk_.masks.slots, chunk_.scratch, flow, stream_);
  } else {
    constexpr int kNotANumber = 0xff;
    STGS_TRY(clear(flow.flow, kNotANumber,
                   static_cast<std::size_t>(flow.pairs) * pixels * sizeof(Vec2)));
  }
  STGS_TRY(clear(flow.lengths, 0,
                 static_cast<std::size_t>(flow.pairs * kLengthBins) * sizeof(*flow.lengths)));
  launch_flow_lengths(size_, flow, stream_);
  launch_moving(size_, flow, chunk_.moving + pixels, stream_);
  return {};
}

Status MotionLane::start_chunk(const MotionSequence& sequence, int first) {
  const std::size_t pixels = pixels_of(size_);
  MotionMasks& masks = chunk_.masks;
  masks.frames = std::min(kMotionChunk, sequence.frames - first);
  masks.slots.first = first % masks.slots.slots;
  const int after = first + masks.frames;
  const int images = sequence.use_flow ? std::min(after + 1, sequence.frames) : after;
  STGS_TRY(load_images(sequence, first, images));
  chunk_.flow.pairs = sequence.use_flow ? images - 1 - first : 0;
  const std::size_t frames = static_cast<std::size_t>(masks.frames);
  std::uint8_t* const last_moving = chunk_.moving + frames * pixels;
  if (chunk_.flow.pairs > 0) STGS_TRY(start_flow(sequence, first));
  if (chunk_.flow.pairs < masks.frames) STGS_TRY(clear(last_moving, 0, pixels));
  launch_changes(size_, chunk_.background, masks, stream_);
  STGS_TRY(clear(masks.masked, 0, frames * sizeof(*masks.masked)));
  launch_masks(size_, masks, stream_);
  STGS_TRY(checked(
      cudaMemcpyAsync(chunk_.moving, last_moving, pixels, cudaMemcpyDeviceToDevice, stream_),
      "detecting motion"));
  STGS_TRY(download(masks.mask, frames * pixels, masks_.data()));
  STGS_TRY(download(masks.masked, frames * sizeof(*masks.masked), counts_.data()));
  if (chunk_.flow.pairs == 0) return {};
  launch_pack_flow(size_, chunk_.flow, masks.mask, chunk_.packed, stream_);
  return download(
      chunk_.packed,
      static_cast<std::size_t>(chunk_.flow.pairs) * packed_values() * sizeof(std::int16_t),
      packed_.data());
}

Status MotionLane::hand_over(const MotionSequence& sequence, int first) {
  for (int k = 0; k < chunk_.masks.frames; ++k) {
    const std::size_t at = static_cast<std::size_t>(k);
    const bool flows = k < chunk_.flow.pairs;
    STGS_TRY(sequence.take({first + k, masks_.data() + at * pixels_of(size_),
                            static_cast<int>(counts_.data()[at]),
                            flows ? packed_.data() + at * packed_values() : nullptr}));
  }
  return {};
}

Status MotionLane::find_motion(const MotionSequence& sequence) {
  STGS_TRY(start());
  const WaitAtEnd at_end{stream_};
  STGS_TRY(allocate({sequence.width, sequence.height}, kMotionChunk));
  STGS_TRY(start_background(sequence));
  loaded_ = 0;
  for (int first = 0; first < sequence.frames; first += kMotionChunk) {
    STGS_TRY(start_chunk(sequence, first));
    STGS_TRY(wait());
    STGS_TRY(hand_over(sequence, first));
  }
  return {};
}

Result<std::vector<std::int16_t>> MotionLane::find_flow(const geometry::FlowPair& pair) {
  const MotionSize size{pair.width, pair.height};
  size_ = size;
  if (!has_flow(size))
    return std::vector<std::int16_t>(packed_values(), std::int16_t{geometry::kUnknownFlow});
  STGS_TRY(start());
  const WaitAtEnd at_end{stream_};
  STGS_TRY(allocate(size, 1));
  const std::size_t pixels = pixels_of(size);
  for (const int k : {0, 1})
    STGS_TRY(
        upload(pair.image, k, 3 * pixels, chunk_.rgb + static_cast<std::size_t>(k) * 3 * pixels));
  STGS_TRY(upload(pair.mask, 0, pixels, chunk_.masks.mask));
  chunk_.flow.pairs = 1;
  launch_pyramid(chunk_.pyramid, chunk_.rgb, chunk_.masks.slots, 0, 2, stream_);
  launch_flow(size, chunk_.pyramid, chunk_.masks.slots, chunk_.scratch, chunk_.flow, stream_);
  launch_pack_flow(size, chunk_.flow, chunk_.masks.mask, chunk_.packed, stream_);
  STGS_TRY(download(chunk_.packed, packed_values() * sizeof(std::int16_t), packed_.data()));
  STGS_TRY(wait());
  return std::vector<std::int16_t>(packed_.data(), packed_.data() + packed_values());
}

}  // namespace stgs::encoder::cuda
