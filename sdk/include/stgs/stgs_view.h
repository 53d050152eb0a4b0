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

/* Changes the image size of a view and keeps its horizontal and vertical view angles.
 *
 * Scales each axis on its own, so that another aspect ratio stretches the image: pixels are no
 * longer square. The principal point and the gaze point keep their relative positions in the image;
 * fovea_radius keeps the area of the fovea relative to the image. Otherwise like
 * stgs_view_resize. */
STGS_API stgs_result stgs_view_stretch(stgs_view* view, uint32_t width, uint32_t height);

#ifdef __cplusplus
}
#endif

#endif
