// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/step_pipeline.h"

#include <algorithm>

#include "train/undo_lens.h"

namespace stgs::encoder::cuda {
namespace {

View view_of(const StepInput& input, int stored_coefficients) {
  View view;
  view.camera = input.camera;
  view.centre = math::camera_centre(input.camera);
  view.ticks = input.ticks;
  view.background.colour = input.background;
  view.drop_share = input.drop_share;
  view.drop_random = input.drop_random;
  view.coefficients = std::min((input.sh_degree + 1) * (input.sh_degree + 1), stored_coefficients);
  view.kernel = input.kernel;
  view.width = static_cast<int>(input.camera.width);
  view.height = static_cast<int>(input.camera.height);
  view.tiles_x = (view.width + kTile - 1) / kTile;
  view.tiles_y = (view.height + kTile - 1) / kTile;
  view.planes = input.weight_normal > 0.0f;
  view.gather_camera = input.gather_camera;
  return view;
}

UpdateSettings update_settings(const StepInput& input) {
  UpdateSettings settings{};
  settings.modulated = input.modulated;
  settings.damping = input.damping;
  settings.short_lived = input.short_lived;
  settings.learn_radius = input.learn_radius;
  settings.second_stage = input.second_stage;
  settings.gather_statistics = input.gather_statistics;
  std::copy(input.rates.begin(), input.rates.end(), settings.rates);
  settings.rate_sh0 = input.rate_sh0;
  settings.weight_lifespan = input.weight_lifespan;
  settings.weight_opacity = input.weight_opacity;
  settings.weight_scale = input.weight_scale;
  settings.weight_rate = input.weight_rate;
  return settings;
}

std::size_t tiles_of(int width, int height) {
  return std::size_t{1} * ((width + kTile - 1) / kTile) * ((height + kTile - 1) / kTile);
}

}  // namespace

std::size_t StepPipeline::bytes(std::size_t primitives, int width, int height,
                                std::size_t instances, bool planes) {
  // 7 integers, and up to 9 bytes of memory for sorting.
  constexpr std::size_t kPrimitive = sizeof(ScreenSplat) + (7 + kSums) * 4 + 9 + sizeof(uint2);
  constexpr std::size_t kPixel = 2 * sizeof(float4) + 11 * 4 + 3;
  constexpr std::size_t kInstance = 2 * 4 + 8 + kSums * 4;
  const std::size_t pixels = std::size_t{1} * width * height;
  const std::size_t segments = segment_count(instances, tiles_of(width, height) + 1);
  const std::size_t checkpoints = segments * kTile * kTile * sizeof(float4);
  const std::size_t with_planes =
      checkpoints + (2 * primitives + 2 * pixels + instances) * sizeof(float4);
  const std::size_t block_sums =
      (primitives / kUpdateBlock + 2) * (sizeof(double) + kCameraValues * sizeof(float));
  return block_sums + checkpoints + segments * sizeof(uint2) + primitives * kPrimitive +
         pixels * kPixel + instances * kInstance + (planes ? with_planes : 0);
}

Status StepPipeline::create(cudaStream_t stream) {
  STGS_TRY(counters_.ensure(1));
  workspace_.counters = counters_.data();
  return clear_overflow(stream);
}

Status StepPipeline::reserve(std::size_t primitives, int width, int height, std::size_t instances,
                             bool planes, cudaStream_t stream) {
  const std::size_t pixels = std::size_t{1} * width * height;
  if (primitives > splats_.capacity() || pixels > image_.capacity() ||
      tiles_of(width, height) >= tile_begin_.capacity() || instances > list_.capacity()) {
    STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "waiting for the GPU"));
  }
  STGS_TRY(reserve_primitives(primitives, stream));
  STGS_TRY(reserve_image(width, height, stream));
  with_planes_ = with_planes_ || planes;
  // Grows by half, because the next steps may each need slightly more.
  const std::size_t target = instances > list_.capacity()
                                 ? std::min(instances + instances / 2, kMaxInstances)
                                 : list_.capacity();
  if (reserve_lists(target).ok()) return {};
  STGS_TRY(release_lists(stream));
  return reserve_lists(instances);
}

