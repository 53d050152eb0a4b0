/* SPDX-License-Identifier: Apache-2.0 */
/* Unity's matrices as a view of the library's. */
#ifndef STGS_UNITY_CAMERA_H
#define STGS_UNITY_CAMERA_H

#include "stgs_unity.h"

/* The view of the scene, and the length of a scene unit in Unity's. 0: the matrices are none of a
 * perspective camera, or of an object whose scales differ, or the fovea is none. */
int stgs_unity_view(const stgs_unity_camera* camera, stgs_view* view, float* unit);

#endif
