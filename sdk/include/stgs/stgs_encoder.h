/* SPDX-License-Identifier: Apache-2.0 */
/* Making .stgs scenes: prepare, train, pack; and recording them live. C99, of a library of its own,
 * libstgs_encoder.
 *
 *   stgs_encoder_create(NULL, &encoder);
 *   stgs_encoder_prepare(encoder, "capture", "prepared", NULL, NULL);
 *   stgs_encoder_train(encoder, "prepared", "trained.stgs", NULL, NULL);
 *   stgs_encoder_pack(encoder, &trained, 1, "scene.stgs", NULL, &report);
 *   stgs_encoder_destroy(encoder);
 *
 * Sizes, results, out parameters and conventions are those of stgs.h. Paths are UTF-8. A call
 * returns when its work is done, has failed or was stopped; outputs appear whole or not at all, and
 * what was there before stays until they do.
 *
 * Threads: an encoder is used by one thread at a time, but for stgs_encoder_cancel. Encoders are
 * independent: several may work at once, into places of their own.
 *
 * Ownership: settings, and what they point to, are read during a call and not kept. Their text is
 * the caller's; NULL stands for none.
 *
 * Messages may name a setting as the program `stgs` does: --max-primitives is max_primitives. */
#ifndef STGS_STGS_ENCODER_H
#define STGS_STGS_ENCODER_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- Encoders --- */

typedef struct stgs_encoder stgs_encoder;

/* Where a call is. Texts last until the callback returns. struct_size is the library's: an older
 * one than the header has no members beyond it. */
typedef struct stgs_encoder_progress {
  size_t struct_size;
  const char* stage;   /* what is done now: "frames", "depth range", "train", "pack" and others */
  double done;         /* of the stage, 0 to 1, never less than before */
  double eta_seconds;  /* to the end of the stage; negative: not known */
  const char* detail;  /* for a person; may be empty */
  uint64_t iteration;  /* views that training has learnt from; this and what follows: 0 in others */
  uint64_t iterations; /* of so many */
  uint64_t primitives;
  double loss;          /* running mean */
  double held_out_psnr; /* of the last measure, dB; 0: none yet */
} stgs_encoder_progress;

/* Called by the thread of a call during it, some times a second and at the end of a stage. 0: go
 * on; else the call stops, as by stgs_encoder_cancel, and does not ask again. Must not call
 * functions with the same encoder but stgs_encoder_cancel. */
typedef int32_t (*stgs_encoder_progress_fn)(void* user, const stgs_encoder_progress* progress);

typedef struct stgs_encoder_settings {
  size_t struct_size;
  /* 0 (default): all cores; else as many at most, up to 1024. While stgs_encoder_prepare runs, TBB
   * is held to it in the whole process, since OpenCV takes its threads from there. */
  uint32_t threads;
  stgs_log_fn log; /* NULL (default): silent */
  void* log_user;
  stgs_encoder_progress_fn progress; /* NULL (default): not told */
  void* progress_user;
} stgs_encoder_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_encoder_settings_defaults(stgs_encoder_settings* settings,
                                                    size_t struct_size);
/* `settings` may be NULL: the defaults; they are copied. *out is NULL after an error, else the
 * caller's. */
STGS_API stgs_result stgs_encoder_create(const stgs_encoder_settings* settings, stgs_encoder** out);
/* Not while another thread uses it: cancel, and wait for the call, before. */
STGS_API void stgs_encoder_destroy(stgs_encoder* encoder);
/* Of the last call on the encoder but this one and stgs_encoder_cancel. error->struct_size is set
 * by the caller. */
STGS_API stgs_result stgs_encoder_error(const stgs_encoder* encoder, stgs_error* error);
/* Stops the encoder for good: the call under way, soon, and all later ones end with
 * STGS_ERROR_CANCELLED. Any thread or signal handler, at any time until stgs_encoder_destroy;
 * NULL: nothing happens. */
STGS_API void stgs_encoder_cancel(stgs_encoder* encoder);

/* --- Preparing --- */

typedef int32_t stgs_layout;
enum {
  STGS_LAYOUT_AUTO = 0, /* what the folder looks like */
  STGS_LAYOUT_N3DV = 1,
  STGS_LAYOUT_PANOPTIC = 2,
  STGS_LAYOUT_EASYVOLCAP = 3,
  STGS_LAYOUT_COLMAP = 4,
  STGS_LAYOUT_NERFSTUDIO = 5,
  STGS_LAYOUT_VIDEOS = 6 /* a video a camera, and maybe cameras.json */
};

