/* SPDX-License-Identifier: Apache-2.0 */
/* STGS scenes in Unity's textures: a native plugin of plain C functions, for
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
 * Scene and Unity: the object's local x is the scene's x, its y the scene's -y, its z the scene's
 * z, so that a scene that stands upright in OpenCV's axes stands upright in Unity's. A texture has
 * its first row at the bottom, as Unity's have.
 *
 * Threads: the functions are Unity's main thread's, the two events its render thread's. */
#ifndef STGS_UNITY_H
#define STGS_UNITY_H

#include "stgs/stgs.h"
#include "unity_abi.h"

#define STGS_UNITY_MAX_HANDLES 64

/* Begins to open a path or URL. `memory_budget` as of stgs_player_settings, 0: its default;
 * `backend` one of STGS_BACKEND_. A handle from 1 on, or -result. The handle is the caller's. */
STGS_API int32_t stgs_unity_open(const char* place, uint64_t memory_budget, stgs_backend backend);
/* Ends what the handle stands for, when the render thread has done with it. Others: nothing. */
STGS_API void stgs_unity_close(int32_t handle);
/* For stgs_player_play and all else that a player does (DllImport("libstgs.so.0")), except its
 * updates and its scene. Until the handle is closed; NULL: no such handle. */
STGS_API stgs_player* stgs_unity_player(int32_t handle);

/* What a Unity camera sees; matrices column after column, as a Matrix4x4 lies in memory. */
typedef struct stgs_unity_camera {
  float local_to_world[16];  /* of the object that the scene is: rotation, translation, one scale */
  float world_to_camera[16]; /* Camera.worldToCameraMatrix, or of an eye GetStereoViewMatrix */
  float projection[16];      /* Camera.projectionMatrix, or GetStereoProjectionMatrix */
  uint32_t width, height;    /* of the textures, pixels */
  /* As of stgs_view, but counted from the textures' first row, the lower one. 0: none. */
  float fovea_x, fovea_y, fovea_radius;
} stgs_unity_camera;

/* Moves the player on to `clock`, seconds, and keeps 1 to STGS_MAX_VIEWS cameras for the next
 * render event. The player's state (STGS_PLAYER_), or -result: STGS_ERROR_ARGUMENT is a handle that
 * there is not, a camera that is not one of perspective, or an object of several scales, or a fovea
 * that is none. */
STGS_API int32_t stgs_unity_frame(int32_t handle, double clock, const stgs_unity_camera* cameras,
                                  uint32_t count);

/* With the handle as event: draws the cameras that were kept last. */
STGS_API unity_event_fn stgs_unity_render_event(void);
/* With stgs_unity_texture as user data: the picture that was drawn last, where the texture has its
 * size and format; else it stays as it is. */
STGS_API unity_event_and_data_fn stgs_unity_texture_event(void);

/* Colour over black, premultiplied by alpha, RGBA32; camera depth in Unity's units, 0 where nothing
 * is, RFloat. */
enum { STGS_UNITY_COLOUR = 0, STGS_UNITY_DEPTH = 1 };
STGS_API uint32_t stgs_unity_texture(int32_t handle, uint32_t camera, uint32_t plane);

/* How the last render event ended; the message is cut to `bytes`, 0 at its end included. */
STGS_API stgs_result stgs_unity_error(int32_t handle, char* message, size_t bytes);

/* Unity's, when the plugin is unloaded: closes every handle. */
STGS_API void UnityPluginUnload(void);

#endif