// Reserves all buffers whose size depends on the number of tile instances.
Status StepPipeline::reserve_lists(std::size_t instances) {
  STGS_TRY(reserve_instances(instances));
  STGS_TRY(reserve_segments());
  return with_planes_ ? reserve_planes() : Status();
}

// Frees those buffers, so that the next reservation can be of the exact size.
Status StepPipeline::release_lists(cudaStream_t stream) {
  STGS_TRY(cuda_status(cudaStreamSynchronize(stream), "waiting for the GPU"));
  entry_keys_.release();
  instances_sorted_.release();
  list_.release();
  partials_.release();
  segments_.release();
  checkpoints_.release();
  surface_checkpoints_.release();
  plane_partials_.release();
  return {};
}

Status StepPipeline::reserve_primitives(std::size_t n, cudaStream_t stream) {
  STGS_TRY(splats_.ensure(n));
  for (auto* array : {&depth_keys_, &keys_sorted_, &order_, &flags_, &offsets_})
    STGS_TRY(array->ensure(n));
  STGS_TRY(block_begin_.ensure(n / kBinPrimitives + 1));
  STGS_TRY(sums_.ensure(kSums / 4 * n));
  STGS_TRY(reserve_sort(n, stream));
  STGS_TRY(ranges_.ensure(n));
  STGS_TRY(regulariser_sums_.ensure(n / kUpdateBlock + 1));
  STGS_TRY(camera_sums_.ensure(kCameraValues * (n / kUpdateBlock + 2)));
  workspace_.splats = splats_.data();
  workspace_.depth_keys = depth_keys_.data();
  workspace_.keys_sorted = keys_sorted_.data();
  workspace_.order = order_.data();
  workspace_.flags = flags_.data();
  workspace_.offsets = offsets_.data();
  workspace_.block_begin = block_begin_.data();
  workspace_.sums = sums_.data();
  workspace_.ranges = ranges_.data();
  workspace_.regulariser_sums = regulariser_sums_.data();
  workspace_.camera_sums = camera_sums_.data();
  return {};
}

// Reserves memory for sorting and scanning n items.
Status StepPipeline::reserve_sort(std::size_t n, cudaStream_t stream) {
  if (n <= iota_.capacity()) return {};
  STGS_TRY(sort_memory_.ensure(sort_memory_bytes(n)));
  workspace_.sort_memory = sort_memory_.data();
  workspace_.sort_bytes = sort_memory_.capacity();
  STGS_TRY(iota_.ensure(n));
  workspace_.iota = iota_.data();
  launch_iota(iota_.data(), iota_.capacity(), stream);
  return {};
}

Status StepPipeline::reserve_image(int width, int height, cudaStream_t stream) {
  const std::size_t pixels = std::size_t{1} * width * height;
  const std::size_t blocks = loss_blocks(width, height);
  STGS_TRY(image_.ensure(pixels));
  STGS_TRY(d_image_.ensure(pixels));
  STGS_TRY(last_.ensure(pixels));
  STGS_TRY(slopes_.ensure(9 * pixels));
  STGS_TRY(error_.ensure(pixels));
  STGS_TRY(without_lens_.ensure(3 * pixels));
  STGS_TRY(lens_sums_.ensure(1 + kLensBlocks));
  const std::size_t tiles = tiles_of(width, height) + 1;
  STGS_TRY(tile_begin_.ensure(tiles));
  if (tiles > tile_entries_.capacity()) {
    STGS_TRY(tile_entries_.ensure(tiles));
    const std::size_t bytes = tile_entries_.capacity() * sizeof(std::uint32_t);
    STGS_TRY(
        cuda_status(cudaMemsetAsync(tile_entries_.data(), 0, bytes, stream), "clearing the tiles"));
  }
  STGS_TRY(ssim_sums_.ensure(blocks));
  STGS_TRY(loss_sums_.ensure(kLossSums * blocks));
  workspace_.image = image_.data();
  workspace_.d_image = d_image_.data();
  workspace_.last = last_.data();
  workspace_.slopes = slopes_.data();
  workspace_.error = error_.data();
  workspace_.without_lens = without_lens_.data();
  workspace_.lens_sums = lens_sums_.data();
  workspace_.tile_begin = tile_begin_.data();
  workspace_.tile_entries = tile_entries_.data();
  workspace_.ssim_sums = ssim_sums_.data();
  workspace_.loss_sums = loss_sums_.data();
  return {};
}

