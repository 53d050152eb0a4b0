/* SPDX-License-Identifier: Apache-2.0 */
/* Renders STGS scenes on the Vulkan device of the application, into its images, synchronised by its
 * semaphores. C99; the general rules of stgs.h apply. Needs the Vulkan headers. In a library built
 * without Vulkan all functions fail with STGS_ERROR_NOT_BUILT.
 *
 * Device: Vulkan 1.1 and a queue of a family with VK_QUEUE_COMPUTE_BIT; no extensions and no
 * features are required. stgs_vulkan_get_support checks a physical device before the device is
 * created. Optional features, which the application enables:
 *  - timelineSemaphore (before Vulkan 1.2: VK_KHR_timeline_semaphore), to use timeline semaphores;
 *  - subgroupSizeControl and computeFullSubgroups (before Vulkan 1.3:
 * VK_EXT_subgroup_size_control), which let GPUs with variable subgroup sizes, such as AMD and Intel
 * GPUs, use faster shaders.
 *
 * Queue: a call submits from the calling thread to the one queue of stgs_vulkan_device and never
 * waits for the whole queue or device. Vulkan requires external synchronisation of the queue:
 * lock_queue and unlock_queue are called around each use, so that the application can lock it. */
#ifndef STGS_STGS_VULKAN_H
#define STGS_STGS_VULKAN_H

