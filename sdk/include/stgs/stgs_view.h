/* SPDX-License-Identifier: Apache-2.0 */
/* Helpers for views. C99; stgs.h includes it.
 *
 * They need no object and return only a result, without a message. After an error the view is
 * unchanged. */
#ifndef STGS_STGS_VIEW_H
#define STGS_STGS_VIEW_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @addtogroup api_views
 *  @{ */

/* Changes the image size of a view and keeps its horizontal and vertical view angles.
 *
 * Scales each axis on its own, so that another aspect ratio stretches the image: pixels are no
 * longer square. The principal point and the gaze point keep their relative positions in the image;
 * fovea_radius keeps the area of the fovea relative to the image. Otherwise like
 * stgs_view_resize. */
STGS_API stgs_result stgs_view_stretch(stgs_view* view, uint32_t width, uint32_t height);

/* Moves the camera of a view to `eye` and points it at `target`; lens and image size stay.
 *
 * All vectors are in scene units. `up` points against gravity and may have any length: for example
 * stgs_scene_info.up. NULL or 0, 0, 0: the present up direction of the view. STGS_ERROR_ARGUMENT: a
 * value is not finite, eye and target coincide, `up` is parallel to the line between them, or the
 * view is invalid. */
STGS_API stgs_result stgs_view_look_at(stgs_view* view, const float eye[3], const float target[3],
                                       const float up[3]);

/* Moves the camera of a view on a sphere around `centre`, which stays at its place in the image.
 *
 * First rotates the camera by `azimuth` radians around the axis through `centre` along `up`; from a
 * level camera, positive angles move it to its right. Then raises it by `elevation` radians towards
 * `up`, up to 89 degrees above or below the centre. `up` as for stgs_view_look_at. For a turntable
 * of n frames, call it n times with 2 * pi / n and 0. STGS_ERROR_ARGUMENT: a value is not finite,
 * the camera is at `centre`, or the view is invalid. */
STGS_API stgs_result stgs_view_orbit(stgs_view* view, const float centre[3], const float up[3],
                                     double azimuth, double elevation);

/** @} */

#ifdef __cplusplus
}
#endif

#endif
