/* SPDX-License-Identifier: Apache-2.0 */
/* STGS for applications: opens .stgs scenes and renders them. C99.
 *
 *   stgs_scene_create(NULL, &scene);
 *   stgs_scene_open(scene, "scene.stgs");
 *   stgs_renderer_create(NULL, &renderer);
 *   stgs_render(renderer, scene, seconds, &view, &image, 1);
 *   stgs_renderer_destroy(renderer);
 *   stgs_scene_destroy(scene);
 *
 * These rules apply to every header, unless a declaration states otherwise.
 *
 * Objects: a _create function returns an opaque object that the caller owns and releases with the
 * matching _destroy function, which accepts NULL. If it fails, *out is NULL.
 *
 * Structs: the first member is the size of the struct. The caller sets it to sizeof, either through
 * a _defaults function or, for structs that only return results, by hand. All elements of an array
 * have the same size. Structs only grow at their end, so program and library may differ in version:
 *  - from a shorter struct the library takes the missing members as defaults and does not write
 *    them;
 *  - in a longer struct the library writes 0 to unknown members and rejects other values in them
 *    (STGS_ERROR_STRUCT_SIZE).
 *
 * Errors: functions return STGS_OK or an error; the _error function of the object returns the
 * message. After an error an object is unchanged and stays usable. Other out parameters are written
 * only on success.
 *
 * Threads: objects are independent of each other. One thread at a time may use an object. Functions
 * without an object may be called at any time. There is no global state.
 *
 * Ownership: structs, arrays and strings that a function receives are read during the call and not
 * retained. Settings are copied.
 *
 * Conventions: time in seconds; OpenCV camera axes (x right, y down, z forward); world-to-camera
 * matrices in row-major order; pixel (i, j) covers [i, i + 1) x [j, j + 1); sRGB-encoded colours;
 * UTF-8 text; int32_t flags are 0 or 1. */
#ifndef STGS_STGS_H
#define STGS_STGS_H

#include <stddef.h>
#include <stdint.h>

#include "stgs/stgs_hooks.h"