typedef struct stgs_prepare_settings {
  size_t struct_size;
  stgs_layout layout;              /* default STGS_LAYOUT_AUTO */
  int32_t first_frame, end_frame;  /* [first, end) of the source; default 0, -1: to the end */
  double scale;                    /* of the pictures, 0.01 to 1 (default) */
  int32_t default_test_cameras;    /* 1 (default): hold out what the layout says */
  uint32_t test_camera_count;      /* else exactly these, which may be none */
  const char* const* test_cameras; /* names */
  double fps;                      /* of folders of pictures, 0.001 to 100000; 0 (default): what
                                    * the layout says, else 30 */
  int32_t separate_motion;         /* 1 (default); 0: all points are still */
  uint32_t max_dynamic_points;     /* a frame, up to 10^9; 0 (default): by the pictures' size */
  uint32_t max_static_points;      /* up to 10^9; 0 (default): by the pictures' size */
  uint64_t seed;                   /* default 1 */
  int32_t overwrite;               /* 1: replace a prepared capture that is there; default 0 */
} stgs_prepare_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_prepare_settings_defaults(stgs_prepare_settings* settings,
                                                    size_t struct_size);

typedef struct stgs_prepare_report {
  size_t struct_size;
  uint32_t cameras;
  uint32_t test_cameras; /* of them, held out */
  uint32_t frames;
  double frames_per_second;
} stgs_prepare_report;

/* From the folder `capture`, in a layout that people already have, to the folder `prepared`, which
 * must not exist, be empty or, with `overwrite`, hold a prepared capture. `settings` may be NULL:
 * the defaults. `report` may be NULL; its struct_size is set by the caller. STGS_ERROR_NOT_BUILT in
 * a build without OpenCV: such a one trains and packs what another has prepared. Runs the program
 * colmap where it is installed: to calibrate, which else fails, and for better points. */
STGS_API stgs_result stgs_encoder_prepare(stgs_encoder* encoder, const char* capture,
                                          const char* prepared,
                                          const stgs_prepare_settings* settings,
                                          stgs_prepare_report* report);

/* --- Training --- */

typedef int32_t stgs_preset;
enum { STGS_PRESET_DEFAULT = 0, STGS_PRESET_FAST = 1, STGS_PRESET_BEST = 2 };

/* A hyper-parameter, as `stgs train --list-parameters` names them. */
typedef struct stgs_parameter {
  const char* name;
  const char* value; /* a number */
} stgs_parameter;

typedef struct stgs_train_settings {
  size_t struct_size;
  stgs_preset preset;   /* default STGS_PRESET_DEFAULT */
  stgs_backend backend; /* CPU, CUDA, or AUTO (default): CUDA where it is built and has a device */
  uint32_t iterations;  /* views to learn from, up to 10^8; 0 (default): the preset's */
  uint32_t max_primitives; /* up to 2 * 10^8; 0 (default): the preset's */
  double max_seconds;      /* 1 to 10^8: the schedule fits itself to it; 0 (default): no limit */
  uint64_t seed;           /* default 1 */
  int32_t first_frame;     /* [first, end) of the prepared capture, a window of it that */
  int32_t end_frame;       /* stgs_encoder_pack joins with others; default 0, -1: all of it */
  /* File to write now and then, when stopped, and at the end. Where it cannot be written, that is
   * an error of a run that is stopped, else a warning. */
  const char* checkpoint;
  uint32_t checkpoint_interval;  /* iterations, 1 to 10^8; default 500 */
  const char* resume;            /* checkpoint to go on from; may be `checkpoint` */
  const char* log_path;          /* file of JSON lines: steps and measures */
  uint32_t held_out_evaluations; /* of the test cameras in a run, up to 10^6; default 5 */
  uint64_t frame_memory; /* bytes of decoded pictures; 0 (default): a share of what is free */
  const char* perceptual_weights; /* safetensors file with VGG16's, for the perceptual loss */
  const stgs_parameter* parameters;
  uint32_t parameter_count; /* default 0 */
} stgs_train_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_train_settings_defaults(stgs_train_settings* settings,
                                                  size_t struct_size);

