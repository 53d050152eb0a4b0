/* SPDX-License-Identifier: Apache-2.0 */
/* Makes .stgs scenes: prepare, train, pack. C99. Needs libstgs_encoder, a library of its own.
 *
 *   stgs_encoder_create(NULL, &encoder);
 *   stgs_encoder_prepare(encoder, "capture", "prepared", NULL, NULL);
 *   stgs_encoder_train(encoder, "prepared", "trained.stgs", NULL, NULL);
 *   stgs_encoder_pack(encoder, "trained.stgs", "scene.stgs", NULL, &report);
 *   stgs_encoder_destroy(encoder);
 *
 * This header includes two others: stgs_encoder_live.h encodes a rig while it films;
 * stgs_encoder_recorder.h records primitives that an application produces.
 *
 * The general rules of stgs.h apply. A call returns when its work has completed, failed or been
 * cancelled. Outputs appear complete or not at all; until then existing files stay.
 *
 * Threads: one thread at a time may use an encoder, except for stgs_encoder_cancel. Several
 * encoders may work at once, with different outputs: STGS_ERROR_ARGUMENT if another run, in any
 * process, writes the same one.
 *
 * Ownership: settings and everything they point to are read during a call and not retained. A NULL
 * string stands for an empty one.
 *
 * Messages may name a setting like the program `stgs`: --max-primitives is max_primitives. */