#include <vulkan/vulkan_core.h>

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_vulkan Vulkan
 *
 *  Renders into images of the application on its Vulkan device.
 *  @{ */

/** @defgroup api_vulkan_device Devices
 *
 *  The device of the application and its renderer.
 *  @{ */

/* The device of the application. It owns all handles; they must outlive the renderer. */
typedef struct stgs_vulkan_device {
  size_t struct_size;
  PFN_vkGetInstanceProcAddr get_instance_proc_addr; /* NULL: from libvulkan.so.1 */
  VkInstance instance;                              /* that the device belongs to */
  uint32_t api_version;             /* VkApplicationInfo::apiVersion, at least VK_API_VERSION_1_1 */
  VkPhysicalDevice physical_device; /* that the device is created on */
  VkDevice device;             /* renders; with the features stated at the top of this header */
  VkQueue queue;               /* receives all submissions */
  uint32_t queue_family;       /* family index of `queue` */
  int32_t timeline_semaphores; /* 1: timelineSemaphore is enabled on the device */
  /* Called before each use of the queue. Set both this and unlock_queue, or neither (NULL). They
   * must not fail or use the renderer. */
  void (*lock_queue)(void* user);
  /* Called after each use of the queue, see lock_queue. */
  void (*unlock_queue)(void* user);
  void* queue_user;              /* argument of lock_queue and unlock_queue */
  int32_t subgroup_size_control; /* 1: subgroupSizeControl and computeFullSubgroups are enabled */
} stgs_vulkan_device;

/* Fills a device with the defaults: null handles, no features, no lock. `struct_size` is
 * sizeof(*device). */
STGS_API stgs_result stgs_vulkan_device_defaults(stgs_vulkan_device* device, size_t struct_size);

/* Capabilities of a physical device. */
typedef struct stgs_vulkan_support {
  size_t struct_size;
  int32_t can_render;            /* 1: supports Vulkan 1.1 with sufficient limits */
  int32_t timeline_semaphores;   /* 1: a device can enable timelineSemaphore */
  char missing_features[128];    /* the first feature or limit that is missing, for messages;
                                  * empty if can_render is 1 */
  int32_t subgroup_size_control; /* 1: a device can enable subgroupSizeControl and
                                  * computeFullSubgroups */
  int32_t reserved;              /* 0 */
  int32_t device_rank;           /* preference among several devices: use the first with the highest
                                  * rank, as STGS_BACKEND_VULKAN does. Discrete GPUs rank above
                                  * other GPUs, and those above CPU drivers; 0: can_render is 0 */
} stgs_vulkan_support;

/* Reports whether devices of device->physical_device can render STGS scenes.
 *
 * Reads instance, api_version, physical_device and get_instance_proc_addr of `device`.
 * STGS_ERROR_UNSUPPORTED: no Vulkan loader was found, or the instance is of Vulkan 1.0. */
STGS_API stgs_result stgs_vulkan_get_support(const stgs_vulkan_device* device,
                                             stgs_vulkan_support* support);

/* Creates a renderer on the device of the application.
 *
 * It works with stgs_vulkan_submit and with every function that takes a renderer; stgs_render and
 * stgs_renderer_destroy wait for its frames and so for their semaphores. `settings` as for
 * stgs_renderer_create, with STGS_BACKEND_AUTO or STGS_BACKEND_VULKAN. The log receives the message
 * of an error. STGS_ERROR_ARGUMENT: a handle is missing, or the queue family lacks compute;
 * STGS_ERROR_UNSUPPORTED: stgs_vulkan_get_support returns the reason. */
STGS_API stgs_result stgs_vulkan_renderer_create(const stgs_vulkan_device* device,
                                                 const stgs_renderer_settings* settings,
                                                 stgs_renderer** out);

/** @} */

/** @defgroup api_vulkan_frames Frames
 *
 *  Rendering into images of the application.
 *  @{ */

/* A mip level and layer of an image of the application, which must outlive the frame. The view
 * fills it. Requires: 2D, one sample, optimal tiling, VK_IMAGE_USAGE_TRANSFER_DST_BIT, and either
 * ownership by the queue family or concurrent sharing. */
typedef struct stgs_vulkan_image {
  VkImage image;                /* VK_NULL_HANDLE: not requested */
  VkFormat format;              /* see stgs_vulkan_target */
  uint32_t width;               /* of the level, pixels; that of the view */
  uint32_t height;              /* of the level, pixels; that of the view */
  uint32_t level;               /* mip level */
  uint32_t layer;               /* array layer */
  VkImageLayout initial_layout; /* on entry; UNDEFINED discards the content */
  VkImageLayout final_layout;   /* after the frame; not UNDEFINED */
} stgs_vulkan_image;

/* The images that receive a view.
 *
 * Colour, with alpha in the fourth channel: R8G8B8A8 or B8G8R8A8, UNORM or SRGB;
 * A2B10G10R10_UNORM_PACK32; R16G16B16A16_SFLOAT or R32G32B32A32_SFLOAT. Every format receives the
 * sRGB-encoded colour over the background of the view; over black, the default, it is premultiplied
 * by alpha. Encoded values are stored as they are, so that sampling an _SRGB image returns linear
 * colour.
 *
 * Depth, optional: R32_SFLOAT, mean camera z, scene units; 0 where alpha is 0. */
typedef struct stgs_vulkan_target {
  size_t struct_size;
  stgs_vulkan_image colour; /* receives colour and alpha */
  stgs_vulkan_image depth;  /* receives depth; default: not requested */
} stgs_vulkan_target;

/* Fills a target with the defaults: no image is requested, initial layout UNDEFINED, final layout
 * GENERAL. `struct_size` is sizeof(*target). */
STGS_API stgs_result stgs_vulkan_target_defaults(stgs_vulkan_target* target, size_t struct_size);

/* A semaphore of the application, which must outlive the frame. */
typedef struct stgs_vulkan_semaphore {
  VkSemaphore semaphore; /* binary or timeline */
  uint64_t value;        /* > 0: value of a timeline semaphore; 0: a binary semaphore */
} stgs_vulkan_semaphore;

/* The views of one time, their targets, and the semaphores around them.
 *
 * The images are accessed after all of `wait`, and are ready and visible to all stages at all of
 * `signal`. Without semaphores, queue order applies: earlier submissions complete first, and later
 * ones see the finished images. */
typedef struct stgs_vulkan_frame {
  size_t struct_size;
  const stgs_view* views;              /* `count` views */
  const stgs_vulkan_target* targets;   /* `count` targets, one per view */
  uint32_t count;                      /* 1 to STGS_MAX_VIEWS */
  uint32_t wait_count;                 /* semaphores to wait for */
  const stgs_vulkan_semaphore* wait;   /* `wait_count` semaphores; NULL if that is 0 */
  const stgs_vulkan_semaphore* signal; /* `signal_count` semaphores; NULL if that is 0 */
  uint32_t signal_count;               /* semaphores to signal */
} stgs_vulkan_frame;

/* Fills a frame with the defaults: no views, no semaphores. `struct_size` is sizeof(*frame). */
STGS_API stgs_result stgs_vulkan_frame_defaults(stgs_vulkan_frame* frame, size_t struct_size);

#define STGS_VULKAN_MAX_FRAMES_IN_FLIGHT 3 /* a further submit waits for the oldest frame */

/* Submits a frame of the scene at the time `seconds` and returns without waiting for the GPU.
 *
 * *number counts the frames of the renderer from 1; `number` may be NULL. For a player, pass
 * stgs_player_scene and the `seconds` of its status. The call uses both the renderer and the scene:
 * no other thread may use either. After the call the scene may be destroyed and the structs and
 * arrays reused.
 *
 * The call waits for earlier frames, and so for their semaphores, in three cases:
 * STGS_VULKAN_MAX_FRAMES_IN_FLIGHT frames are in flight, buffers must grow, or much of the scene
 * must be uploaded first. Signals that those frames wait for must not depend on this thread.
 *
 * After an error nothing was submitted: semaphores and images are untouched. STGS_ERROR_ARGUMENT: a
 * view, image or semaphore is invalid, or the renderer was not created by
 * stgs_vulkan_renderer_create. STGS_ERROR_UNSUPPORTED: a semaphore has a value but the device has
 * no timeline semaphores, or the device cannot copy into a format. Other errors as for
 * stgs_render. */
STGS_API stgs_result stgs_vulkan_submit(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                        const stgs_vulkan_frame* frame, uint64_t* number);

/* Blocks until all frames have completed, and so until their semaphores have been signalled.
 *
 * This hands over images without timeline semaphores, or to another device or queue: the
 * application waits for its own work, submits without semaphores, and waits here. */
STGS_API stgs_result stgs_vulkan_wait(stgs_renderer* renderer);

/* The last frame that completed. */
typedef struct stgs_vulkan_progress {
  size_t struct_size;
  uint64_t number;            /* from stgs_vulkan_submit; 0: none, and all other members are 0 */
  int32_t complete;           /* 0: the farthest splats are missing because buffers were too small;
                               * the renderer has since grown them as far as the device allows */
  uint64_t active_primitives; /* primitives considered at this time */
  uint64_t splats;            /* in view, summed over the views */
  double prepare_ms;          /* CPU time of stgs_vulkan_submit */
  double device_ms;           /* GPU time; 0 if the queue has no timestamps, as are the times of the
                               * steps below */
  double slice_ms;            /* of device_ms: computing the primitives at the time */
  double bin_ms;              /* of device_ms: sorting splats into tiles */
  double blend_ms;            /* of device_ms: blending the pixels */
  uint64_t pending_primitives; /* decoded, but not yet uploaded to the GPU: they, or a better
                                * version of them, are missing. Only while a player is playing */
} stgs_vulkan_progress;

/* Returns the last frame that completed, without waiting. */
STGS_API stgs_result stgs_vulkan_get_progress(stgs_renderer* renderer,
                                              stgs_vulkan_progress* progress);

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

#endif
