// SPDX-License-Identifier: Apache-2.0
// Composites an STGS scene with geometry of the application.
//
// STGS renders premultiplied colour and depth. The application renders its geometry with a depth
// buffer, then blends the scene over it, each pixel at the depth of the scene. The method has a
// limit: a pixel of the scene has a single depth, the mean of everything visible through it. For a
// single surface, geometry is correctly in front or behind, and half-transparent edges blend. A
// pixel whose content lies partly in front of the geometry and partly behind it, as at soft edges
// and in smoke, goes entirely to the side of its mean.
#pragma once

#include <cstdint>
#include <vector>

#include "gpu.h"

namespace app {

// Column-major, as in shaders.
struct Matrix {
  float at[16];
};

// Placement of the application's geometry, a cube on a plate.
struct Placement {
  float centre[3];  // scene units
  float up[3];      // unit vector
  float half_edge;  // scene units
};
// Returns the start camera of the file or, without one, a view of the whole scene.
stgs_view first_view(stgs_scene* scene);
// Returns the centre of the scene's bounds, upright if the file states an up direction, otherwise
// aligned with the camera.
Placement centre_of(const stgs_scene_info& info, const stgs_view& camera);

// An image of the application that receives a view; any layout, left as COLOR_ATTACHMENT_OPTIMAL.
struct Output {
  VkImage image;
  VkImageView view;
};

class Compositor {
 public:
  // Creates a compositor for one view per size. `format` is the UNORM format of the outputs,
  // because colours are already encoded. The device must outlive it.
  Compositor(Gpu& gpu, VkFormat format, const std::vector<VkExtent2D>& sizes);
  ~Compositor();

  // Submits all views of one time. The outputs are ready after wait(), and for later submissions to
  // the queue. The background of `views` must be black.
  void render(stgs_scene* scene, double seconds, const std::vector<stgs_view>& views,
              const std::vector<Output>& outputs, const Placement& cube);
  void wait();

 private:
  struct Eye {
    Image colour, depth;  // of the scene
    Image depth_buffer;   // of the geometry
    VkDescriptorSet scene;
  };
  Eye create_eye(VkExtent2D size);
  void create_layouts();
  VkPipeline create_pipeline(VkFormat format, bool composite);
  void submit_scene(stgs_scene* scene, double seconds, const std::vector<stgs_view>& views);
  void record(const Eye& eye, const stgs_view& view, const Output& output, const Placement& cube);

  Gpu& gpu_;
  stgs_renderer* renderer_ = nullptr;
  VkSampler sampler_ = VK_NULL_HANDLE;
  VkDescriptorSetLayout scene_layout_ = VK_NULL_HANDLE;
  VkDescriptorPool descriptors_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline geometry_ = VK_NULL_HANDLE, composite_ = VK_NULL_HANDLE;
  std::vector<Eye> eyes_;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  // Counts finished steps: STGS and the application render in turn.
  VkSemaphore timeline_ = VK_NULL_HANDLE;
  std::uint64_t value_ = 0;
};

}  // namespace app