typedef struct stgs_train_report {
  size_t struct_size;
  stgs_backend backend; /* that trained */
  uint64_t iterations;
  uint64_t primitives;
  uint64_t bytes;           /* of the scene's file */
  double seconds;           /* of training, with those of the runs that it went on from */
  double loss;              /* running mean at the end */
  double held_out_psnr;     /* the last measure, dB; 0: none */
  uint32_t held_out_images; /* that it is the mean of */
} stgs_train_report;

/* Trains a scene from the prepared capture in the folder `prepared` and writes it, lossless, to the
 * file `scene`. `settings` may be NULL: the defaults. `report` may be NULL; its struct_size is set
 * by the caller. When stopped it writes the checkpoint, where one was asked for and training had
 * begun, and no scene; a run that resumes it gives the bits of one that was not stopped, on the
 * same kind of processor or GPU and without max_seconds. STGS_ERROR_NOT_BUILT: a backend that the
 * build leaves out; STGS_ERROR_UNSUPPORTED: no device for it. */
STGS_API stgs_result stgs_encoder_train(stgs_encoder* encoder, const char* prepared,
                                        const char* scene, const stgs_train_settings* settings,
                                        stgs_train_report* report);
/* Refuses what stgs_encoder_train would, as far as it is known before a capture is: settings,
 * backend, weights and checkpoint. For before a long prepare. */
STGS_API stgs_result stgs_encoder_check_training(stgs_encoder* encoder,
                                                 const stgs_train_settings* settings);

/* --- Packing --- */

typedef int32_t stgs_profile;
enum {
  STGS_PROFILE_QUANTISED = 0,
  STGS_PROFILE_DRACO = 1 /* positions by Draco, where it is built (STGS_ERROR_NOT_BUILT) */
};

typedef struct stgs_pack_settings {
  size_t struct_size;
  stgs_profile profile; /* default STGS_PROFILE_QUANTISED */
  int32_t tiers;        /* parts of the scene by importance, of like size, 1 to 16; 0 (default):
                         * three, or a small one and ever larger ones where a moment has many */
  double quality;       /* 0 to 100; default 87; not looked at where there is a target_kbps */
  double target_kbps; /* mean bit rate not to be passed, kbit/s, 0.001 to 10^9; 0 (default): none */
  double max_error;   /* how far a primitive may come to lie from where it was, thousandths of a
                       * scene unit, 10^-6 to 10^9; 0 (default): as quality has it */
  double chunk_seconds; /* shortest segment, 0.01 to 3600; 0 (default): by the lifespans */
  const char* against;  /* prepared capture: the loss is measured on its test cameras too */
  /* What the file is to say, where the scene does not or says it otherwise. */
  double metres_per_unit; /* 10^-9 to 10^9; 0 (default): as the scene says */
  float up[3];            /* against gravity, of any length; 0, 0, 0 (default): as the scene says */
  int32_t has_floor;      /* 1: `floor` counts, where up is known; default 0 */
  float floor[3];         /* a point of the floor, scene units */
  const char* audio;      /* URI reference of the sound, relative to the file's place */
  double audio_begin;     /* seconds, -10^6 to 10^6; default 0 */
} stgs_pack_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_pack_settings_defaults(stgs_pack_settings* settings, size_t struct_size);

/* What was written, and what it lost: measured by decoding it. */
typedef struct stgs_pack_report {
  size_t struct_size;
  uint64_t primitives;       /* written */
  uint64_t dropped;          /* never seen within the clip, and left out */
  uint64_t damaged_segments; /* of damaged inputs, left out */
  uint64_t
      damaged_sh_segments; /* segments of damaged inputs that lost their view-dependent colour */
  uint64_t bytes_in, bytes_out;
  double quality;      /* that it was packed with */
  double kbps;         /* mean bit rate, kbit/s */
  double position_max; /* scene units, at the moment where it is greatest */
  double position_rms;
  double colour_rms;     /* of the degree-0 colour, sRGB-encoded, 0 to 1 */
  double opacity_max;    /* 0 to 1 */
  double visibility_max; /* of opacity and lifespan together at a frame, 0 to 1 */
  double time_max;    /* of lifespans' centres, frames; of what is not always seen, as the next */
  double radius_max;  /* of their flat tops, frames */
  double sigma_max;   /* of their widths, natural logarithm */
  double images_psnr; /* of its pictures against the scene's, dB; 0: not measured */
  double held_out_before; /* PSNR of the scene on the test cameras of `against`, dB; 0: none */
  double held_out_after;  /* of what was written */
} stgs_pack_report;

