/* SPDX-License-Identifier: Apache-2.0 */
/* STGS on the application's Vulkan device, into its images, between its semaphores. C99, beside
 * stgs.h, whose rules of structs, threads and results count here too. Needs Vulkan's headers; a
 * library that was built without Vulkan answers STGS_ERROR_NOT_BUILT.
 *
 * What the device must be made with: no extension and no feature, Vulkan 1.1, and a queue of a
 * family with VK_QUEUE_COMPUTE_BIT. stgs_vulkan_get_support tells before the device is made whether
 * it can be drawn with. Timeline semaphores, where they are wanted, are the application's to enable
 * (timelineSemaphore; before Vulkan 1.2 with VK_KHR_timeline_semaphore). Worth enabling where it is
 * offered: the control of subgroups' sizes (subgroupSizeControl and computeFullSubgroups; before
 * Vulkan 1.3 with VK_EXT_subgroup_size_control). GPUs whose subgroups vary in size, as AMD's and
 * Intel's, draw with the faster shaders then.
 *
 * Queue: a call submits from the thread that it is called on, to the one queue that was lent, and
 * never waits for the whole queue or device. Nobody else may use the queue meanwhile (Vulkan's rule
 * of external synchronisation): lock_queue and unlock_queue are called around each use, so that a
 * lock of the application's can see to it. */
#ifndef STGS_STGS_VULKAN_H
#define STGS_STGS_VULKAN_H

#include <vulkan/vulkan_core.h>

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The application's device. All handles stay its own, and must last until the renderer has been
 * destroyed. */
typedef struct stgs_vulkan_device {
  size_t struct_size;
  PFN_vkGetInstanceProcAddr get_instance_proc_addr; /* NULL: that of libvulkan.so.1 */
  VkInstance instance;
  uint32_t api_version; /* VkApplicationInfo::apiVersion; at least VK_API_VERSION_1_1 */
  VkPhysicalDevice physical_device;
  VkDevice device;
  VkQueue queue;
  uint32_t queue_family;       /* of the queue */
  int32_t timeline_semaphores; /* 0 or 1: whether the device was made with the feature */
  /* Both or none (NULL). They must not fail, nor call functions with the renderer. */
  void (*lock_queue)(void* user);
  void (*unlock_queue)(void* user);
  void* queue_user;
  /* 0 or 1: whether the device was made with subgroupSizeControl and computeFullSubgroups */
  int32_t subgroup_size_control;
} stgs_vulkan_device;

/* All empty, without a lock. `struct_size` is sizeof(*device). */
STGS_API stgs_result stgs_vulkan_device_defaults(stgs_vulkan_device* device, size_t struct_size);

typedef struct stgs_vulkan_support {
  size_t struct_size;
  int32_t can_render;          /* 0 or 1: Vulkan 1.1, and limits that are large enough */
  int32_t timeline_semaphores; /* 0 or 1: whether a device can be made with them */
  char missing_features[128];  /* what it cannot be drawn with for; empty: nothing */
  /* 0 or 1: whether a device can be made with subgroupSizeControl and computeFullSubgroups */
  int32_t subgroup_size_control;
} stgs_vulkan_support;

/* Whether a device of device->physical_device can be drawn with; of `device` the instance, the
 * api_version, the physical_device and get_instance_proc_addr are used. support->struct_size is set
 * by the caller. STGS_ERROR_UNSUPPORTED: there is no Vulkan loader, or the instance is of 1.0. */
STGS_API stgs_result stgs_vulkan_get_support(const stgs_vulkan_device* device,
                                             stgs_vulkan_support* support);

/* A renderer on the device: for stgs_vulkan_submit, and for all that takes a renderer. stgs_render
 * and stgs_renderer_destroy wait for its frames, and so for what they wait for. `settings` as
 * stgs_renderer_create takes them, with backend STGS_BACKEND_AUTO or STGS_BACKEND_VULKAN; the
 * structs are copied. *out is NULL after an error, which the log has in words, else the caller's.
 * STGS_ERROR_ARGUMENT: a handle is missing, or the family does not compute;
 * STGS_ERROR_UNSUPPORTED: as stgs_vulkan_get_support tells. */
STGS_API stgs_result stgs_vulkan_renderer_create(const stgs_vulkan_device* device,
                                                 const stgs_renderer_settings* settings,
                                                 stgs_renderer** out);

/* One level of one layer of an image, which it fills: 2D, one sample, optimal tiling,
 * VK_IMAGE_USAGE_TRANSFER_DST_BIT; the queue family's, or shared by families. It is the
 * application's, and must last until the frame has ended. */
typedef struct stgs_vulkan_image {
  VkImage image; /* VK_NULL_HANDLE: not wanted */
  VkFormat format;
  uint32_t width, height;       /* of the level, pixels: the view's */
  uint32_t level, layer;        /* of mipmaps; of an array */
  VkImageLayout initial_layout; /* in which it is given; UNDEFINED: its content is of no use */
  VkImageLayout final_layout;   /* in which it is left; not UNDEFINED */
} stgs_vulkan_image;

