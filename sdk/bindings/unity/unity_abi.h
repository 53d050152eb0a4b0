/* SPDX-License-Identifier: Apache-2.0 */
/* The part of the Unity native plugin interface that the plugin uses: render events and custom
 * texture updates (CommandBuffer.IssuePluginEvent and IssuePluginCustomTextureUpdateV2). Both work
 * with every graphics API of Unity on Linux. */
#ifndef STGS_UNITY_ABI_H
#define STGS_UNITY_ABI_H

#include <stdint.h>

/* Called on the render thread. */
typedef void (*unity_event_fn)(int event);
typedef void (*unity_event_and_data_fn)(int event, void* data);

/* Events of a custom texture update; `data` is a unity_texture_update. */
enum { UNITY_UPDATE_TEXTURE_BEGIN = 9, UNITY_UPDATE_TEXTURE_END = 10 };

/* Supported texture formats; values of GraphicsFormat. */
enum { UNITY_R8G8B8A8_SRGB = 4, UNITY_R8G8B8A8_UNORM = 8, UNITY_R32_SFLOAT = 49 };

typedef struct unity_texture_update {
  void* pixels; /* set by the begin event, read until the end event; NULL: texture unchanged */
  intptr_t texture;
  unsigned int user; /* user data passed to IssuePluginCustomTextureUpdateV2 */
  int format;        /* GraphicsFormat */
  unsigned int width, height, bytes_per_pixel;
} unity_texture_update;

#endif
