/* SPDX-License-Identifier: Apache-2.0 */
/* STGS for applications: opens .stgs scenes and draws them; stgs_player.h plays them. C99.
 *
 * Objects are opaque, made by a _create function and given back by the _destroy function of the
 * same name, which takes NULL. A struct begins with its size, which the caller sets to its sizeof
 * (the _defaults functions do it), all elements of an array to the same; structs grow at their end.
 * Of a caller with an older header, a later library takes the members that it lacks as their
 * defaults, and writes none of them. Of a caller with a later header, an older library writes 0 to
 * the members that it does not know, and takes them only as 0 (else STGS_ERROR_STRUCT_SIZE).
 *
 * Threads: objects are independent of each other, and an object is used by one thread at a time,
 * whichever; the functions without an object may be called at any time. What a line says otherwise
 * counts. There is no global state.
 *
 * Results: STGS_OK, or what went wrong; stgs_scene_error and stgs_renderer_error tell it in words.
 * After an error an object is as it was before the call, and can be used on, but where a line says
 * otherwise. Out parameters are written on success alone, but where a line says so.
 *
 * Conventions: seconds; OpenCV camera axes (x right, y down, z forward); world-to-camera matrices,
 * row by row; pixel (i, j) covers [i, i + 1) x [j, j + 1); colours sRGB-encoded; text is UTF-8. */
#ifndef STGS_STGS_H
#define STGS_STGS_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define STGS_API __attribute__((visibility("default")))
#else
#define STGS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define STGS_VERSION_MAJOR 0
#define STGS_VERSION_MINOR 1
#define STGS_VERSION_PATCH 0

/* Of the library that runs: major * 1000000 + minor * 1000 + patch. */
STGS_API uint32_t stgs_version(void);

/* A tens digit is a kind; later versions may add results to a kind. */
typedef int32_t stgs_result;
enum {
  STGS_OK = 0,
  STGS_ERROR_ARGUMENT = 10,    /* a call that makes no sense; a message says why */
  STGS_ERROR_STRUCT_SIZE = 11, /* struct_size is none of a struct's, or larger than this library's
                                * with something set that this library does not know */
  STGS_ERROR_STATE = 12,       /* not now: no scene is open, or one is already */
  STGS_ERROR_IO = 20,          /* a file or source could not be read, or a file not be written */
  STGS_ERROR_INVALID_FILE = 30,
  STGS_ERROR_RUNTIME = 40,       /* anything else that went wrong while working */
  STGS_ERROR_OUT_OF_MEMORY = 41, /* the machine's or the GPU's */
  STGS_ERROR_LIMIT = 42,         /* one of stgs_scene_settings does not allow it */
  STGS_ERROR_CANCELLED = 43,     /* the caller stopped it */
  STGS_ERROR_DEVICE_LOST = 44,   /* the GPU has failed: see docs/formats-and-errors.md */
  STGS_ERROR_UNSUPPORTED = 50,   /* well-formed, but not possible here: no device, a later format */
  STGS_ERROR_NOT_BUILT = 60      /* a part that this build leaves out */
};

/* "STGS_ERROR_IO" and so on; "unknown result" for others. A constant: never NULL, never freed. */
STGS_API const char* stgs_result_name(stgs_result result);

#define STGS_NO_OFFSET UINT64_MAX

/* What went wrong in the last call on an object. */
typedef struct stgs_error {
  size_t struct_size;
  stgs_result result;  /* STGS_OK: nothing */
  int32_t issue;       /* of the file, as `stgs validate` numbers it; 0: none */
  uint64_t offset;     /* of the file, bytes; STGS_NO_OFFSET: not known */
  const char* message; /* never NULL; until the next call on the object */
} stgs_error;

typedef int32_t stgs_log_level;
enum { STGS_LOG_ERROR = 0, STGS_LOG_WARNING = 1, STGS_LOG_INFO = 2 };

/* Called on the thread of a call, during it. Must not call functions with the same object. */
typedef void (*stgs_log_fn)(void* user, stgs_log_level level, const char* message);

/* Threads of the application's for the work of the library; used for what its settings say. */
typedef struct stgs_task_runner {
  size_t struct_size;
  void* user;
  /* Calls task(argument) once at least and `count` times at most, on whichever threads, at once
   * where it can, and returns when these calls have returned. The calls share the work: one of them
   * alone does all that is left. Called by several threads at once, and from within tasks: a thread
   * that waits here for others must run what they wait for, or they wait for each other; one that
   * calls the task itself, and waits for no call that has not begun, never does. */
  void (*run)(void* user, void (*task)(void* argument), void* argument, uint32_t count);
  uint32_t threads; /* that work is shared out for, 1 to 1024: the greatest `count` */
} stgs_task_runner;