#ifndef STGS_STGS_ENCODER_H
#define STGS_STGS_ENCODER_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_encoding Encoding
 *
 *  Makes scenes from captures. Needs libstgs_encoder.
 *  @{ */

/** @defgroup api_encoders Encoders
 *
 *  Creation, progress and cancellation.
 *  @{ */

/* Runs one encoding step at a time. */
typedef struct stgs_encoder stgs_encoder;

/* Progress of a call. Strings are valid until the callback returns. The library sets struct_size:
 * an older library omits the members beyond it. */
typedef struct stgs_encoder_progress {
  size_t struct_size;
  const char* stage;  /* current stage: "frames", "depth range", "train", "pack" or another */
  double done;        /* completed part of the stage, 0 to 1, never decreasing */
  double eta_seconds; /* time left in the stage; negative: not known */
  const char* detail; /* for display; may be empty */
  /* While training, otherwise 0: */
  uint64_t iteration;   /* views trained on so far */
  uint64_t iterations;  /* views to train on in total */
  uint64_t primitives;  /* in the model */
  double loss;          /* running mean */
  double held_out_psnr; /* from the last evaluation on the test cameras, dB; 0: none yet */
} stgs_encoder_progress;

/* Receives progress. Called on the thread of the call, during it, several times per second and at
 * the end of each stage.
 *
 * Returns 0 to continue. Any other value cancels the call as stgs_encoder_cancel does, without
 * further progress. Must not use the encoder except to cancel it. */
typedef int32_t (*stgs_encoder_progress_fn)(void* user, const stgs_encoder_progress* progress);

/* Threads and hooks of an encoder. */
typedef struct stgs_encoder_settings {
  size_t struct_size;
  uint32_t threads;                  /* limit, up to 1024; 0 (default): all cores.
                                      * While stgs_encoder_prepare runs, OpenCV is single-threaded
                                      * in the whole process */
  stgs_log_fn log;                   /* NULL (default): no log */
  void* log_user;                    /* first argument of `log` */
  stgs_encoder_progress_fn progress; /* NULL (default): no progress */
  void* progress_user;               /* first argument of `progress` */
} stgs_encoder_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_encoder_settings_defaults(stgs_encoder_settings* settings,
                                                    size_t struct_size);

/* Creates an encoder. NULL settings: the defaults. */
STGS_API stgs_result stgs_encoder_create(const stgs_encoder_settings* settings, stgs_encoder** out);

/* Destroys an encoder. No call on it may be running: cancel it and wait for it to return. */
STGS_API void stgs_encoder_destroy(stgs_encoder* encoder);

/* Returns the outcome of the last call on the encoder, other than calls of this function and of
 * stgs_encoder_cancel. */
STGS_API stgs_result stgs_encoder_error(const stgs_encoder* encoder, stgs_error* error);

/* Cancels the encoder permanently: the running call ends soon, and it and all later calls fail with
 * STGS_ERROR_CANCELLED.
 *
 * May be called on any thread and from signal handlers until stgs_encoder_destroy. NULL: does
 * nothing. */
STGS_API void stgs_encoder_cancel(stgs_encoder* encoder);

/** @} */

/** @defgroup api_preparing Preparing
 *
 *  From a capture folder to a prepared capture.
 *  @{ */

/* Layout of a capture folder. */
typedef int32_t stgs_layout;
enum {
  STGS_LAYOUT_AUTO = 0,       /* detect the layout */
  STGS_LAYOUT_N3DV = 1,       /* Neural 3D Video (DyNeRF) */
  STGS_LAYOUT_PANOPTIC = 2,   /* Panoptic Studio, as prepared for Dynamic 3D Gaussians */
  STGS_LAYOUT_EASYVOLCAP = 3, /* EasyVolcap */
  STGS_LAYOUT_COLMAP = 4,     /* a COLMAP model and images */
  STGS_LAYOUT_NERFSTUDIO = 5, /* Nerfstudio (transforms.json) */
  STGS_LAYOUT_VIDEOS = 6      /* one video per camera, optionally with a calibration */
};

/* Settings of stgs_encoder_prepare. */
typedef struct stgs_prepare_settings {
  size_t struct_size;
  stgs_layout layout;           /* default STGS_LAYOUT_AUTO */
  int32_t first_frame;          /* first frame of the source to use; default 0 */
  int32_t end_frame;            /* end of the range [first, end); default -1: to the last frame */
  double scale;                 /* of the images, 0.01 to 1; default 1 */
  int32_t default_test_cameras; /* 1 (default): hold out the test cameras of the layout; 0: hold
                                 * out exactly test_cameras */
  uint32_t test_camera_count;   /* may be 0 (default) */
  const char* const* test_cameras; /* names */
  double fps;                      /* of image folders, 0.001 to 100000; 0 (default): from the
                                    * layout, otherwise 30 */
  int32_t separate_motion;         /* 1 (default): separate static and dynamic points; 0: all points
                                    * are static */
  uint32_t max_dynamic_points;     /* per frame, up to 10^9; 0 (default): from the image size */
  uint32_t max_static_points;      /* up to 10^9; 0 (default): from the image size */
  uint64_t seed;                   /* of random choices; default 1 */
  int32_t overwrite;               /* 1: replace an existing prepared capture; default 0 */
  int32_t allow_outside;           /* 1: the capture is trusted: its paths and links may leave its
                                    * folder; default 0 */
  int32_t trust_calibration;       /* 1: only warn if a mistake in the calibration is found; 0
                                    * (default): STGS_ERROR_INVALID_FILE */
  stgs_backend backend;            /* of stereo, sweeps, motion and velocities, of decoding and
                                    * undistorting frames, as in stgs_train_settings. Videos that
                                    * the device cannot decode, and short ones, are decoded by the
                                    * CPU: --video-decoder auto of the program */
} stgs_prepare_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_prepare_settings_defaults(stgs_prepare_settings* settings,
                                                    size_t struct_size);

/* Result of stgs_encoder_prepare. */
typedef struct stgs_prepare_report {
  size_t struct_size;
  uint32_t cameras;         /* including test cameras */
  uint32_t test_cameras;    /* held out of training */
  uint32_t frames;          /* of each camera */
  double frames_per_second; /* of the capture */
} stgs_prepare_report;

/* Converts a capture folder into a prepared capture: undistorted images, cameras and initial
 * points.
 *
 * The folder `prepared` must not exist, be empty or, with `overwrite`, hold a prepared capture.
 * NULL settings: the defaults. NULL report: not returned. Runs the program colmap to calibrate
 * captures without a calibration, which fail if it is not installed.
 * STGS_ERROR_NOT_BUILT: the build lacks OpenCV or FFmpeg; it can train and pack captures prepared
 * elsewhere. */
STGS_API stgs_result stgs_encoder_prepare(stgs_encoder* encoder, const char* capture,
                                          const char* prepared,
                                          const stgs_prepare_settings* settings,
                                          stgs_prepare_report* report);

/** @} */

/** @defgroup api_training Training
 *
 *  From a prepared capture to a lossless scene.
 *  @{ */

/* Trade-off between quality and training time. */
typedef int32_t stgs_preset;
enum {
  STGS_PRESET_DEFAULT = 0, /* balanced */
  STGS_PRESET_FAST = 1,    /* for previews */
  STGS_PRESET_BEST = 2     /* highest quality */
};

/* A hyperparameter. */
typedef struct stgs_parameter {
  const char* name;  /* as listed by `stgs train --list-parameters` */
  const char* value; /* a number */
} stgs_parameter;

/* Settings of stgs_encoder_train. */
typedef struct stgs_train_settings {
  size_t struct_size;
  stgs_preset preset;      /* default STGS_PRESET_DEFAULT */
  stgs_backend backend;    /* CPU, CUDA or AUTO (default): CUDA if it is built and a device is
                            * available, otherwise the CPU */
  uint32_t iterations;     /* views to train on, up to 10^8; 0 (default): from the preset */
  uint32_t max_primitives; /* up to 2 * 10^8; 0 (default): from the preset */
  double max_seconds;     /* fits the schedule to this duration, 1 to 10^8; 0 (default): no limit */
  uint64_t seed;          /* of random choices; default 1 */
  const char* checkpoint; /* file to write periodically, when cancelled and at the end; NULL
                           * (default): none. A failed write is an error of a cancelled run,
                           * otherwise a warning */
  uint32_t checkpoint_interval; /* iterations, 1 to 10^8; default 500 */
  const char* resume;           /* checkpoint to resume; may equal `checkpoint`; NULL (default):
                                 * none */
  const char* log_path; /* JSON Lines file for steps and evaluations; NULL (default): none */
  uint32_t held_out_evaluations;    /* evaluations on the test cameras, up to 10^6; default 5 */
  uint64_t frame_memory;            /* for decoded images, bytes; 0 (default): a share of the free
                                     * memory */
  const char* perceptual_weights;   /* safetensors file with the weights of SqueezeNet 1.1,
                                     * VGG16 or AlexNet, enables the perceptual loss; NULL
                                     * (default): disabled */
  const stgs_parameter* parameters; /* overrides of hyperparameters */
  uint32_t parameter_count;         /* default 0 */
  double quality;     /* that the scene is trained for, 0.1 to 100; 0 (default): from the preset */
  double target_kbps; /* trains for a packed file of at most this mean bit rate, kbit/s, 0.001 to
                       * 10^9; 0 (default): no limit */
  double target_size; /* or of at most this many bytes, 1 to 10^15; 0 (default): no limit */
  double target_psnr; /* or removes primitives as long as the training images keep this PSNR, after
                       * the best affine colour map of each, 1 to 100 dB; 0 (default): no target */
  int32_t allow_outside;  /* 1: links in the prepared capture may lead out of it; default 0 */
  int32_t refine_cameras; /* 1: refines poses, focal lengths, distortion and vignetting of the
                           * training cameras (at least three) with the scene, and logs a warning
                           * for each that was wrong by more than a pixel, or whose corners are more
                           * than 10 % darker or brighter than most; default 0 */
  int32_t foreground;     /* 1: trains only the content inside the masks of the capture, with its
                           * alpha; default 0 */
  int32_t refine_timing;  /* 1: refines the time offsets of the training cameras (at least two) with
                           * the scene, by at most one frame, and logs a warning for each whose
                           * images are taken more than 0.25 frames earlier or later than stated;
                           * default 0 */
} stgs_train_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_train_settings_defaults(stgs_train_settings* settings,
                                                  size_t struct_size);

/* Result of stgs_encoder_train. */
typedef struct stgs_train_report {
  size_t struct_size;
  stgs_backend backend;     /* in use, never STGS_BACKEND_AUTO */
  uint64_t iterations;      /* views trained on */
  uint64_t primitives;      /* in the scene */
  uint64_t bytes;           /* size of the scene file */
  double seconds;           /* training time, including the runs that were resumed */
  double loss;              /* running mean at the end */
  double held_out_psnr;     /* from the last evaluation, dB; 0: none */
  uint32_t held_out_images; /* averaged by held_out_psnr */
} stgs_train_report;

/* Trains a scene from a prepared capture and writes it, lossless, to the file `scene`.
 *
 * NULL settings: the defaults. NULL report: not returned. A cancelled run writes no scene, but a
 * checkpoint if one was requested and training had started. Resuming gives bit-identical results to
 * an uninterrupted run on the same kind of CPU or GPU, unless max_seconds is set.
 * STGS_ERROR_NOT_BUILT: the build lacks the backend; STGS_ERROR_UNSUPPORTED: no device is available
 * for it. */
STGS_API stgs_result stgs_encoder_train(stgs_encoder* encoder, const char* prepared,
                                        const char* scene, const stgs_train_settings* settings,
                                        stgs_train_report* report);

/* Checks settings, backend, weights and checkpoint without a capture, for example before a long
 * stgs_encoder_prepare. Fails as stgs_encoder_train would. */
STGS_API stgs_result stgs_encoder_check_training(stgs_encoder* encoder,
                                                 const stgs_train_settings* settings);

/** @} */

/** @defgroup api_packing Packing
 *
 *  From lossless scenes to a compressed one.
 *  @{ */

/* Coding of a packed file. */
typedef int32_t stgs_profile;
enum {
  STGS_PROFILE_QUANTISED = 0,    /* quantised attributes, entropy coded */
  STGS_PROFILE_DRACO = 1,        /* positions coded by Draco (otherwise STGS_ERROR_NOT_BUILT) */
  STGS_PROFILE_NEAR_LOSSLESS = 2 /* quantised so finely that renders do not reveal it, for archives;
                                  * not with quality, target_kbps, target_size or target_psnr, nor
                                  * for recordings */
};

/* Settings of stgs_encoder_pack. */
typedef struct stgs_pack_settings {
  size_t struct_size;
  stgs_profile profile; /* default STGS_PROFILE_QUANTISED */
  int32_t tiers;        /* parts of the scene by importance, 1 to 16, of similar size; 0 (default):
                         * three, or progressively larger ones where many primitives are active */
  double quality;       /* 0.1 to 100; 0 (default): the steps that the scene was trained for, or
                         * else 87; ignored with target_kbps and target_size */
  double target_kbps;   /* upper bound of the mean bit rate, kbit/s, 0.001 to 10^9; 0 (default):
                         * none */
  double max_error;     /* upper bound of position errors, thousandths of a scene unit, 10^-6 to
                         * 10^9; 0 (default): from quality */
  double chunk_seconds; /* shortest segment, 0.01 to 3600; 0 (default): from the lifespans */
  const char* against;  /* prepared capture on whose test cameras the loss is measured; NULL
                         * (default): none */
  double metres_per_unit; /* 10^-9 to 10^9; 0 (default): unchanged */
  float up[3];            /* opposite to gravity, any length; 0, 0, 0 (default): unchanged */
  int32_t has_floor;      /* 1: set `floor`, which requires a known up; default 0 */
  float floor[3];         /* a point on the floor, scene units */
  const char* audio;      /* URI reference of the audio, relative to the location of the file; NULL
                           * (default): unchanged */
  double audio_begin;     /* start of the audio, seconds, -10^6 to 10^6; default 0 */
  double target_size;     /* upper bound of the file, bytes, 1 to 10^15; 0 (default): none; not with
                           * target_kbps */
  double target_psnr; /* the smallest file whose renders have this PSNR against those of the scene,
                       * 1 to 100 dB; 0 (default): no target; not with a limit */
  int32_t allow_outside; /* 1: links in `against` may lead out of it; default 0 */
  int32_t foreground;    /* 1: the loss is that of the content inside the masks of `against`, for a
                          * scene of stgs_train_settings.foreground; default 0 */
} stgs_pack_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_pack_settings_defaults(stgs_pack_settings* settings, size_t struct_size);

/* Result of stgs_encoder_pack. Errors are measured by decoding the output. */
typedef struct stgs_pack_report {
  size_t struct_size;
  uint64_t primitives;          /* written */
  uint64_t dropped;             /* omitted: never visible within the clip */
  uint64_t damaged_segments;    /* tiers of segments, omitted: unreadable in damaged inputs */
  uint64_t damaged_sh_segments; /* tiers of segments, written without SH: these are unreadable */
  uint64_t bytes_in;            /* size of the inputs */
  uint64_t bytes_out;           /* size of the output */
  double quality;               /* quality used; 0: near-lossless */
  double kbps;                  /* mean bit rate, kbit/s */
  double position_max;          /* largest position error, scene units, at its worst time */
  double position_rms;          /* root mean square of the same */
  double colour_rms;            /* error of the degree-0 colour, sRGB-encoded, 0 to 1 */
  double opacity_max;           /* largest opacity error, 0 to 1 */
  double visibility_max;        /* largest error of opacity times lifespan at a frame, 0 to 1 */
  /* Largest errors of the lifespans, for primitives that are not visible throughout: */
  double time_max;        /* centre, frames */
  double radius_max;      /* half-width of the flat top, frames */
  double sigma_max;       /* fade width, natural logarithm */
  double images_psnr;     /* images of the output against those of the scene, dB; 0: not measured */
  double held_out_before; /* PSNR of the scene on the test cameras of `against`, dB; 0: none */
  double held_out_after;  /* PSNR of the output on the same cameras, dB; 0: none */
} stgs_pack_report;

/* Packs a scene into the file `output`, then decodes it to measure the loss.
 *
 * `output` must differ from `scene`. NULL settings: the defaults. NULL report: not returned.
 * STGS_ERROR_ARGUMENT: no file is within the limit; STGS_ERROR_UNSUPPORTED: positions cannot be
 * coded within max_error. */
STGS_API stgs_result stgs_encoder_pack(stgs_encoder* encoder, const char* scene, const char* output,
                                       const stgs_pack_settings* settings,
                                       stgs_pack_report* report);

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

/* The rest of the library, which needs the declarations above. */
#include "stgs/stgs_encoder_live.h"
#include "stgs/stgs_encoder_recorder.h"

#endif