Status StepPipeline::reserve_instances(std::size_t n) {
  STGS_TRY(partials_.ensure(kSums * n));
  STGS_TRY(entry_keys_.ensure(n));
  STGS_TRY(instances_sorted_.ensure(n));
  STGS_TRY(list_.ensure(n));
  workspace_.entry_keys = entry_keys_.data();
  workspace_.instances_sorted = instances_sorted_.data();
  workspace_.list = list_.data();
  workspace_.partials = partials_.data();
  return {};
}

Status StepPipeline::reserve_segments() {
  const std::size_t n = segment_count(list_.capacity(), tile_begin_.capacity());
  STGS_TRY(segments_.ensure(n));
  STGS_TRY(checkpoints_.ensure(n * kTile * kTile));
  workspace_.segments = segments_.data();
  workspace_.checkpoints = checkpoints_.data();
  return {};
}

// Reserves the plane buffers with the capacities of their counterparts.
Status StepPipeline::reserve_planes() {
  STGS_TRY(planes_.ensure(splats_.capacity()));
  STGS_TRY(surface_.ensure(image_.capacity()));
  STGS_TRY(d_surface_.ensure(image_.capacity()));
  STGS_TRY(surface_checkpoints_.ensure(checkpoints_.capacity()));
  STGS_TRY(plane_partials_.ensure(list_.capacity()));
  STGS_TRY(plane_sums_.ensure(splats_.capacity()));
  STGS_TRY(difference_range_.ensure(2));
  STGS_TRY(normal_sums_.ensure(ssim_sums_.capacity()));
  workspace_.planes = planes_.data();
  workspace_.surface = surface_.data();
  workspace_.d_surface = d_surface_.data();
  workspace_.surface_checkpoints = surface_checkpoints_.data();
  workspace_.plane_partials = plane_partials_.data();
  workspace_.plane_sums = plane_sums_.data();
  workspace_.difference_range = difference_range_.data();
  workspace_.normal_sums = normal_sums_.data();
  return {};
}

Status StepPipeline::clear_overflow(cudaStream_t stream) {
  return cuda_status(cudaMemsetAsync(counters_.data(), 0, sizeof(Counters), stream),
                     "clearing the counters");
}

void StepPipeline::set_perceptual(std::unique_ptr<PerceptualNetwork> network) {
  perceptual_ = std::move(network);
  workspace_.perceptual = perceptual_ ? perceptual_->value() : nullptr;
}

Status StepPipeline::enqueue_perceptual(const StepInput& input, const View& view,
                                        const std::uint8_t* ground_truth, const float* colour_map,
                                        cudaStream_t stream) {
  PerceptualStep step;
  step.background = view.background;
  step.image = workspace_.image;
  step.ground_truth = ground_truth;
  step.colour_map = colour_map;
  step.width = view.width;
  step.patch = input.patch;
  step.weight = input.weight_perceptual;
  step.d_image = workspace_.d_image;
  // The colour map sums of the image loss's first block, which follow the sums of L1.
  step.map_stride = loss_blocks(view.width, view.height);
  step.map_sums = workspace_.loss_sums + step.map_stride;
  return perceptual_->enqueue(step, stream);
}

Status StepPipeline::set_ranks(const Ranks& ranks, RankExchange* exchange, std::size_t primitives) {
  exchange_ = exchange;
  blocks_.count = ranks.size();
  blocks_.own = ranks.rank();
  STGS_TRY(block_memory_.ensure(block_bytes(primitives) * static_cast<std::size_t>(blocks_.count)));
  blocks_.data = block_memory_.data();
  return {};
}