/* Where a view's picture goes.
 * Colour, alpha in its fourth channel: R8G8B8A8 or B8G8R8A8, UNORM or SRGB;
 * A2B10G10R10_UNORM_PACK32; R16G16B16A16_SFLOAT or R32G32B32A32_SFLOAT. All get the sRGB-encoded
 * colour over the view's background: over black, the default, it is premultiplied by alpha. It is
 * written as it is: as an _SRGB image is sampled, it is linear.
 * Depth, optional: R32_SFLOAT, the mean camera z of what is seen, scene units; 0 where alpha is 0.
 */
typedef struct stgs_vulkan_target {
  size_t struct_size;
  stgs_vulkan_image colour;
  stgs_vulkan_image depth;
} stgs_vulkan_target;

/* Nothing wanted; images are taken as UNDEFINED and left as GENERAL. `struct_size` is
 * sizeof(*target). */
STGS_API stgs_result stgs_vulkan_target_defaults(stgs_vulkan_target* target, size_t struct_size);

/* The application's, until the frame has ended. */
typedef struct stgs_vulkan_semaphore {
  VkSemaphore semaphore;
  uint64_t value; /* of a timeline semaphore, > 0; 0: it is a binary one */
} stgs_vulkan_semaphore;

/* The images are touched after all of `wait`, by which the application's work on them must be done,
 * and ready, visible to all stages, at all of `signal`. Without any, in the order of the queue:
 * what was submitted before comes before, and what is submitted later finds them ready. */
typedef struct stgs_vulkan_frame {
  size_t struct_size;
  const stgs_view* views;            /* 1 to STGS_MAX_VIEWS of one moment */
  const stgs_vulkan_target* targets; /* one a view */
  uint32_t count;
  uint32_t wait_count;
  const stgs_vulkan_semaphore* wait;
  const stgs_vulkan_semaphore* signal;
  uint32_t signal_count;
} stgs_vulkan_frame;

/* All empty. `struct_size` is sizeof(*frame). */
STGS_API stgs_result stgs_vulkan_frame_defaults(stgs_vulkan_frame* frame, size_t struct_size);

/* Frames on their way at most; with one more stgs_vulkan_submit waits until the oldest has ended.
 */
#define STGS_VULKAN_MAX_FRAMES_IN_FLIGHT 3

/* Submits the drawing of the moment `seconds` and returns without waiting for it: *number, where
 * `number` is not NULL, counts the renderer's frames from 1 on. Of a player, draw stgs_player_scene
 * at its status's `seconds`. Uses the scene as well as the renderer: neither may be in another
 * call; afterwards the scene may be destroyed, and the structs and arrays be reused.
 *
 * It does wait for earlier frames, and so for their semaphores, where
 * STGS_VULKAN_MAX_FRAMES_IN_FLIGHT are on their way, where buffers must grow, and where much of the
 * scene is sent first: what those wait for must be signalled without this thread.
 *
 * After an error nothing was submitted: no semaphore is waited for or signalled, and no image has
 * changed. STGS_ERROR_ARGUMENT: a view, an image or a semaphore; a renderer that
 * stgs_vulkan_renderer_create has not made. STGS_ERROR_UNSUPPORTED: a semaphore with a value where
 * the device has no timeline semaphores, a format that the device cannot copy into. Others: as of
 * stgs_render. */
STGS_API stgs_result stgs_vulkan_submit(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                        const stgs_vulkan_frame* frame, uint64_t* number);

/* Waits on the host until all frames have ended, and so for what they wait for. This is the way of
 * handing over images where there are no timeline semaphores, or to another device or queue: the
 * application waits for its own work, submits without semaphores, and waits here. */
STGS_API stgs_result stgs_vulkan_wait(stgs_renderer* renderer);

/* The latest frame that has ended. */
typedef struct stgs_vulkan_progress {
  size_t struct_size;
  uint64_t number; /* of stgs_vulkan_submit; 0: none has ended, and all below is 0 */
  /* 0: the frame lacked its farthest splats, for which there was no room; the renderer has made
   * room by then, within what the device can hold. */
  int32_t complete;
  uint64_t active_primitives; /* candidates at the moment */
  uint64_t splats;            /* in view; a sum over the views */
  double prepare_ms;          /* of the processor, in stgs_vulkan_submit */
  double device_ms;           /* of the device; 0 where its queue has no timestamps */
} stgs_vulkan_progress;

/* Looks, and does not wait. progress->struct_size is set by the caller. */
STGS_API stgs_result stgs_vulkan_get_progress(stgs_renderer* renderer,
                                              stgs_vulkan_progress* progress);

#ifdef __cplusplus
}
#endif

#endif
