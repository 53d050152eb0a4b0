/* SPDX-License-Identifier: Apache-2.0 */
/* STGS into memory of an NVIDIA GPU, in the order of the application's stream. C99, beside stgs.h,
 * whose rules of structs, threads and results count here too. Needs no header of CUDA's. */
#ifndef STGS_STGS_CUDA_H
#define STGS_STGS_CUDA_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

struct CUstream_st; /* cudaStream_t and CUstream are pointers to it */

/* As stgs_render, by a renderer of STGS_BACKEND_CUDA (STGS_ERROR_UNSUPPORTED: another), into memory
 * of its device: of each picture the buffers' `data` are device pointers, and those of rgba8 and
 * their strides multiples of 4. The device that is current when the renderer is created is its own,
 * and must be current, on the calling thread, whenever it is used (STGS_ERROR_ARGUMENT).
 *
 * Waits on the host for the drawing, as it may need more room, but not for `stream`: the buffers
 * are written in its order, after what was put into it before, by which their old use must be done,
 * and ready for what follows in it. `stream` is the application's, of the device; NULL: the default
 * stream. Buffers and stream must last until it has got so far; a later call on the renderer and
 * its destruction wait for that, so that what the stream waits for must come without this thread.
 * After an error the buffers may have any content. */
STGS_API stgs_result stgs_cuda_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                      const stgs_view* views, const stgs_image* pictures,
                                      uint32_t count, struct CUstream_st* stream);

#ifdef __cplusplus
}
#endif

#endif
