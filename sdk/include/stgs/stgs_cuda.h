/* SPDX-License-Identifier: Apache-2.0 */
/* Renders STGS scenes into memory of an NVIDIA GPU, ordered by a stream of the application. C99;
 * the general rules of stgs.h apply. Needs no CUDA headers. */
#ifndef STGS_STGS_CUDA_H
#define STGS_STGS_CUDA_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_cuda CUDA
 *
 *  Renders into CUDA memory, ordered by a stream of the application.
 *  @{ */

struct CUstream_st; /* cudaStream_t and CUstream are pointers to it */

/* Renders into device memory, otherwise like stgs_render.
 *
 * `data` of the image buffers are device pointers; for rgba8 the pointer and the stride are
 * multiples of 4. The renderer uses STGS_BACKEND_CUDA (otherwise STGS_ERROR_UNSUPPORTED). It
 * belongs to the device that was current when it was created, which must be current on the calling
 * thread in every call (STGS_ERROR_ARGUMENT).
 *
 * The call waits for rendering, because buffers may have to grow, but not for `stream`. The buffers
 * are written in stream order: after all work submitted to the stream before the call, and before
 * all work submitted after it. NULL is the default stream. Buffers and stream must stay valid until
 * the stream reaches that point. A later call on the renderer and its destruction wait for it, so
 * work ahead of it in the stream must not depend on this thread. After an error the content of the
 * buffers is undefined. */
STGS_API stgs_result stgs_cuda_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                      const stgs_view* views, const stgs_image* images,
                                      uint32_t count, struct CUstream_st* stream);

/** @} */

#ifdef __cplusplus
}
#endif

#endif