/* Memory of the application's for what a scene or a player holds: bytes that were fetched or
 * copied, decoded primitives, and when these are seen. Not for what lists the file, for what
 * opening, decoding and drawing take while they last, nor for a renderer's buffers and a device.
 * Must work until the scene or player and the renderers that have drawn it are destroyed. The
 * functions must not call the library: its locks may be held. */
typedef struct stgs_allocator {
  size_t struct_size;
  void* user;
  /* More than 0 bytes at a multiple of `alignment`, a power of 2. NULL: there are none, which ends
   * the call with STGS_ERROR_OUT_OF_MEMORY; a player loses what it was for, and tries again later.
   * Any thread, several at once. */
  void* (*allocate)(void* user, size_t bytes, size_t alignment);
  /* Takes back what `allocate` gave for the same numbers. Any thread, several at once. */
  void (*free)(void* user, void* memory, size_t bytes, size_t alignment);
} stgs_allocator;

/* --- Scenes --- */

typedef struct stgs_scene stgs_scene;

typedef struct stgs_scene_settings {
  size_t struct_size;
  uint64_t max_file_bytes; /* of the source; default 2^63 - 1 */
  uint64_t max_primitives; /* of the whole file; default 200 million */
  uint64_t max_memory;     /* bytes of what is decoded and held; default 4 GiB, at least 1 MiB */
  int32_t reject_damage;   /* 0 (default): draw what is sound of a damaged file, and log it */
  stgs_log_fn log;         /* NULL (default): silent */
  void* log_user;
  const stgs_allocator* allocator; /* copied; NULL (default): the heap */
} stgs_scene_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_scene_settings_defaults(stgs_scene_settings* settings,
                                                  size_t struct_size);

/* A source of the caller's. */
typedef struct stgs_io {
  size_t struct_size;
  void* user;
  uint64_t size; /* bytes; for a player that has current_size, as many as that says */
  /* Fills `out` with the bytes [offset, offset + bytes), which lie within `size`: all of
   * them, or it fails. 0 is success, all else an error, a number of bytes too. Called by several
   * threads at once, which are not the caller's. */
  int (*read)(void* user, uint64_t offset, void* out, size_t bytes);
  /* Called once when nothing is read any more; NULL: nothing to do. */
  void (*close)(void* user);
  /* Called once at most, by stgs_player_destroy: reads under way must fail soon, and later ones at
   * once. NULL: nothing to do, they end by themselves. */
  void (*interrupt)(void* user);
  /* How many bytes there are now, of a recording that grows while a player follows it: called by a
   * thread of the player's, before anything is read and again and again, never for a scene without
   * a player. NULL: always `size`. */
  uint64_t (*current_size)(void* user);
} stgs_io;

/* A scene without a file. `settings` may be NULL: the defaults; they are copied. *out is NULL after
 * an error, else the caller's. */
STGS_API stgs_result stgs_scene_create(const stgs_scene_settings* settings, stgs_scene** out);
/* Ends the scene with all that belongs to it; not while another thread uses it. */
STGS_API void stgs_scene_destroy(stgs_scene* scene);

/* Opens a scene's file: reads and checks its header, metadata and index. A scene is opened once
 * (STGS_ERROR_STATE); after another error it may be tried again. */
/* A path, or a URL of http or https where the build has libcurl (STGS_ERROR_NOT_BUILT). Waits for a
 * server that is silent for up to a minute, in five tries; stgs_player_open does not wait, and a
 * player ends at any moment. */
STGS_API stgs_result stgs_scene_open(stgs_scene* scene, const char* place);
/* Borrowed: the bytes must stay, unchanged, until the scene is destroyed; after an error they are
 * not needed any more. */
STGS_API stgs_result stgs_scene_open_memory(stgs_scene* scene, const void* data, size_t bytes);
/* Copied: the bytes are not needed after the call. */
STGS_API stgs_result stgs_scene_open_memory_copy(stgs_scene* scene, const void* data, size_t bytes);
/* The struct is copied. io->close is called when the scene is destroyed; after an error it has been
 * called, but for STGS_ERROR_ARGUMENT, _STRUCT_SIZE and _STATE, which leave the source alone. */
STGS_API stgs_result stgs_scene_open_io(stgs_scene* scene, const stgs_io* io);

/* Of the last call on the scene but this one. error->struct_size is set by the caller. */
STGS_API stgs_result stgs_scene_error(const stgs_scene* scene, stgs_error* error);

