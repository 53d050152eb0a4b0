/* SPDX-License-Identifier: Apache-2.0 */
/* How an open file stores its scene: form, parts, segments, streams, and its demands on a decoder.
 * C99; stgs.h includes it. For tools that inspect files; rendering does not need it.
 *
 * Every function fails with STGS_ERROR_STATE before the scene is open, and with STGS_ERROR_ARGUMENT
 * if an index is out of range. Only stgs_scene_get_statistics reads more of the file than its
 * index. The numbers of a recording that a player follows grow. */
#ifndef STGS_STGS_CONTENTS_H
#define STGS_STGS_CONTENTS_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @addtogroup api_scenes
 *  @{ */

/** @defgroup api_contents Contents of a file
 *
 *  Form, parts, segments and streams of a file, its demands on a decoder, and statistics of its
 *  primitives.
 *  @{ */

/* Order of a file. */
typedef int32_t stgs_form;
enum {
  STGS_FORM_FINISHED = 0, /* the index comes first */
  STGS_FORM_GROWING = 1,  /* a live recording, to which more may be appended */
  STGS_FORM_RECORDED = 2  /* a live recording that is closed */
};

/* Sizes and numbers of a file. A player of a long file reads the index as playback needs it: the
 * scene of a player lists the parts and segments that are known so far. */
typedef struct stgs_contents {
  size_t struct_size;
  stgs_form form;              /* order of the file */
  int32_t tiers;               /* groups of primitives by importance; 0: no primitives */
  uint64_t head_bytes;         /* read to open the file */
  uint64_t incomplete_bytes;   /* of a recording, after its last complete fragment */
  uint64_t missing_bytes;      /* at the end of a truncated file */
  double chunk_seconds;        /* length of the shortest segments */
  uint64_t capture_id;         /* equal for windows of one capture; 0: no window */
  uint64_t training_id;        /* equal for windows trained with the same settings; 0: no window */
  uint32_t parts;              /* number for stgs_scene_get_part */
  uint32_t segments;           /* number for stgs_scene_get_segment: tiers of segments */
  uint32_t streams;            /* number for stgs_scene_get_stream */
  uint32_t lost_fragments;     /* number for stgs_scene_get_lost_fragment */
  uint32_t damaged_segments;   /* number for stgs_scene_get_damaged_segment, found so far */
  int32_t is_window;           /* 1: the scene is a window of a longer capture */
  uint32_t window_first_frame; /* frame of the capture at time 0; 0: no window */
  uint32_t capture_frames;     /* length of that capture; 0: no window */
} stgs_contents;

/* Returns the sizes and numbers of the file. */
STGS_API stgs_result stgs_scene_get_contents(stgs_scene* scene, stgs_contents* contents);

/* A part: primitives that are rendered during a part of the clip only, such as those of a training
 * window. */
typedef struct stgs_part {
  size_t struct_size;
  double begin_seconds;       /* as trained; may be before the clip */
  double end_seconds;         /* as trained; may be after the clip */
  double shown_begin_seconds; /* as rendered */
  double shown_end_seconds;   /* as rendered */
  uint64_t primitives;        /* in the part */
} stgs_part;

/* Returns a part. `index` is 0 to stgs_contents.parts - 1. */
STGS_API stgs_result stgs_scene_get_part(stgs_scene* scene, uint32_t index, stgs_part* part);

/* A tier of a segment: primitives of similar importance that are rendered during one range of time.
 * Below, a segment of several tiers counts once for each. */
typedef struct stgs_segment {
  size_t struct_size;
  int32_t level;        /* -1: spans its part; otherwise 2^level times chunk_seconds long */
  int32_t tier;         /* 0: the most important primitives */
  double begin_seconds; /* start of the range */
  double end_seconds;   /* end of the range, included unless its part ends there */
  uint64_t offset;      /* of its primitives in the file */
  uint64_t bytes;       /* of its primitives in the file */
  uint64_t sh_offset;   /* of its SH above degree 0, if they are stored separately; else 0 */
  uint64_t sh_bytes;    /* as sh_offset */
  uint32_t primitives;  /* in the tier */
  uint32_t part;        /* index of its part */
  int32_t available;    /* 0: beyond the end of a truncated file */
  int32_t sh_available; /* 0: its SH are beyond the end of a truncated file */
} stgs_segment;

/* Returns a tier of a segment. `index` is 0 to stgs_contents.segments - 1. */
STGS_API stgs_result stgs_scene_get_segment(stgs_scene* scene, uint32_t index,
                                            stgs_segment* segment);

/* The bytes of one attribute, over all segments, and its error: in scene units (position, at its
 * own time), scene units per tick (velocity), ticks (time, sigma, radius), radians (rotation), as
 * natural logarithm (log_scale), as logit (opacity). */
typedef struct stgs_stream {
  size_t struct_size;
  const char* name;   /* such as "position"; belongs to the scene, valid until it is destroyed */
  uint64_t bytes;     /* in the file; 0: not stated, as in a recording */
  uint64_t raw_bytes; /* uncompressed */
  double max_error;   /* greatest difference to the source of the coding; -1: not stated */
  double rms_error;   /* root mean square of the same; -1: not stated */
} stgs_stream;

/* Returns a stream. `index` is 0 to stgs_contents.streams - 1. */
STGS_API stgs_result stgs_scene_get_stream(stgs_scene* scene, uint32_t index, stgs_stream* stream);

/* Content that the index does not list any more, because a part of it is damaged. */
typedef struct stgs_lost_fragment {
  size_t struct_size;
  double begin_seconds; /* start of the times at which it would be needed */
  double end_seconds;   /* end of these times */
  uint64_t offset;      /* of the lost bytes in the file */
  uint64_t bytes;       /* of a recording's fragment, or of the damaged part of the index alone */
} stgs_lost_fragment;

/* Returns a lost fragment. `index` is 0 to stgs_contents.lost_fragments - 1. */
STGS_API stgs_result stgs_scene_get_lost_fragment(stgs_scene* scene, uint32_t index,
                                                  stgs_lost_fragment* fragment);

/* A tier of a segment that rendering has skipped, at least in part. */
typedef struct stgs_damaged_segment {
  size_t struct_size;
  uint32_t segment;    /* index for stgs_scene_get_segment */
  int32_t sh_only;     /* 1: rendered without its SH above degree 0; 0: not rendered */
  const char* message; /* the reason; belongs to the scene, valid until it is destroyed */
} stgs_damaged_segment;

/* Returns a damaged tier of a segment, in the order in which they were found. `index` is 0 to
 * stgs_contents.damaged_segments - 1. */
STGS_API stgs_result stgs_scene_get_damaged_segment(stgs_scene* scene, uint32_t index,
                                                    stgs_damaged_segment* damaged);

/* Demands of playing a file at its own speed (spec/decoder-model.md). Peaks are over all times,
 * with all tiers and SH. */
typedef struct stgs_decoder_needs {
  size_t struct_size;
  int32_t level;                /* the lowest decoder level that suffices; 0: none does */
  int32_t reserved;             /* 0 */
  uint64_t primitives;          /* peak, of the segments needed at one time */
  uint64_t segments;            /* their number */
  uint64_t bytes;               /* of these segments in the file */
  uint64_t decoded_bytes;       /* of these segments in memory */
  uint64_t ranges;              /* contiguous ranges of the file that hold them */
  uint64_t index_bytes;         /* read first */
  uint64_t startup_bytes;       /* the index and the segments of the first second */
  double bits_per_second;       /* rate that delivers the other segments in time */
  double primitives_per_second; /* rate that decodes the other segments in time */
} stgs_decoder_needs;

/* Computes the demands from the index. */
STGS_API stgs_result stgs_scene_get_decoder_needs(stgs_scene* scene, stgs_decoder_needs* needs);

/* Primitives with a value in [from, to). */
typedef struct stgs_histogram_bin {
  size_t struct_size;
  double from;         /* inclusive */
  double to;           /* exclusive; may be INFINITY */
  uint64_t primitives; /* number of them */
} stgs_histogram_bin;

/* Lifespans and speeds of all primitives. If a file has several parts, "the clip" means the part
 * that contains the primitive. */
typedef struct stgs_scene_statistics {
  size_t struct_size;
  uint64_t primitives;    /* in the file */
  uint64_t never_visible; /* opacity below 1/255; not counted below */
  double scene_radius;    /* distance from the median position that holds 95 % of the primitives */
  const stgs_histogram_bin* lifespans; /* by the time at an opacity of at least 1/255, seconds,
                                        * without those that cover the clip. Belongs to the scene;
                                        * valid until the next call or its end */
  const stgs_histogram_bin* speeds;    /* scene units per second; as above */
  uint32_t lifespan_bins;              /* number of bins of lifespans */
  uint32_t speed_bins;                 /* number of bins of speeds */
  uint64_t whole_clip;                 /* primitives that cover every frame */
  double median_lifespan;              /* seconds */
  double median_speed;                 /* scene units per second */
  double static_bound;                 /* scene units over the clip: 0.001 of scene_radius */
  uint64_t static_primitives;          /* that cover the clip and move by at most static_bound */
  double static_share;                 /* of the visible primitives, 0 to 1 */
  double whole_clip_drift;             /* mean motion of those that cover the clip, scene units */
} stgs_scene_statistics;

/* Reads and decodes the complete file, apart from damaged segments, which the log lists, and
 * computes the statistics.
 *
 * STGS_ERROR_STATE: the scene belongs to a player. STGS_ERROR_UNSUPPORTED: the decoded primitives
 * exceed max_memory. Damage is an error only if no primitive can be read. */
STGS_API stgs_result stgs_scene_get_statistics(stgs_scene* scene,
                                               stgs_scene_statistics* statistics);

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

#endif
