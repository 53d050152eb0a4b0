/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Unity matrices to a view of the library. */
#ifndef STGS_UNITY_CAMERA_H
#define STGS_UNITY_CAMERA_H

#include "stgs_unity.h"

/* Sets the view of the scene and the length of a scene unit in Unity units. Returns 0 if the
 * matrices do not describe a perspective camera, the scale of the game object is not uniform, or
 * the fovea is invalid. */
int stgs_unity_view(const stgs_unity_camera* camera, stgs_view* view, float* unit);

#endif
