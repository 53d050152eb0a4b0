/* SPDX-License-Identifier: Apache-2.0 */
/* Records .stgs scenes live. C99; stgs_encoder.h includes it.
 *
 *   stgs_recorder_create(&recorder);
 *   stgs_recorder_begin(recorder, "live.stgs", NULL);
 *   stgs_recorder_append(recorder, &fragment);  repeatedly, every half second for example
 *   stgs_recorder_close(recorder);
 *   stgs_recorder_destroy(recorder);
 *
 * A recorder appends fragments of primitives, as a live capture produces them, to a file that
 * players follow while it grows (stgs_player_get_live), through a web server too. One recorder
 * writes one file. One thread at a time may use a recorder; recorders are independent. */
#ifndef STGS_STGS_ENCODER_RECORDER_H
#define STGS_STGS_ENCODER_RECORDER_H

#include "stgs/stgs_encoder.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_recording Recording
 *  @ingroup api_encoding
 *
 *  Records scenes live. Needs libstgs_encoder.
 *  @{ */

/* Writes a recording. */
typedef struct stgs_recorder stgs_recorder;

/* Settings of a recording. */
typedef struct stgs_record_settings {
  size_t struct_size;
  uint32_t time_base_numerator;   /* a frame lasts numerator / denominator seconds; */
  uint32_t time_base_denominator; /* default 1 / 30 */
  int32_t sh_degree;              /* of all fragments, 0 to 3; default 0 */
  stgs_profile profile;           /* default STGS_PROFILE_QUANTISED; or STGS_PROFILE_DRACO */
  int32_t tiers;                  /* as in stgs_pack_settings, 1 to 16; 0 (default): automatic */
  double quality;                 /* 0 to 100; default 87 */
  double max_error;               /* upper bound of position errors, thousandths of a scene unit,
                                   * 10^-6 to 10^9; 0 (default): from quality */
  double chunk_seconds;           /* shortest segment, 0.01 to 3600; 0 (default): from the first
                                   * fragment */
  int32_t sync;                   /* 1 (default): appended data survives a power failure; 0: it
                                   * survives the end of the process, and calls do not wait for the
                                   * disk */
  uint32_t threads;               /* limit, up to 1024; 0 (default): all cores */
  /* Metadata of the scene: */
  const char* title;           /* up to 4096 bytes; NULL (default): none */
  double metres_per_unit;      /* 10^-9 to 10^9; 0 (default): not known */
  float up[3];                 /* opposite to gravity, any length, components up to 10^9; 0, 0, 0
                                * (default): not known */
  float floor[3];              /* a point on the floor, scene units, components up to 10^9; used if
                                * `up` is known */
  const stgs_view* start_view; /* for stgs_scene_start_view; the fovea is not stored. NULL
                                * (default): no camera, near plane and background as in
                                * stgs_view_defaults */
  const char* audio;           /* URI reference of the audio, relative to the location of the file,
                                * up to 4096 bytes; NULL (default): none */
  double audio_begin;          /* start of the audio, seconds, -10^6 to 10^6; default 0 */
  int32_t kernel;              /* that the primitives were trained for: 0 (default), dilated splats
                                * as in 3DGS; 1, band-limited splats as in Mip-Splatting */
  int32_t reserved;            /* 0 */
} stgs_record_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_record_settings_defaults(stgs_record_settings* settings,
                                                   size_t struct_size);

/* Creates a recorder without a file. */
STGS_API stgs_result stgs_recorder_create(stgs_recorder** out);

/* Destroys a recorder.
 *
 * A recording that was not closed stays: it plays up to its last fragment, players wait for more,
 * and stgs_recorder_resume can continue it. */
STGS_API void stgs_recorder_destroy(stgs_recorder* recorder);

/* Returns the outcome of the last call on the recorder, other than calls of this function. */
STGS_API stgs_result stgs_recorder_error(const stgs_recorder* recorder, stgs_error* error);

/* Creates the file of a new recording. NULL settings: the defaults.
 *
 * Fails with STGS_ERROR_IO if the file exists. After an error no file is left and the call may be
 * retried. After success neither this function nor stgs_recorder_resume may be called again
 * (STGS_ERROR_STATE). */
STGS_API stgs_result stgs_recorder_begin(stgs_recorder* recorder, const char* path,
                                         const stgs_record_settings* settings);

/* Continues a recording that was not closed, after its last complete fragment; truncates anything
 * beyond that.
 *
 * Time base, SH degree and metadata come from the file; the profile in `settings` must match it.
 * After an error the file is unchanged and the call may be retried. STGS_ERROR_ARGUMENT: the file
 * is closed, not a recording, in use by another recorder, or of another profile.
 * STGS_ERROR_INVALID_FILE: it is empty, damaged or not an .stgs file. STGS_ERROR_UNSUPPORTED: it
 * has a later format or was laid out by another program. Otherwise like stgs_recorder_begin. */
STGS_API stgs_result stgs_recorder_resume(stgs_recorder* recorder, const char* path,
                                          const stgs_record_settings* settings);

/* Primitives to append at the end of a recording. The arrays belong to the caller and are read
 * during the call. */
typedef struct stgs_fragment {
  size_t struct_size;
  uint32_t frames;         /* by which the recording grows, at least 1 (default) */
  uint32_t visible_frames; /* frames for which the primitives may be visible, next to later
                            * fragments; 0 (default) or less than `frames`: to the end of the
                            * fragment */
  uint64_t count;          /* primitives, up to 2 * 10^8; default 0 with NULL arrays */
  const float* position;   /* 3 floats each: at `time`, or at the start; scene units */
  const float* velocity;   /* 3 floats each: scene units per second; NULL: static */
  const float* scale;      /* 3 floats each: standard deviations along the axes, > 0, scene units */
  const float* rotation; /* 4 floats each: orientation of the axes, non-zero quaternion w, x, y, z;
                          * NULL: the axes of the world */
  const float* opacity;  /* 1 float each: 0 to 1, stored as 0.001 to 0.999 */
  const float* sh;       /* 3 * (sh_degree + 1)^2 floats each, as in stgs_primitives */
  /* Lifespans: set all three arrays, or none (NULL) for primitives visible from start to end. A
   * primitive has its full opacity for `radius` before and after `time`; s seconds beyond that the
   * opacity is multiplied by exp(-(s / sigma)^2). Primitives that are never visible within the
   * fragment are dropped (stgs_recorder_status.dropped): their times may belong to an earlier
   * clock, or their opacity is below 1/255. */
  const float* time;       /* seconds from the start of the fragment */
  const float* sigma;      /* seconds, > 0 */
  const float* radius;     /* seconds, >= 0 */
  const float* importance; /* 1 float each, >= 0: the most important primitives are transferred
                            * first on a slow link; NULL: by size and opacity */
} stgs_fragment;

/* Fills a fragment with the defaults: one frame without primitives. `struct_size` is
 * sizeof(*fragment). */
STGS_API stgs_result stgs_fragment_defaults(stgs_fragment* fragment, size_t struct_size);

/* Encodes a fragment and appends it. Readers find it once the call has returned.
 *
 * STGS_ERROR_IO, for example a full disk, ends the recording: the file is cut after the previous
 * fragment, as far as the system permits, and released, so that another recorder can resume it.
 * This recorder then only returns its status (STGS_ERROR_STATE). After any other error nothing has
 * changed and the call may be repeated with the same or another fragment: STGS_ERROR_ARGUMENT,
 * _STRUCT_SIZE, _OUT_OF_MEMORY, _UNSUPPORTED (a primitive is too far away) and others. */
STGS_API stgs_result stgs_recorder_append(stgs_recorder* recorder, const stgs_fragment* fragment);

/* Marks the recording as finished. Nothing can be appended or resumed afterwards; players play it
 * to its end, and servers may cache it.
 *
 * STGS_ERROR_IO ends the recording as in stgs_recorder_append, with all its fragments. After any
 * other error nothing has changed. */
STGS_API stgs_result stgs_recorder_close(stgs_recorder* recorder);

/* Status of a recording. */
typedef struct stgs_recorder_status {
  size_t struct_size;
  uint64_t bytes;                 /* size of the file */
  uint32_t frames;                /* recorded, including those before a resume */
  uint32_t time_base_numerator;   /* a frame lasts numerator / denominator seconds */
  uint32_t time_base_denominator; /* see time_base_numerator */
  int32_t sh_degree;              /* of the file, 0 to 3 */
  uint64_t primitives;            /* in the file */
  uint64_t dropped;               /* since the recording was begun or resumed: never visible within
                                   * their fragments. A high number suggests that `time` is on
                                   * another clock */
} stgs_recorder_status;

/* Returns the status of the recording. STGS_ERROR_STATE: no recording was begun. */
STGS_API stgs_result stgs_recorder_get_status(stgs_recorder* recorder,
                                              stgs_recorder_status* status);

/** @} */

#ifdef __cplusplus
}
#endif

#endif