Status StepPipeline::enqueue_shared(const DeviceState& state, const StepInput& input,
                                    const View& view, const LossWeights& weights,
                                    StepRecord* records, cudaStream_t stream) {
  const Primitives& primitives = state.primitives();
  const UpdateSettings settings = update_settings(input);
  RankBlocks blocks = blocks_;
  blocks.bytes = block_bytes(primitives.n);
  blocks.stride = row_stride(primitives.n);
  static_assert(kMaxBlocks >= kMaxRanks);
  RankViews views{};
  for (std::size_t r = 0; r < input.batch.size(); ++r) {
    const BatchView& v = input.batch[r];
    views.centre_ticks[r] = {v.centre.x, v.centre.y, v.centre.z, v.ticks};
    views.colour_index[r] = static_cast<std::uint32_t>(v.colour_index);
  }
  launch_contributions(primitives, view, settings, workspace_, blocks, stream);
  launch_head(view, primitives.n, weights, workspace_, blocks, stream);
  stage("contributions");
  STGS_TRY(exchange_->all_gather(blocks.data, blocks.bytes, stream));
  stage("exchange");
  launch_apply(primitives, views, view.coefficients, settings, input.betas, blocks, stream);
  state.round(stream);
  stage("update");
  launch_finish_ranks(views, state.colour(), input.rate_colour, workspace_.counters, blocks,
                      records, stream);
  stage("finish");
  return cuda_status(cudaGetLastError(), "starting a step");
}

Status StepPipeline::enqueue(const DeviceState& state, const StepInput& input,
                             const std::uint8_t* ground_truth, std::size_t instances,
                             StepRecord* record, cudaStream_t stream) {
  const Primitives& primitives = state.primitives();
  View view = view_of(input, primitives.sh_coefficients);
  const LossWeights weights{input.weight_l1, input.weight_ssim, input.weight_normal,
                            input.weight_perceptual};
  const auto index = static_cast<std::uint32_t>(input.colour_index);
  const float* map = state.colour().map + kIdentityColour.size() * input.colour_index;
  if (input.background_is_mapped) view.background.map = map;
  const Workspace& w = workspace_;
  stage("begin");
  launch_slice(primitives, view, w, stream);
  stage("slice");
  launch_bin(primitives.n, view, instances, w, stream);
  stage("bin");
  launch_blend(view, w, stream);
  stage("blend");
  if (!is_pinhole(input.lens)) {
    launch_undo_lens(view, input.lens, ground_truth, w, stream);
    ground_truth = w.without_lens;
    stage("lens");
  }
  launch_image_loss(view, ground_truth, map, weights, w, stream);
  stage("image_loss");
  if (input.weight_perceptual > 0) {
    STGS_TRY(enqueue_perceptual(input, view, ground_truth, map, stream));
    stage("perceptual");
  }
  if (view.planes) {
    launch_normal_loss(view, ground_truth, input.weight_normal, w, stream);
    stage("normal_loss");
  }
  launch_blend_backward(view, instances, w, stream);
  stage("blend_backward");
  launch_sum_instances(primitives, view, w, stream);
  stage("sum_instances");
  if (view.gather_camera) {
    launch_vignetting_gradient(view, w, stream);
    launch_camera_gradient(primitives, view, w, stream);
    stage("camera_gradient");
  }
  if (!input.batch.empty()) return enqueue_shared(state, input, view, weights, record, stream);
  launch_update(primitives, view, update_settings(input), w, stream);
  state.round(stream);
  stage("update");
  launch_finish(view, primitives.n, weights, state.colour(), index, input.rate_colour, record, w,
                stream);
  stage("finish");
  return cuda_status(cudaGetLastError(), "starting a step");
}

Status StepPipeline::enqueue_importance(const DeviceState& state, const StepInput& input,
                                        std::size_t instances, unsigned long long* sums,
                                        Counters* counters, cudaStream_t stream) {
  const Primitives& primitives = state.primitives();
  const View view = view_of(input, primitives.sh_coefficients);
  launch_slice(primitives, view, workspace_, stream);
  launch_bin(primitives.n, view, instances, workspace_, stream);
  launch_importance(view, sums, workspace_, stream);
  STGS_TRY(cuda_status(cudaGetLastError(), "computing the importances"));
  STGS_TRY(cuda_status(
      cudaMemcpyAsync(counters, counters_.data(), sizeof(Counters), cudaMemcpyDeviceToHost, stream),
      "copying the counters"));
  // All but the overflow, which comes last.
  return cuda_status(cudaMemsetAsync(counters_.data(), 0, offsetof(Counters, overflow), stream),
                     "clearing the counters");
}

}  // namespace stgs::encoder::cuda
