/* SPDX-License-Identifier: Apache-2.0 */
/* Contents of an open scene: metadata, issues, cameras and primitives. C99; stgs.h includes it.
 *
 * Every function fails with STGS_ERROR_STATE before the scene is open. */
#ifndef STGS_STGS_SCENE_H
#define STGS_STGS_SCENE_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @addtogroup api_scenes
 *  @{ */

/** @defgroup api_metadata Metadata
 *
 *  Duration, size, axes, texts and defects of an open scene.
 *  @{ */

/* Metadata of a scene. */
typedef struct stgs_scene_info {
  size_t struct_size;
  uint16_t format_major;          /* major version of the file format */
  uint16_t format_minor;          /* minor version of the file format */
  uint32_t frames;                /* length of the clip */
  uint32_t time_base_numerator;   /* a frame lasts numerator / denominator seconds */
  uint32_t time_base_denominator; /* see time_base_numerator */
  double duration_seconds;        /* the clip is [0, duration) */
  double complete_seconds;        /* no data is missing before this time */
  uint64_t primitives;            /* in the file */
  uint64_t file_bytes;            /* size of the file */
  uint64_t memory_bytes;          /* decoded data retained at present */
  int32_t sh_degree;              /* of the spherical harmonics, 0 to 3 */
  int32_t has_start_camera;       /* 1: stgs_scene_start_view succeeds */
  float bounds_min[3];            /* lower corner of the positions of all primitives, scene units */
  float bounds_max[3];            /* upper corner of the same */
  float metres_per_unit;          /* 0: not known */
  float up[3];                    /* unit vector; 0, 0, 0: not known */
  float floor[3];                 /* a point on the floor, scene units; valid if `up` is known */
  uint32_t issues;                /* number of issues, see stgs_scene_get_issue */
  float near_plane;               /* scene units; content nearer than this was never trained */
  float background[3];            /* red, green, blue, encoded as the colours of the scene */
  double audio_begin_seconds;     /* start of the audio, see STGS_TEXT_AUDIO */
  int32_t colour_primaries;       /* of the colours, ITU-T H.273: 1 is BT.709 */
  int32_t transfer_function;      /* of the colours, ITU-T H.273: 13 is sRGB */
  int32_t kernel;                 /* of the splats: 0, dilated as in 3DGS; 1, band-limited */
  int32_t reserved;               /* 0 */
} stgs_scene_info;

/* Returns the metadata of the scene. */
STGS_API stgs_result stgs_scene_get_info(stgs_scene* scene, stgs_scene_info* info);

/* Text in the metadata of a scene. */
typedef int32_t stgs_text;
enum {
  STGS_TEXT_TITLE = 0,     /* title of the scene */
  STGS_TEXT_GENERATOR = 1, /* program and version that wrote the file */
  STGS_TEXT_AUDIO = 2,     /* URI reference of the audio, relative to the location of the file */
  STGS_TEXT_PROFILE = 3, /* coding: "lossless", "quantised", "draco", "near-lossless", "unknown" */
  STGS_TEXT_NAME = 4     /* of the file in messages: its path, its URL without credentials and
                          * query, or stgs_scene_settings.name */
};

/* Returns a text, or an empty string if the file has none. The string belongs to the scene and is
 * valid until the scene is destroyed. */
STGS_API stgs_result stgs_scene_get_text(stgs_scene* scene, stgs_text which, const char** out);

/* A defect of the file that was found, and could be tolerated, when the file was opened. */
typedef struct stgs_issue {
  size_t struct_size;
  int32_t number;      /* as in `stgs validate` */
  int32_t is_error;    /* 0: a warning */
  uint64_t offset;     /* position in the file, bytes */
  const char* message; /* belongs to the scene; valid until the scene is destroyed */
} stgs_issue;

/* Returns an issue of the file. `index` is 0 to stgs_scene_info.issues - 1. */
STGS_API stgs_result stgs_scene_get_issue(stgs_scene* scene, uint32_t index, stgs_issue* issue);

/** @} */

/** @defgroup api_cameras Cameras
 *
 *  The start camera of a scene, and a view of its bounds.
 *  @{ */

/* Returns the start camera of the file, with its near plane and background.
 *
 * Fails with STGS_ERROR_UNSUPPORTED if the file has no start camera. *view is written in this case
 * too: the defaults with the near plane and background of the file, level if the file states an up
 * direction. The image may be up to STGS_MAX_SIDE pixels wide and high. */
STGS_API stgs_result stgs_scene_start_view(stgs_scene* scene, stgs_view* view);

/* Moves the camera of a view so that its image shows the bounds of the scene, centred, with a
 * margin.
 *
 * Moves a near plane that would cut the bounds in front of them; direction, lens and everything
 * else stay. Reads no primitives. Bounds of a single point, as in an empty scene, count as 1 metre
 * wide, or 1 unit if the scale is not known. STGS_ERROR_UNSUPPORTED: the camera would be more than
 * 2^60 units away. */
STGS_API stgs_result stgs_scene_frame_view(stgs_scene* scene, stgs_view* view);

/** @} */

/** @defgroup api_primitives Primitives
 *
 *  The Gaussians of a scene as arrays.
 *  @{ */

/* Arrays of the caller that receive primitives at one time. They must not overlap. NULL: not
 * requested. */
typedef struct stgs_primitives {
  size_t struct_size;
  uint64_t capacity; /* of each array, primitives */
  uint32_t* id;      /* index of the primitive in the file, in the order of the segments */
  float* position;   /* 3 floats each: x, y, z at the time, scene units */
  float* velocity;   /* 3 floats each: scene units per second */
  float* scale;      /* 3 floats each: standard deviations along the axes, scene units */
  float* rotation;   /* 4 floats each: orientation of the axes, unit quaternion w, x, y, z */
  float* opacity;    /* 1 float each: at the time, 1/255 to 1 */
  float* sh;         /* 3 * (sh_degree + 1)^2 floats each: red, green and blue of one spherical
                      * harmonic after the other, basis and order of 3D Gaussian Splatting */
} stgs_primitives;

/* Fills the struct with the defaults: no array is requested. `struct_size` is
 * sizeof(*primitives). */
STGS_API stgs_result stgs_primitives_defaults(stgs_primitives* primitives, size_t struct_size);

/* Returns the primitives that are visible at the time `seconds`, which is in the clip as for
 * stgs_render.
 *
 * *count is the number of visible primitives; the arrays receive as many of them as fit, in the
 * order of the file. All values are finite: those beyond the range of float are clamped to it. NULL
 * primitives: count only. After an error the content of the arrays is undefined. STGS_ERROR_LIMIT:
 * as for stgs_render. */
STGS_API stgs_result stgs_scene_get_primitives(stgs_scene* scene, double seconds,
                                               const stgs_primitives* primitives, uint64_t* count);

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

#endif
