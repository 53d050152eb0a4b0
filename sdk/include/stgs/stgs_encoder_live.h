/* SPDX-License-Identifier: Apache-2.0 */
/* Encodes a rig while it films. C99; stgs_encoder.h includes it.
 *
 *   stgs_live_create(&live);
 *   settings.cameras = cameras;                        the calibration of the rig
 *   stgs_live_start(live, "live.stgs", &settings);
 *   stgs_live_push(live, "left", seconds, &image);     each image of each camera, as it arrives
 *   stgs_live_finish(live, NULL);
 *   stgs_live_destroy(live);
 *
 * A session encodes the images of calibrated, synchronised cameras into a recording that players
 * follow while it grows (stgs_player_get_live), through a web server too. It trains on threads of
 * its own, in windows of about half a second, and chooses the work per window so that it keeps up,
 * and the size of its images: full, half, or a quarter. If the machine is still too slow, images
 * are dropped and counted. The program `stgs live` does the same
 * with cameras that it reads itself.
 *
 * Threads: each camera may have its own thread, which pushes its images and ends it. Any thread may
 * call stgs_live_error, stgs_live_get_report and stgs_live_cancel. One thread at a time may make
 * the other calls. Once stgs_live_start has returned, images can be pushed and reports read;
 * stgs_live_finish may run while other threads still push. */
#ifndef STGS_STGS_ENCODER_LIVE_H
#define STGS_STGS_ENCODER_LIVE_H

