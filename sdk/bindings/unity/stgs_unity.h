/* SPDX-License-Identifier: Apache-2.0 */
/* STGS scenes in textures of Unity: a native plugin of plain C functions for
 * DllImport("stgs_unity").
 *
 *   start:       handle = stgs_unity_open(path, 1 << 30, 0)
 *                stgs_player_play(stgs_unity_player(handle))
 *   each frame:  stgs_unity_frame(handle, Time.timeAsDouble, cameras, count)
 *                commands.IssuePluginEvent(stgs_unity_render_event(), handle)
 *                commands.IssuePluginCustomTextureUpdateV2(
 *                    stgs_unity_texture_event(), texture, stgs_unity_texture(handle, 0, 0))
 *   end:         stgs_unity_close(handle)
 *
 * Axes: local x, y, z of the game object are x, -y, z of the scene, so that a scene that is upright
 * in OpenCV axes is upright in Unity. Textures begin with the bottom row, as usual in Unity.
 *
 * Threads: call the functions on the main thread. Unity calls the two events on its render
 * thread. */
#ifndef STGS_UNITY_H
#define STGS_UNITY_H

#include "stgs/stgs.h"
#include "unity_abi.h"

#define STGS_UNITY_MAX_HANDLES 64 /* open at the same time */

/* Starts to open a path or URL and returns a handle >= 1, or -result after an error.
 *
 * `memory_budget` as in stgs_player_settings, 0: its default; `backend` is a STGS_BACKEND_ value.
 * Release the handle with stgs_unity_close. */
STGS_API int32_t stgs_unity_open(const char* location, uint64_t memory_budget,
                                 stgs_backend backend);

/* Closes a handle once the render thread no longer uses it. Does nothing for an invalid handle. */
STGS_API void stgs_unity_close(int32_t handle);

/* Returns the player of a handle, valid until the handle is closed; NULL: the handle is invalid.
 *
 * Use it with stgs_player_play and other functions (DllImport("libstgs.so.0")), except
 * stgs_player_update and functions on its scene. */
STGS_API stgs_player* stgs_unity_player(int32_t handle);

/* A Unity camera. Matrices are column-major, like Matrix4x4 in memory. */
typedef struct stgs_unity_camera {
  float local_to_world[16];  /* of the game object: rotation, translation, uniform scale */
  float world_to_camera[16]; /* Camera.worldToCameraMatrix, or GetStereoViewMatrix of an eye */
  float projection[16];      /* Camera.projectionMatrix, or GetStereoProjectionMatrix of an eye */
  uint32_t width, height;    /* of the textures, pixels */
  /* As in stgs_view, but from the bottom left corner. Radius 0: none. */
  float fovea_x, fovea_y, fovea_radius;
} stgs_unity_camera;

/* Advances the player to `clock` and stores 1 to STGS_MAX_VIEWS cameras for the next render event.
 *
 * `clock` is in seconds. Returns the state of the player (STGS_PLAYER_), or -result.
 * STGS_ERROR_ARGUMENT: the handle is invalid, a camera is not a perspective camera, the scale of
 * the game object is not uniform, or a fovea is invalid. */
STGS_API int32_t stgs_unity_frame(int32_t handle, double clock, const stgs_unity_camera* cameras,
                                  uint32_t count);

/* Returns the render event. Its argument is the handle; it renders the stored cameras. */
STGS_API unity_event_fn stgs_unity_render_event(void);

/* Returns the texture event. Its user data is from stgs_unity_texture; it copies the last rendered
 * image into the texture. A texture of another size or format stays unchanged. */
STGS_API unity_event_and_data_fn stgs_unity_texture_event(void);

/* Plane of a rendered image. */
enum {
  STGS_UNITY_COLOUR = 0, /* RGBA32: colour over black, premultiplied by alpha */
  STGS_UNITY_DEPTH = 1   /* RFloat: camera depth, Unity units; 0 where alpha is 0 */
};

/* Returns the user data of the texture event for a plane of a camera. `camera` is the index passed
 * to stgs_unity_frame. */
STGS_API uint32_t stgs_unity_texture(int32_t handle, uint32_t camera, uint32_t plane);

/* Returns the result of the last render event and copies its message, truncated to `bytes`
 * including the terminating 0. NULL message: not returned. */
STGS_API stgs_result stgs_unity_error(int32_t handle, char* message, size_t bytes);

/* Closes all handles. Unity calls it when it unloads the plugin. */
STGS_API void UnityPluginUnload(void);

#endif
