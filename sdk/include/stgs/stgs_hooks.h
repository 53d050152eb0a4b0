/* SPDX-License-Identifier: Apache-2.0 */
/* Hooks of the application: logging, threads, memory and data sources. C99; stgs.h includes it.
 *
 * Structs follow the general rules of stgs.h. A callback must not throw an exception. */
#ifndef STGS_STGS_HOOKS_H
#define STGS_STGS_HOOKS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_hooks Hooks
 *
 *  Callbacks with which an application logs, schedules, allocates and reads for the library.
 *  @{ */

/** @defgroup api_logging Logging
 *
 *  Messages of the library.
 *  @{ */

/* Severity of a log message. */
typedef int32_t stgs_log_level;
enum {
  STGS_LOG_ERROR = 0,   /* the call fails */
  STGS_LOG_WARNING = 1, /* the call succeeds despite a defect, such as damage in a file */
  STGS_LOG_INFO = 2     /* progress and choices, such as the backend in use */
};

/* Receives a log message. Called on the thread that calls the library, during that call.
 *
 * `message` is UTF-8 and valid until the callback returns. The callback must not call functions
 * on the same object. */
typedef void (*stgs_log_fn)(void* user, stgs_log_level level, const char* message);

/** @} */

/** @defgroup api_threads Threads
 *
 *  Threads of the application for the CPU work of the library.
 *  @{ */

/* Runs the CPU work of the library on threads of the application. */
typedef struct stgs_task_runner {
  size_t struct_size;
  void* user; /* first argument of `run` */
  /* Calls task(argument) at least once and at most `count` times, then returns when all of these
   * calls have returned. The calls may run on any threads, and should run concurrently.
   *
   * The calls share the work: a single call completes everything that is left. Several threads,
   * and tasks themselves, may call `run` at the same time. A thread that waits in `run` must
   * either run other tasks or wait only for calls that have already started; otherwise nested
   * calls can deadlock. A runner that also calls the task itself, and waits only for calls that
   * have started, never deadlocks. */
  void (*run)(void* user, void (*task)(void* argument), void* argument, uint32_t count);
  uint32_t threads; /* threads to divide work between, 1 to 1024; `count` never exceeds it */
} stgs_task_runner;

/** @} */

/** @defgroup api_memory Memory
 *
 *  Memory of the application for the data of scenes.
 *  @{ */

/* Allocates the memory that a scene or a player retains: fetched and copied bytes, decoded
 * primitives, and their visibility over time.
 *
 * It does not serve the file index, temporary memory for opening, decoding and rendering, or
 * buffers of renderers and devices. It must stay usable until the scene or player and every
 * renderer that rendered it are destroyed. The callbacks must not call the library, which may hold
 * locks while it calls them. */
typedef struct stgs_allocator {
  size_t struct_size;
  void* user; /* first argument of both callbacks */
  /* Returns `bytes` (> 0) bytes whose address is a multiple of `alignment`, a power of 2, or NULL
   * if no memory is available. NULL ends a call with STGS_ERROR_OUT_OF_MEMORY; a player drops the
   * segment that the memory was for and retries later. Called on any thread, concurrently. */
  void* (*allocate)(void* user, size_t bytes, size_t alignment);
  /* Frees memory that `allocate` returned for the same `bytes` and `alignment`. Called on any
   * thread, concurrently. */
  void (*free)(void* user, void* memory, size_t bytes, size_t alignment);
} stgs_allocator;

/** @} */

/** @defgroup api_sources Data sources
 *
 *  Files that the application reads itself.
 *  @{ */

/* A data source whose reads block until the bytes are available. */
typedef struct stgs_io {
  size_t struct_size;
  void* user;    /* first argument of all callbacks */
  uint64_t size; /* bytes; with a player, `current_size` replaces it if set */
  /* Fills `out` with the bytes [offset, offset + bytes), which lie within the size. Returns 0 if
   * all of them were read; any other value, including a byte count, is an error. Called on several
   * threads of the library concurrently. */
  int (*read)(void* user, uint64_t offset, void* out, size_t bytes);
  /* Called once, after the last read. NULL: nothing to release. */
  void (*close)(void* user);
  /* Makes reads in flight fail soon and later reads fail at once. stgs_player_destroy calls it at
   * most once. NULL: reads end by themselves. */
  void (*interrupt)(void* user);
  /* Returns the current size in bytes of a recording that grows while a player follows it. A
   * thread of the player calls it before the first read and repeatedly afterwards. A scene without
   * a player never calls it. NULL: the size stays `size`. */
  uint64_t (*current_size)(void* user);
} stgs_io;

/* A read request of an stgs_async_io. The source owns it until it calls stgs_read_complete. */
typedef struct stgs_read stgs_read;

/* A data source that completes reads later, for stgs_player_open_async_io. */
typedef struct stgs_async_io {
  size_t struct_size;
  void* user;    /* first argument of all callbacks */
  uint64_t size; /* bytes; `current_size` replaces it if set */
  /* Starts to fill `out` with the bytes [offset, offset + bytes), which lie within the size, and
   * returns. The source then calls stgs_read_complete exactly once, on any thread, also before
   * `begin` returns; it may write to `out` until that call. Called on several threads of the
   * player concurrently.
   *
   * After a seek the player abandons reads that it no longer needs and that take longer than half
   * a second. An abandoned read must still be completed, but no longer counts towards
   * max_reads_in_flight. */
  void (*begin)(void* user, stgs_read* read, uint64_t offset, void* out, size_t bytes);
  /* Reports that no result is needed any more; the source may complete reads with an error.
   * stgs_player_destroy calls it at most once. NULL: nothing to do. */
  void (*interrupt)(void* user);
  /* Called once, after the last read has been completed. That may be after stgs_player_destroy, on
   * the thread that completes the read. NULL: nothing to release. */
  void (*close)(void* user);
  /* As in stgs_io. Must not block. NULL: the size stays `size`. */
  uint64_t (*current_size)(void* user);
} stgs_async_io;

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

#endif