#include "stgs/stgs_encoder.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_live_encoding Live encoding
 *  @ingroup api_encoding
 *
 *  Encodes the cameras of a rig while they film. Needs libstgs_encoder.
 *  @{ */

/* A session: encodes one recording. */
typedef struct stgs_live stgs_live;

/* Lens distortion, as OpenCV models it. */
typedef int32_t stgs_lens;
enum {
  STGS_LENS_OPENCV = 0, /* radial and tangential; a pinhole camera if all coefficients are 0 */
  STGS_LENS_FISHEYE = 1 /* equidistant, as in cv::fisheye */
};

/* Calibration of a camera, which does not move: p_camera = rotation * p_world + translation. */
typedef struct stgs_live_camera {
  size_t struct_size;
  const char* name;      /* identifies the camera in stgs_live_push; unique, without '/' */
  uint32_t width;        /* size of the images that the intrinsics are for, pixels, up to 32768; */
  uint32_t height;       /* 0, 0 (default): that of the pushed images */
  double fx;             /* horizontal focal length, pixels, > 0 */
  double fy;             /* vertical focal length, pixels, > 0 */
  double cx;             /* x of the principal point, pixels: that of OpenCV plus 0.5 */
  double cy;             /* y of the principal point, pixels: that of OpenCV plus 0.5 */
  double distortion[8];  /* k1 k2 p1 p2 k3 k4 k5 k6; of a fisheye lens k1 k2 k3 k4 0 0 0 0;
                          * default 0 */
  double rotation[9];    /* orthonormal, determinant 1, row-major; default: the identity */
  double translation[3]; /* scene units; default 0 */
  stgs_lens lens;        /* default STGS_LENS_OPENCV */
  int32_t reserved;      /* 0 */
} stgs_live_camera;

/* Fills a camera with the defaults. The name and the focal lengths have none. `struct_size` is
 * sizeof(*camera). */
STGS_API stgs_result stgs_live_camera_defaults(stgs_live_camera* camera, size_t struct_size);

/* A window of frames that has been encoded. The library sets struct_size: an older library omits
 * the members beyond it. */
typedef struct stgs_live_window {
  size_t struct_size;
  uint32_t first_frame;    /* number of its first frame; the recording begins with frame 0 */
  uint32_t frames;         /* in the window */
  uint32_t frames_waiting; /* for encoding, after the window; many: the machine falls behind */
  uint32_t iterations;     /* views trained on */
  uint64_t missing;        /* images that were not pushed in time; training leaves them out */
  uint64_t primitives;     /* added to the recording */
  uint64_t bytes;          /* added to the recording */
  double loss;             /* of training, running mean */
  double prepare_seconds;  /* time for the initial points */
  double train_seconds;    /* time for training and writing */
  double latency;          /* from the last image of a frame to its appearance in the recording,
                            * seconds, largest of the window */
  int32_t written;         /* 0: preparing or writing failed, and the log has the reason; the window
                            * shows static content only */
  int32_t reserved;        /* 0 */
  double psnr;             /* of training images at the end of training, dB; views that training has
                            * not seen have less. 0: the window was not trained */
  double scale;            /* of its images, relative to those of `scale` in the settings: 1, 0.5 or
                            * 0.25 */
} stgs_live_window;

/* Receives a window once it is in the recording. Called on a thread of the session, which waits for
 * it. Must not call stgs_live_finish or stgs_live_destroy. */
typedef void (*stgs_live_window_fn)(void* user, const stgs_live_window* window);

/* Settings of a session. */
typedef struct stgs_live_settings {
  size_t struct_size;
  const stgs_live_camera* cameras; /* calibration of the rig, at least two cameras; NULL (default):
                                    * from `rig` */
  const char* rig; /* file in the format of cameras.json (sdk/docs/guide/captures.md), or a capture
                    * folder; its cameras that are not held out take part, and their sources are
                    * ignored. NULL (default): from `cameras` */
  uint32_t camera_count;            /* length of `cameras` */
  int32_t trust_calibration;        /* 1: only warn if a mistake in the calibration is found; 0
                                     * (default): stgs_live_finish returns it as an error */
  double fps;                       /* frames per second, 0.1 to 1000; 0 (default): from `rig` */
  double scale;                     /* of the images in training, 0.01 to 1; default 1. If the
                                     * machine is too slow, they become smaller */
  double latency;                   /* target from filming a frame to its appearance in the
                                     * recording, seconds, 0.1 to 60; default 1.5. A window lasts a
                                     * third of it, but at least 8 frames */
  double start_seconds;             /* time to wait for all cameras after the first image, 0.1 to
                                     * 3600; default 10. Then encoding starts with the cameras that
                                     * deliver, at least two, and ignores the others */
  stgs_preset preset;               /* upper bound of the work per window; default
                                     * STGS_PRESET_FAST */
  stgs_backend backend;             /* as in stgs_train_settings, of all work on a GPU */
  uint32_t iterations;              /* views to train on per window at most, up to 10^8; 0
                                     * (default): from the preset */
  uint32_t max_primitives;          /* of a window, with static ones, up to 2 * 10^8; 0 (default):
                                     * from the preset */
  uint64_t seed;                    /* of random choices; default 1. Recordings still differ: the
                                     * work depends on the speed of the machine */
  double target_kbps;               /* limit of the mean bit rate once static content is stored,
                                     * kbit/s, 1 to 10^9; 0 (default): no limit. A tenth of the
                                     * primitives of a window remains in any case */
  uint64_t queue_bytes;             /* for images that wait; 0 (default): a quarter of the available
                                     * memory. At most 20 seconds of frames wait */
  const stgs_parameter* parameters; /* overrides of hyperparameters */
  uint32_t parameter_count;         /* default 0 */
  uint32_t threads;                 /* limit, up to 1024; 0 (default): all cores. From
                                     * stgs_live_start to stgs_live_destroy, OpenCV is
                                     * single-threaded in the whole process */
  const char* title;                /* metadata, up to 4096 bytes; NULL (default): none */
  stgs_log_fn log;                  /* called on any thread, one call at a time; must not call
                                     * stgs_live_finish or stgs_live_destroy. NULL (default): no
                                     * log */
  void* log_user;                   /* first argument of `log` */
  stgs_live_window_fn window;       /* NULL (default): windows are not reported */
  void* window_user;                /* first argument of `window` */
} stgs_live_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_live_settings_defaults(stgs_live_settings* settings, size_t struct_size);

/* Creates a session without a recording. */
STGS_API stgs_result stgs_live_create(stgs_live** out);

/* Destroys a session. No other call may be running.
 *
 * A session that was not finished stops without encoding the images that wait. Its recording stays
 * up to the last window; players wait for more, and `stgs finalize` completes it. */
STGS_API void stgs_live_destroy(stgs_live* live);

/* Returns the outcome of the last call of the calling thread on the session, other than calls of
 * this function and of stgs_live_cancel. The message is valid until the next call of this thread on
 * the session. */
STGS_API stgs_result stgs_live_error(const stgs_live* live, stgs_error* error);

/* Starts the session: checks the settings and the calibration, and waits for images.
 *
 * Players can open the file `recording` once its first window is written. Temporary files are next
 * to it. Fails with STGS_ERROR_IO if it exists. STGS_ERROR_NOT_BUILT: the build lacks OpenCV or
 * FFmpeg, or the backend; STGS_ERROR_UNSUPPORTED: no device is available for it.
 * STGS_ERROR_INVALID_FILE: `rig` is damaged. After an error the call may be repeated; after success
 * it may not (STGS_ERROR_STATE). */
STGS_API stgs_result stgs_live_start(stgs_live* live, const char* recording,
                                     const stgs_live_settings* settings);

/* Order of the channels of a pixel, 8 bits each. */
typedef int32_t stgs_pixel_format;
enum {
  STGS_PIXELS_RGB8 = 0,  /* 3 bytes */
  STGS_PIXELS_BGR8 = 1,  /* 3 bytes */
  STGS_PIXELS_RGBA8 = 2, /* 4 bytes; alpha is ignored */
  STGS_PIXELS_BGRA8 = 3  /* 4 bytes; alpha is ignored */
};

/* Memory that a pointer refers to. */
typedef int32_t stgs_memory;
enum {
  STGS_MEMORY_HOST = 0, /* of the host */
  STGS_MEMORY_CUDA = 1  /* of a CUDA device */
};

struct CUstream_st; /* cudaStream_t and CUstream are pointers to it */

/* An image of a camera, sRGB-encoded. */
typedef struct stgs_live_image {
  size_t struct_size;
  const void* data;           /* the first row, from the top */
  size_t stride;              /* bytes between rows; 0 (default): rows are contiguous */
  uint32_t width;             /* pixels, 1 to 32768; all images of a camera have one size */
  uint32_t height;            /* pixels, 1 to 32768 */
  stgs_pixel_format format;   /* default STGS_PIXELS_RGB8 */
  stgs_memory memory;         /* default STGS_MEMORY_HOST */
  struct CUstream_st* stream; /* CUDA: the copy follows all work submitted to this stream before the
                               * call; NULL (default): the default stream */
} stgs_live_image;

/* Fills an image with the defaults: no pixels. `struct_size` is sizeof(*image). */
STGS_API stgs_result stgs_live_image_defaults(stgs_live_image* image, size_t struct_size);

/* Adds an image of the camera with this name, filmed at the time `seconds`.
 *
 * The time is that of a clock that all cameras share, from any origin. It is rounded to whole
 * frames: images of one frame need times within half a frame of each other. A camera may leave out
 * frames. Images that are late, repeated or far ahead in time, and those that find the queue full,
 * are dropped without an error and counted in stgs_live_report.
 *
 * Undistorts and copies the image on the calling thread, and never waits for encoding. The image is
 * not needed after the call. STGS_ERROR_ARGUMENT: an unknown camera, an invalid image, or a time
 * that is not finite. STGS_ERROR_STATE: the session has not started or is finished, or encoding has
 * ended; stgs_live_finish returns the reason. STGS_ERROR_NOT_BUILT: the build lacks CUDA;
 * STGS_ERROR_UNSUPPORTED: no CUDA device is available. STGS_ERROR_OUT_OF_MEMORY: the call may be
 * repeated. */
STGS_API stgs_result stgs_live_push(stgs_live* live, const char* camera, double seconds,
                                    const stgs_live_image* image);

/* Ends a camera: encoding no longer waits for its images. Ignores images that are pushed later. */
STGS_API stgs_result stgs_live_end_camera(stgs_live* live, const char* camera);

/* Totals of a session. */
typedef struct stgs_live_report {
  size_t struct_size;
  uint32_t cameras;      /* that take part; 0 before the first window */
  uint32_t frames;       /* encoded */
  uint32_t windows;      /* encoded */
  uint32_t lost_frames;  /* of windows that show static content only */
  uint64_t images;       /* pushed */
  uint64_t dropped;      /* images that were pushed, but are not used: the sum of the next four */
  uint64_t dropped_late; /* their frame was already being encoded */
  uint64_t dropped_repeated;  /* their camera had already delivered the frame */
  uint64_t dropped_ahead;     /* their time is more than 5 seconds ahead of the other cameras and of
                               * real time */
  uint64_t dropped_overflow;  /* encoding was too slow */
  uint64_t missing;           /* images of cameras that take part, not pushed in time */
  uint64_t primitives;        /* in the recording */
  uint64_t static_primitives; /* of them, displayed from their window to the end */
  uint64_t bytes;             /* of the windows in the recording */
  /* From the last image of a frame to its appearance in the recording, seconds, to 0.001: */
  double latency_median; /* of all frames */
  double latency_p95;    /* 95 % of the frames have at most this */
  double latency_max;    /* up to 60 */
  int32_t ended;         /* 1: encoding has ended, because all cameras have, or by an error;
                          * call stgs_live_finish */
  int32_t reserved;      /* 0 */
  double psnr;           /* mean of those of the windows (stgs_live_window), per frame, dB; 0: none
                          * was trained */
  double scale;          /* mean of those of the windows, per frame; 0 before the first window */
} stgs_live_report;

/* Returns the totals so far. Does not wait for encoding. STGS_ERROR_STATE: the session has not
 * started. */
STGS_API stgs_result stgs_live_get_report(stgs_live* live, stgs_live_report* report);

/* Ends all cameras, waits until the images that wait are encoded, and marks the recording as
 * finished: players play it to its end.
 *
 * Then writes the same scene to the file `output`, with its index at the front, so that opening
 * takes one read; replaces an existing file. NULL: not written; `stgs finalize` can write it later.
 * If `output` cannot be written, the call fails at once with STGS_ERROR_IO or STGS_ERROR_ARGUMENT,
 * changes nothing and may be repeated. After any other error the session is finished; the recording
 * has the windows before the error, and `stgs finalize` completes it. If writing `output` fails
 * later, the recording is complete. Errors that ended encoding earlier are returned here:
 * STGS_ERROR_RUNTIME, for example if fewer than two cameras delivered images;
 * STGS_ERROR_INVALID_FILE, if the calibration is wrong; STGS_ERROR_IO, if the disk is full. */
STGS_API stgs_result stgs_live_finish(stgs_live* live, const char* output);

/* Cancels the session permanently: a stgs_live_finish that waits for encoding ends soon, and it and
 * all later calls other than stgs_live_get_report fail with STGS_ERROR_CANCELLED. Writing `output`
 * is not cancelled. Encoding stops with stgs_live_finish or stgs_live_destroy; the recording stays
 * as after the latter.
 *
 * May be called on any thread and from signal handlers until stgs_live_destroy. NULL: does
 * nothing. */
STGS_API void stgs_live_cancel(stgs_live* live);

/** @} */

#ifdef __cplusplus
}
#endif

#endif