/* Packs one scene, or the windows of one capture in any order, into the file `output`, which must
 * be none of them, and decodes it to tell what it lost. `settings` may be NULL: the defaults.
 * `report` may be NULL; its struct_size is set by the caller. STGS_ERROR_ARGUMENT: nothing is small
 * enough for target_kbps; STGS_ERROR_UNSUPPORTED: positions cannot keep max_error. */
STGS_API stgs_result stgs_encoder_pack(stgs_encoder* encoder, const char* const* scenes,
                                       uint32_t count, const char* output,
                                       const stgs_pack_settings* settings,
                                       stgs_pack_report* report);

/* --- Recording --- */

/* Appends stretches of primitives, as a live capture makes them, to a file that players follow
 * while it grows (stgs_player_get_live); where a web server serves it, from anywhere. One recorder
 * makes one file.
 *
 *   stgs_recorder_create(&recorder);
 *   stgs_recorder_begin(recorder, "live.stgs", NULL);
 *   stgs_recorder_append(recorder, &stretch);  and again, every half second
 *   stgs_recorder_close(recorder);
 *   stgs_recorder_destroy(recorder);
 *
 * Threads: a recorder is used by one thread at a time; recorders are independent. */
typedef struct stgs_recorder stgs_recorder;

typedef struct stgs_record_settings {
  size_t struct_size;
  uint32_t time_base_numerator; /* a frame is numerator / denominator seconds; default 1 / 30 */
  uint32_t time_base_denominator;
  int32_t sh_degree;    /* of all stretches, 0 (default) to 3 */
  stgs_profile profile; /* default STGS_PROFILE_QUANTISED */
  int32_t tiers;        /* as of stgs_pack_settings; default 0 */
  double quality;       /* 0 to 100; default 87 */
  double max_error; /* thousandths of a scene unit, 10^-6 to 10^9; 0 (default): as quality has it */
  double chunk_seconds; /* shortest segment, 0.01 to 3600; 0 (default): by the first stretch */
  /* 1 (default): what was appended survives a power cut. 0: it survives the end of the process, and
   * nobody waits for the disk. */
  int32_t sync;
  uint32_t threads; /* 0 (default): all cores; else as many at most, up to 1024 */
  /* What the file says of its scene. */
  const char* title;           /* up to 4096 bytes; NULL (default): none */
  double metres_per_unit;      /* 10^-9 to 10^9; 0 (default): not known */
  float up[3];                 /* against gravity, of any length, components up to 10^9; 0, 0, 0
                                * (default): not known */
  float floor[3];              /* a point of the floor, scene units, up to 10^9 from the origin
                                * along each axis; counts where up is known */
  const stgs_view* start_view; /* what stgs_scene_start_view is to give, but for its fovea, which a
                                * file has no place for; NULL (default): no camera, and near plane
                                * and background of stgs_view_defaults */
  const char* audio;           /* URI reference of the sound, relative to the file's place; up to
                                * 4096 bytes */
  double audio_begin;          /* seconds, -10^6 to 10^6; default 0 */
} stgs_record_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_record_settings_defaults(stgs_record_settings* settings,
                                                   size_t struct_size);

/* *out is NULL after an error, else the caller's. */
STGS_API stgs_result stgs_recorder_create(stgs_recorder** out);
/* A recording that was not closed stays: it plays up to its last stretch, players wait for more,
 * and stgs_recorder_resume goes on with it. */
STGS_API void stgs_recorder_destroy(stgs_recorder* recorder);
/* Of the last call on the recorder but this one. error->struct_size is set by the caller. */
STGS_API stgs_result stgs_recorder_error(const stgs_recorder* recorder, stgs_error* error);

/* Makes the file, which must not exist (STGS_ERROR_IO). `settings` may be NULL: the defaults. After
 * an error there is no file, and it may be tried again; after success neither this nor
 * stgs_recorder_resume (STGS_ERROR_STATE). */
STGS_API stgs_result stgs_recorder_begin(stgs_recorder* recorder, const char* path,
                                         const stgs_record_settings* settings);