typedef struct stgs_scene_info {
  size_t struct_size;
  uint16_t format_major, format_minor;
  uint32_t frames;              /* the clip is [0, frames) frames */
  uint32_t time_base_numerator; /* a frame is numerator / denominator seconds */
  uint32_t time_base_denominator;
  double duration_seconds;
  double complete_seconds; /* up to which nothing of the file is missing */
  uint64_t primitives;
  uint64_t file_bytes;
  uint64_t memory_bytes;              /* of what is decoded and held now */
  int32_t sh_degree;                  /* 0 to 3 */
  int32_t has_start_camera;           /* 0 or 1: whether stgs_scene_start_view has one */
  float bounds_min[3], bounds_max[3]; /* of the primitives' positions, scene units */
  float metres_per_unit;              /* 0: not known */
  float up[3];                        /* unit vector; 0, 0, 0: not known */
  float floor[3];                     /* a point of the floor, where `up` is known */
  uint32_t issues;                    /* of stgs_scene_issue */
} stgs_scene_info;

/* info->struct_size is set by the caller. */
STGS_API stgs_result stgs_scene_get_info(stgs_scene* scene, stgs_scene_info* info);

typedef int32_t stgs_text;
enum {
  STGS_TEXT_TITLE = 0,
  STGS_TEXT_GENERATOR = 1, /* program and version that wrote the file */
  STGS_TEXT_AUDIO = 2      /* URI reference of the sound, relative to the file's place */
};

/* *out: empty where the file has none; the scene's, until it is destroyed. */
STGS_API stgs_result stgs_scene_get_text(stgs_scene* scene, stgs_text which, const char** out);

/* What is wrong with the file, or worth telling, and could be read past when it was opened. */
typedef struct stgs_issue {
  size_t struct_size;
  int32_t number;      /* as `stgs validate` numbers it */
  int32_t is_error;    /* 0: a warning */
  uint64_t offset;     /* bytes */
  const char* message; /* the scene's, until it is destroyed */
} stgs_issue;

/* `index` from 0 to stgs_scene_info.issues - 1. issue->struct_size is set by the caller. */
STGS_API stgs_result stgs_scene_get_issue(stgs_scene* scene, uint32_t index, stgs_issue* issue);

/* The caller's arrays for primitives of a moment, apart from each other; NULL: not wanted. */
typedef struct stgs_primitives {
  size_t struct_size;
  uint64_t capacity; /* primitives that each array has room for */
  uint32_t* id;      /* number in the file, counted in the order of the segments */
  float* position;   /* 3 each: x, y, z at the moment, scene units */
  float* velocity;   /* 3 each: scene units a second */
  float* scale;      /* 3 each: standard deviations along the primitive's axes, scene units */
  float* rotation;   /* 4 each: of its axes, unit quaternion w, x, y, z */
  float* opacity;    /* 1 each: at the moment, 1/255 to 1 */
  float* sh;         /* 3 (stgs_scene_info.sh_degree + 1)^2 each: a coefficient's red, green and
                      * blue, then the next; in basis and order of 3D Gaussian Splatting */
} stgs_primitives;

/* Nothing wanted. `struct_size` is sizeof(*primitives). */
STGS_API stgs_result stgs_primitives_defaults(stgs_primitives* primitives, size_t struct_size);
/* The primitives that are seen at the moment `seconds`, which may lie outside the clip, in the
 * order of the file: *count is how many there are, and as many of them as fit are in the arrays.
 * `primitives` may be NULL, to count. After an error the arrays may have any content.
 * STGS_ERROR_LIMIT as of stgs_render. */
STGS_API stgs_result stgs_scene_get_primitives(stgs_scene* scene, double seconds,
                                               const stgs_primitives* primitives, uint64_t* count);

/* --- Drawing --- */

typedef struct stgs_renderer stgs_renderer;

typedef int32_t stgs_backend;
enum {
  STGS_BACKEND_AUTO = 0, /* CUDA where it is built and has a device, else the processor */
  STGS_BACKEND_CPU = 1,
  STGS_BACKEND_CUDA = 2,
  STGS_BACKEND_VULKAN = 3
};

typedef struct stgs_renderer_settings {
  size_t struct_size;
  stgs_backend backend; /* default STGS_BACKEND_AUTO */
  stgs_log_fn log;      /* NULL (default): silent */
  void* log_user;
  /* For all that drawing does on the processor, decoding what a scene lacks included; copied.
   * NULL (default): the library's threads, and the caller's. */
  const stgs_task_runner* task_runner;
} stgs_renderer_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_renderer_settings_defaults(stgs_renderer_settings* settings,
                                                     size_t struct_size);

/* `settings` may be NULL: the defaults; they are copied. *out is NULL after an error, which the log
 * has in words, else the caller's. STGS_ERROR_NOT_BUILT: a backend that the build leaves out;
 * STGS_ERROR_UNSUPPORTED: no device for it. */
STGS_API stgs_result stgs_renderer_create(const stgs_renderer_settings* settings,
                                          stgs_renderer** out);
