/* SPDX-License-Identifier: Apache-2.0 */
/* The part of Unity's native plugin interface that is used here: what a render event is called
 * with, and how a texture's new content is handed over (CommandBuffer.IssuePluginEvent and
 * IssuePluginCustomTextureUpdateV2). Both work with every graphics API of Unity's on Linux. */
#ifndef STGS_UNITY_ABI_H
#define STGS_UNITY_ABI_H

#include <stdint.h>

/* Called on Unity's render thread. */
typedef void (*unity_event_fn)(int event);
typedef void (*unity_event_and_data_fn)(int event, void* data);

/* Events of a custom texture update, whose data is a unity_texture_update. */
enum { UNITY_UPDATE_TEXTURE_BEGIN = 9, UNITY_UPDATE_TEXTURE_END = 10 };

/* Of the formats those of the textures that are filled; numbers of Unity's GraphicsFormat too. */
enum { UNITY_R8G8B8A8_SRGB = 4, UNITY_R8G8B8A8_UNORM = 8, UNITY_R32_SFLOAT = 49 };

typedef struct unity_texture_update {
  void* pixels; /* set at the beginning, read until the end; NULL: the texture stays as it is */
  intptr_t texture;
  unsigned int user; /* as IssuePluginCustomTextureUpdateV2 was given it */
  int format;
  unsigned int width, height, bytes_per_pixel;
} unity_texture_update;

#endif