/* Goes on with a recording that was not closed, after its last whole stretch; what is behind that
 * is cut off. Time base, degree, and what the file says of its scene are the file's; the profile
 * must be. STGS_ERROR_ARGUMENT: the file is closed or none that grows, another recorder has it, or
 * it has another profile; STGS_ERROR_INVALID_FILE: it is empty, damaged or another kind of file;
 * STGS_ERROR_UNSUPPORTED: of a later format, or laid out by another program. After an error the
 * file is as it was, and it may be tried again. Else as stgs_recorder_begin. */
STGS_API stgs_result stgs_recorder_resume(stgs_recorder* recorder, const char* path,
                                          const stgs_record_settings* settings);

/* What is seen from the end of what is recorded on. Arrays of the caller's, read during the call.
 */
typedef struct stgs_fragment {
  size_t struct_size;
  uint32_t frames;         /* that the recording grows by, at least 1 (default) */
  uint32_t visible_frames; /* up to which the primitives may be seen, beside later stretches; 0
                            * (default), or less than `frames`: to the end of the stretch */
  uint64_t count;          /* primitives, up to 2 * 10^8; default 0, and the arrays NULL */
  const float* position;   /* 3 each: at the moment `time`, or the beginning; scene units */
  const float* velocity;   /* 3 each: scene units a second; NULL: all stand still */
  const float* scale;      /* 3 each: standard deviations along its axes, > 0, scene units */
  const float* rotation;   /* 4 each: of its axes, quaternion w, x, y, z of any length but 0; NULL:
                            * those of the world */
  const float* opacity;    /* 1 each: 0 to 1, where 0.001 and 0.999 are the least and the most */
  const float* sh;         /* 3 (sh_degree + 1)^2 each, as of stgs_primitives */
  /* When each is seen, seconds from the beginning of the stretch; three arrays, or NULL: from its
   * beginning to its end. It is seen in full `radius` before and after `time`; s seconds beyond
   * that by exp(-(s / sigma)^2). What is never seen so within the stretch is left out, and counted
   * by stgs_recorder_status.dropped: of a clock that began earlier, say, or with an opacity below
   * 1 / 255. */
  const float* time;
  const float* sigma;      /* > 0 */
  const float* radius;     /* >= 0 */
  const float* importance; /* 1 each, >= 0: what is sent first, when a link is slow; NULL: by size
                            * and opacity */
} stgs_fragment;

/* No primitives. `struct_size` is sizeof(*stretch). */
STGS_API stgs_result stgs_fragment_defaults(stgs_fragment* stretch, size_t struct_size);
/* Encodes and appends. Once it has returned, readers find the stretch. STGS_ERROR_IO, as where the
 * disk is full, ends the recording: the file is cut to the stretch before, as far as the system
 * lets it, and released, so that stgs_recorder_resume of another recorder may go on with it; this
 * one has its status alone to give (STGS_ERROR_STATE). After any other error nothing has changed,
 * and the same or another stretch may follow: STGS_ERROR_ARGUMENT, _STRUCT_SIZE, _OUT_OF_MEMORY,
 * _UNSUPPORTED, as where a primitive lies too far out, and others. */
STGS_API stgs_result stgs_recorder_append(stgs_recorder* recorder, const stgs_fragment* stretch);
/* Says in the file that no more will come, after which there is nothing to append or resume.
 * Players play it to its end, and servers and caches may keep it. After STGS_ERROR_IO the recording
 * has ended as after that of stgs_recorder_append, with all its stretches; after any other error
 * nothing has changed. */
STGS_API stgs_result stgs_recorder_close(stgs_recorder* recorder);

typedef struct stgs_recorder_status {
  size_t struct_size;
  uint64_t bytes;               /* of the file */
  uint32_t frames;              /* appended, with those before it was resumed */
  uint32_t time_base_numerator; /* of the file */
  uint32_t time_base_denominator;
  int32_t sh_degree;
  uint64_t primitives; /* in the file */
  uint64_t dropped;    /* never seen within their stretches, and left out, since it was begun or
                        * resumed; many: times may be of another clock than the stretch's */
} stgs_recorder_status;

/* status->struct_size is set by the caller. STGS_ERROR_STATE: no recording was begun. */
STGS_API stgs_result stgs_recorder_get_status(stgs_recorder* recorder,
                                              stgs_recorder_status* status);

#ifdef __cplusplus
}
#endif

#endif