#if defined(__GNUC__)
#define STGS_API __attribute__((visibility("default")))
#else
#define STGS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_version Version
 *
 *  The version of the headers and of the library in use.
 *  @{ */

#define STGS_VERSION_MAJOR 0 /* major version of the headers */
#define STGS_VERSION_MINOR 1 /* minor version of the headers */
#define STGS_VERSION_PATCH 0 /* patch version of the headers */

/* Returns the version of the library in use: major * 1000000 + minor * 1000 + patch. */
STGS_API uint32_t stgs_version(void);

/** @} */

/** @defgroup api_errors Errors
 *
 *  Results of functions, and the messages of objects.
 *  @{ */

/* Result of a function. The tens digit is the category, to which later versions may add values. */
typedef int32_t stgs_result;
enum {
  STGS_OK = 0,
  STGS_ERROR_ARGUMENT = 10,      /* an argument is invalid; the message names it */
  STGS_ERROR_STRUCT_SIZE = 11,   /* struct_size matches no version of the struct, or the struct sets
                                  * a member that this library does not know */
  STGS_ERROR_STATE = 12,         /* not possible now: no scene is open, or one is already open */
  STGS_ERROR_IO = 20,            /* reading from or writing to a file or source failed */
  STGS_ERROR_INVALID_FILE = 30,  /* the file is not a valid .stgs file */
  STGS_ERROR_RUNTIME = 40,       /* any other failure */
  STGS_ERROR_OUT_OF_MEMORY = 41, /* of the host or the GPU */
  STGS_ERROR_LIMIT = 42,         /* a limit of stgs_scene_settings would be exceeded */
  STGS_ERROR_CANCELLED = 43,     /* the caller cancelled the operation */
  STGS_ERROR_DEVICE_LOST = 44,   /* the GPU failed; destroy the renderer and create another */
  STGS_ERROR_TIMEOUT = 45,       /* the operation did not complete in the given time */
  STGS_ERROR_UNSUPPORTED = 50,   /* valid, but not available: no device, or a later file format */
  STGS_ERROR_NOT_BUILT = 60      /* this build of the library lacks the feature */
};

/* Returns the name of a result, such as "STGS_ERROR_IO", or "unknown result". The string is static:
 * never NULL, never to be freed. */
STGS_API const char* stgs_result_name(stgs_result result);

#define STGS_NO_OFFSET UINT64_MAX /* the position in the file is not known */

/* Describes the outcome of the last call on an object. */
typedef struct stgs_error {
  size_t struct_size;
  stgs_result result;  /* STGS_OK: the call succeeded */
  int32_t issue;       /* number of the file issue as in `stgs validate`; 0: none */
  uint64_t offset;     /* position in the file, bytes; STGS_NO_OFFSET: not known */
  const char* message; /* never NULL; valid until the next call on the object */
} stgs_error;

/** @} */

/** @defgroup api_scenes Scenes
 *
 *  Opens .stgs files from paths, URLs, memory and sources of the application.
 *  @{ */

/* An open .stgs file and the parts of it that are decoded. */
typedef struct stgs_scene stgs_scene;

/* Limits and hooks of a scene. */
typedef struct stgs_scene_settings {
  size_t struct_size;
  uint64_t memory_budget;  /* decoded data to retain, bytes, at least 1 MiB; default 4 GiB */
  uint64_t max_file_bytes; /* larger files fail to open; default 2^63 - 1 */
  uint64_t max_primitives; /* files with more primitives fail to open; default 200 million */
  uint64_t max_memory;     /* for the file index, for decoding a segment, and for the statistics of
                            * the complete file, bytes, at least 1 MiB; default 4 GiB. Up to there,
                            * opening takes at most 64 MiB and 4 bytes for each byte that it reads;
                            * with a larger value, that value */
  int32_t reject_damage;   /* 1: a damaged file is an error; 0 (default): render the intact part
                            * and log the damage */
  stgs_log_fn log;         /* NULL (default): no log. Retries of transfers from a URL are logged on
                            * the threads that read, one at a time */
  void* log_user;          /* first argument of `log` */
  const stgs_allocator* allocator; /* copied; NULL (default): the heap */
  const char* name; /* of data in memory and of application sources, in messages; copied; NULL
                     * (default): "memory" or "application source" */
  double url_timeout_seconds; /* URLs: limit of a read, with name lookup, connecting, redirections,
                               * headers, all attempts and pauses, 0.1 to 1e6 s, and longer by the
                               * time that the bytes received take at url_min_bytes_per_second;
                               * default 60 */
  double url_min_bytes_per_second; /* URLs: 1 to 1e9; default 1000 */
  int32_t url_allow_private; /* URLs: 1: public host names and redirections may lead to addresses of
                              * private networks; 0 (default): only the host of the URL may be
                              * there, given as an address, localhost, a single label or a name
                              * below .local. The addresses behind a proxy are not known */
} stgs_scene_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_scene_settings_defaults(stgs_scene_settings* settings,
                                                  size_t struct_size);

/* Creates a scene without a file. NULL settings: the defaults. The log receives the message of an
 * error. */
STGS_API stgs_result stgs_scene_create(const stgs_scene_settings* settings, stgs_scene** out);

/* Destroys a scene and everything that belongs to it. No other thread may be using the scene. Does
 * nothing for the scene of a player. */
STGS_API void stgs_scene_destroy(stgs_scene* scene);

/* Cancels the scene permanently: running and later transfers from a URL fail at once.
 *
 * A call that fails for this reason returns STGS_ERROR_CANCELLED while opening or computing
 * statistics, otherwise STGS_ERROR_RUNTIME. May be called on any thread until stgs_scene_destroy.
 * Does not affect other sources. NULL: does nothing. */
STGS_API void stgs_scene_cancel(stgs_scene* scene);

/* Opens a path, or an http or https URL.
 *
 * Reads and checks the header, metadata and index of the file, but no primitives. A scene opens one
 * file (STGS_ERROR_STATE); after any other error opening may be retried. A URL needs libcurl
 * (STGS_ERROR_NOT_BUILT); a silent server blocks the call for up to a minute, in five attempts. To
 * open without blocking, use stgs_player_open. */
STGS_API stgs_result stgs_scene_open(stgs_scene* scene, const char* location);

/* Opens a file in memory without copying it. The bytes must stay valid and unchanged until the
 * scene is destroyed or the call fails. Otherwise like stgs_scene_open. */
STGS_API stgs_result stgs_scene_open_memory(stgs_scene* scene, const void* data, size_t bytes);

/* Opens a copy of a file in memory. The bytes are not needed after the call. Otherwise like
 * stgs_scene_open. */
STGS_API stgs_result stgs_scene_open_memory_copy(stgs_scene* scene, const void* data, size_t bytes);

/* Opens a data source of the application. The struct is copied.
 *
 * io->close is called when the scene is destroyed or before a failing call returns; after
 * STGS_ERROR_ARGUMENT, _STRUCT_SIZE and _STATE it is not called. Otherwise like stgs_scene_open. */
STGS_API stgs_result stgs_scene_open_io(stgs_scene* scene, const stgs_io* io);

/* Returns the outcome of the last call on the scene, other than calls of this function. */
STGS_API stgs_result stgs_scene_error(const stgs_scene* scene, stgs_error* error);

/** @} */

/** @defgroup api_views Views
 *
 *  Cameras: position, lens and size of an image. The helpers need no object.
 *  @{ */

#define STGS_MAX_VIEWS 4    /* views per call */
#define STGS_MAX_SIDE 32768 /* width and height of a view, pixels */

/* A pinhole camera and its image size: p_camera = rotation * p_world + translation. */
typedef struct stgs_view {
  size_t struct_size;
  float rotation[9];    /* orthonormal, determinant 1, row-major */
  float translation[3]; /* scene units */
  float fx;             /* horizontal focal length, pixels, > 0 */
  float fy;             /* vertical focal length, pixels, > 0 */
  float cx;             /* x of the principal point, pixels; may lie outside the image */
  float cy;             /* y of the principal point, pixels; may lie outside the image */
  uint32_t width;       /* of the image, pixels, 1 to STGS_MAX_SIDE */
  uint32_t height;      /* of the image, pixels, 1 to STGS_MAX_SIDE */
  float near_plane;     /* scene units, > 0; nothing nearer is rendered */
  float background[3];  /* red, green, blue, sRGB-encoded */
  float fovea_x;        /* x of the gaze point, pixels; may lie outside the image */
  float fovea_y;        /* y of the gaze point, pixels; may lie outside the image */
  float fovea_radius;   /* pixels, >= 0: blocks of 32 x 32 pixels that lie entirely farther from
                         * the gaze point are rendered at half resolution; 0 (default): full
                         * resolution everywhere */
} stgs_view;

/* Fills a view with the defaults: at the world origin, looking along z, 90 degrees wide, 1280 x 720
 * pixels, over black. `struct_size` is sizeof(*view). */
STGS_API stgs_result stgs_view_defaults(stgs_view* view, size_t struct_size);

/* Changes the image size of a view and keeps its pixels square.
 *
 * Fits the view angle: the image shows at least what it showed before, and more along one axis if
 * the aspect ratio changes. fx and fy keep their ratio, the principal point its relative position
 * in the image, and the fovea its direction and angular size. To stretch the image instead, use
 * stgs_view_stretch. STGS_ERROR_ARGUMENT: a size is out of range, or a scaled length is not finite;
 * the view is unchanged. */
STGS_API stgs_result stgs_view_resize(stgs_view* view, uint32_t width, uint32_t height);

/** @} */

/** @defgroup api_images Images
 *
 *  Memory of the application that receives pixels.
 *  @{ */

/* Rows of pixels in memory of the caller, from the top. */
typedef struct stgs_buffer {
  void* data;    /* NULL: not requested */
  size_t stride; /* bytes between rows, a multiple of 4 for floats; 0: rows are contiguous */
  size_t bytes;  /* size of the memory; must reach at least to the end of the last row */
} stgs_buffer;

/* The buffers that receive the image of a view. At least one must be set; they must not overlap. */
typedef struct stgs_image {
  size_t struct_size;
  stgs_buffer rgba8;  /* 4 bytes per pixel: colour over the background, rounded, and alpha */
  stgs_buffer rgb[3]; /* 1 float per pixel: red, green, blue over the background; all or none */
  stgs_buffer alpha;  /* 1 float per pixel: 0 transparent to 1 opaque */
  stgs_buffer depth;  /* 1 float per pixel: mean camera z, scene units; 0 where alpha is 0 */
} stgs_image;

/* Fills an image with the defaults: no buffer is requested. `struct_size` is sizeof(*image). */
STGS_API stgs_result stgs_image_defaults(stgs_image* image, size_t struct_size);

/** @} */

/** @defgroup api_rendering Rendering
 *
 *  Renders views of a scene on the CPU or a GPU into memory of the host.
 *  @{ */

/* A backend with its buffers. It renders any number of scenes. */
typedef struct stgs_renderer stgs_renderer;

/* Rendering backend. */
typedef int32_t stgs_backend;
enum {
  STGS_BACKEND_AUTO = 0,  /* CUDA if it is built and a device is available, otherwise the CPU */
  STGS_BACKEND_CPU = 1,   /* all cores of the host */
  STGS_BACKEND_CUDA = 2,  /* an NVIDIA GPU */
  STGS_BACKEND_VULKAN = 3 /* a GPU with Vulkan 1.1 */
};

/* Backend and hooks of a renderer. */
typedef struct stgs_renderer_settings {
  size_t struct_size;
  stgs_backend backend; /* default STGS_BACKEND_AUTO */
  stgs_log_fn log;      /* NULL (default): no log */
  void* log_user;       /* first argument of `log` */
  /* Runs all CPU work of rendering, including decoding; copied. NULL (default): threads of the
   * library and the calling thread. */
  const stgs_task_runner* task_runner;
  int32_t measure;  /* 1: stgs_render measures its steps for stgs_renderer_get_statistics, which can
                     * slow down a GPU; default 0 */
  int32_t reserved; /* 0 */
} stgs_renderer_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_renderer_settings_defaults(stgs_renderer_settings* settings,
                                                     size_t struct_size);

/* Creates a renderer. NULL settings: the defaults.
 *
 * The log receives the message of an error. STGS_ERROR_NOT_BUILT: the build lacks the backend;
 * STGS_ERROR_UNSUPPORTED: no device is available for it. */
STGS_API stgs_result stgs_renderer_create(const stgs_renderer_settings* settings,
                                          stgs_renderer** out);

/* Destroys a renderer, before or after the scenes that it rendered. */
STGS_API void stgs_renderer_destroy(stgs_renderer* renderer);

/* Returns the outcome of the last call on the renderer, other than calls of this function. */
STGS_API stgs_result stgs_renderer_error(const stgs_renderer* renderer, stgs_error* error);

/* Returns the backend in use, never STGS_BACKEND_AUTO. */
STGS_API stgs_result stgs_renderer_get_backend(stgs_renderer* renderer, stgs_backend* out);

/* Counts and times of the last stgs_render, summed over its views unless stated otherwise. GPU
 * backends report device times for slice, bin and blend. */
typedef struct stgs_render_statistics {
  size_t struct_size;
  uint64_t stored_primitives; /* decoded and resident; per call */
  uint64_t active_primitives; /* that may be visible at this time; per call */
  uint64_t splats;            /* visible splats */
  double fetch_ms;            /* finding and decoding the active segments; per call */
  double slice_ms;            /* computing the primitives at the time */
  double bin_ms;              /* sorting splats into tiles */
  double blend_ms;            /* blending the pixels */
  double device_ms;           /* from the start to the end of the device's work; 0 for the CPU */
} stgs_render_statistics;

/* Returns the statistics of the last successful stgs_render. STGS_ERROR_STATE: the renderer does
 * not measure, or has not rendered yet. */
STGS_API stgs_result stgs_renderer_get_statistics(stgs_renderer* renderer,
                                                  stgs_render_statistics* statistics);

/* Renders 1 to STGS_MAX_VIEWS views of the scene at the time `seconds` and waits for the images.
 *
 * images[i] receives views[i]. `seconds` is in the clip, 0 to stgs_scene_info.duration_seconds;
 * other times fail with STGS_ERROR_ARGUMENT, except that times up to half a frame outside count as
 * the nearer end, to allow for rounding. A recording that a player follows has no end: times beyond
 * its edge are valid, but the image is incomplete. The times of stgs_player_status are always
 * valid.
 *
 * The call uses both the renderer and the scene: no other thread may use either. Invalid arguments
 * leave the buffers unchanged; other errors leave their content undefined. STGS_ERROR_LIMIT: the
 * segments active at this time need more than memory_budget, or the images and the working memory
 * of the renderer more than memory_budget and more than 1 GiB. On a CPU, images take 29 bytes per
 * pixel, splats 80 to 144 bytes each, and each tile of 16 x 16 pixels that a splat covers 8 to 16
 * bytes. Later calls succeed if they need less. STGS_ERROR_RUNTIME: the splats of a view cover more
 * than 2^26 tiles, as large splats can in images with sides of thousands of pixels. */
STGS_API stgs_result stgs_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                 const stgs_view* views, const stgs_image* images, uint32_t count);

/** @} */

#ifdef __cplusplus
}
#endif

/* The remaining headers of the library; each needs the declarations above. */
#include "stgs/stgs_contents.h"
#include "stgs/stgs_player.h"
#include "stgs/stgs_scene.h"
#include "stgs/stgs_view.h"

#endif