/* Scenes that were drawn may be destroyed before or after. */
STGS_API void stgs_renderer_destroy(stgs_renderer* renderer);
/* Of the last call on the renderer but this one. error->struct_size is set by the caller. */
STGS_API stgs_result stgs_renderer_error(const stgs_renderer* renderer, stgs_error* error);
/* *out: which it is, never STGS_BACKEND_AUTO. */
STGS_API stgs_result stgs_renderer_get_backend(stgs_renderer* renderer, stgs_backend* out);

#define STGS_MAX_VIEWS 4
#define STGS_MAX_SIDE 32768 /* pixels */

/* A pinhole camera: p_camera = rotation p_world + translation. */
typedef struct stgs_view {
  size_t struct_size;
  float rotation[9];
  float translation[3];   /* scene units */
  float fx, fy, cx, cy;   /* pixels; fx, fy > 0 */
  uint32_t width, height; /* pixels, 1 to STGS_MAX_SIDE */
  float near_plane;       /* scene units, > 0: nothing nearer is drawn */
  float background[3];
  /* Where the eye looks, pixels, also outside of the picture. Squares of 32 x 32 pixels all of
   * which are farther from there than fovea_radius are drawn at half resolution. */
  float fovea_x, fovea_y;
  float fovea_radius; /* pixels, >= 0; 0 (default): full resolution everywhere */
} stgs_view;

/* At the world's origin, looking along z, 90 degrees wide, 1280 x 720, over black. `struct_size` is
 * sizeof(*view). */
STGS_API stgs_result stgs_view_defaults(stgs_view* view, size_t struct_size);
/* The camera that the file has to start with, its near plane and its background.
 * STGS_ERROR_UNSUPPORTED where it has no start camera: then *view has the defaults with these two,
 * and looks level where the file says what is up. view->struct_size is set by the caller. */
STGS_API stgs_result stgs_scene_start_view(stgs_scene* scene, stgs_view* view);
/* Moves a view's camera to where its picture shows all of the scene's bounds, in the middle and
 * with some room around them; a near plane beyond a part of them is brought before it. All else of
 * the view stays, its direction and lens too. Reads nothing of the file. Bounds of one point, as of
 * a scene of no primitives, count as a metre wide, or a unit where metres are not known.
 * STGS_ERROR_UNSUPPORTED: the camera would be more than 2^60 units away. */
STGS_API stgs_result stgs_scene_frame_view(stgs_scene* scene, stgs_view* view);
/* The same camera with pictures of another size; the view angle is kept an axis each, and the part
 * of the picture that the fovea covers. STGS_ERROR_ARGUMENT, and the view stays: a size is none, or
 * a length of the camera would not be finite. */
STGS_API stgs_result stgs_view_resize(stgs_view* view, uint32_t width, uint32_t height);

/* Rows of pixels in the caller's memory. */
typedef struct stgs_buffer {
  void* data;    /* NULL: not wanted */
  size_t stride; /* bytes from row to row; of floats a multiple of 4; 0: rows lie side by side */
  size_t bytes;  /* of the memory: at least up to the end of the last row */
} stgs_buffer;

/* What is wanted of a view: one buffer at least. Buffers must not overlap. */
typedef struct stgs_image {
  size_t struct_size;
  stgs_buffer rgba8;  /* 4 bytes a pixel: colour over the background, rounded; and alpha */
  stgs_buffer rgb[3]; /* a float a pixel each: red, green, blue over the background; all or none */
  stgs_buffer alpha;  /* a float a pixel: 0 where nothing is, 1 where it is opaque */
  stgs_buffer depth;  /* a float a pixel: mean camera z, scene units; 0 where alpha is 0 */
} stgs_image;

/* Nothing wanted. `struct_size` is sizeof(*picture). */
STGS_API stgs_result stgs_image_defaults(stgs_image* picture, size_t struct_size);

/* Draws 1 to STGS_MAX_VIEWS views of the moment `seconds`, which may lie outside the clip, and
 * waits for them: pictures[i] gets views[i]. Uses the scene as well as the renderer: neither may be
 * in another call. The views, pictures and memory are the caller's, and not kept. After an error in
 * the arguments no memory has been written, after others it may have any content.
 * STGS_ERROR_LIMIT: what is alive at the moment takes more than max_memory. STGS_ERROR_RUNTIME: the
 * splats touch more than 2^26 tiles of 16 x 16 pixels in a view, as large ones may in a picture of
 * tens of thousands of pixels a side. */
STGS_API stgs_result stgs_render(stgs_renderer* renderer, stgs_scene* scene, double seconds,
                                 const stgs_view* views, const stgs_image* pictures,
                                 uint32_t count);

#ifdef __cplusplus
}
#endif

/* The rest, for which this comes first. */
#include "stgs/stgs_player.h"

#endif
