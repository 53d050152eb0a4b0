// SPDX-License-Identifier: Apache-2.0
// An application's picture of its own geometry with an STGS scene in it.
//
// STGS draws the scene's colour, premultiplied, and its depth; the application draws its geometry
// with a depth buffer, then lays the scene over it, pixel by pixel at the scene's depth. What that
// can do: a pixel of the scene has one depth, the mean of all that is seen through it. Where that
// is one surface the geometry is right before it or right behind it, and a half-transparent edge
// blends. Where some of what a pixel shows is before the geometry and some behind, as at the rim of
// something soft and in smoke, the whole pixel goes to the side of its mean.
#pragma once

#include <cstdint>
#include <vector>

#include "gpu.h"

namespace app {

// Column by column, as shaders have it.
struct Matrix {
  float at[16];
};

// Where the application's geometry stands: a cube of that size on a plate.
struct Place {
  float centre[3];  // scene units
  float up[3];      // unit vector
  float half_edge;
};
// The file's start camera; where it has none, a view of all of the scene.
stgs_view first_view(stgs_scene* scene);
// In the middle of the scene's bounds, upright as far as the file tells, else as the camera is
// held.
Place middle_of(const stgs_scene_info& info, const stgs_view& camera);

// A view's picture: an image of the application's, from any layout to COLOR_ATTACHMENT_OPTIMAL.
struct Output {
  VkImage image;
  VkImageView view;
};

class Compositor {
 public:
  // For as many views as there are sizes; pictures are of `format`, UNORM, as colours are encoded.
  // The device outlives it.
  Compositor(Gpu& gpu, VkFormat format, const std::vector<VkExtent2D>& sizes);
  ~Compositor();

  // Draws all views of a moment and returns: the pictures are ready when wait() returns, or for
  // what is submitted to the queue later. `views` are over black.
  void draw(stgs_scene* scene, double seconds, const std::vector<stgs_view>& views,
            const std::vector<Output>& outputs, const Place& place);
  void wait();

 private:
  struct Eye {
    Image colour, depth;  // the scene's
    Image depth_buffer;   // the geometry's
    VkDescriptorSet scene;
  };
  Eye make_eye(VkExtent2D size);
  void make_layouts();
  VkPipeline make_pipeline(VkFormat format, bool composite);
  void submit_scene(stgs_scene* scene, double seconds, const std::vector<stgs_view>& views);
  void record(const Eye& eye, const stgs_view& view, const Output& output, const Place& place);

  Gpu& gpu_;
  stgs_renderer* renderer_ = nullptr;
  VkSampler sampler_ = VK_NULL_HANDLE;
  VkDescriptorSetLayout scene_layout_ = VK_NULL_HANDLE;
  VkDescriptorPool descriptors_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline geometry_ = VK_NULL_HANDLE, composite_ = VK_NULL_HANDLE;
  std::vector<Eye> eyes_;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  // One after the other: STGS has drawn, then the application has.
  VkSemaphore timeline_ = VK_NULL_HANDLE;
  std::uint64_t value_ = 0;
};

}  // namespace app
