/* SPDX-License-Identifier: Apache-2.0 */
/* Plays a scene while its data is still arriving. C99; stgs.h includes it.
 *
 *   stgs_player_create(NULL, &player);
 *   stgs_player_open(player, "https://host/scene.stgs");
 *   stgs_player_play(player);
 *   each frame:
 *     stgs_player_update(player, clock_seconds, &status);
 *     while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE)
 *       handle(&event);
 *     if (status.state >= STGS_PLAYER_PAUSED)
 *       stgs_render(renderer, stgs_player_scene(player), status.seconds, views, images, count);
 *   stgs_player_destroy(player);
 *
 * Threads: one thread at a time may use a player, and one thread at a time its scene: the same one
 * until an update has reported that the file is open, then possibly two. The player opens, fetches
 * and decodes on threads of its own, which stgs_player_destroy ends. Only stgs_player_wait_open,
 * stgs_player_seek_and_wait and, as stated there, stgs_player_destroy wait for a source. */
#ifndef STGS_STGS_PLAYER_H
#define STGS_STGS_PLAYER_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

/** @defgroup api_playing Playing
 *
 *  Plays scenes while their data is still arriving, from files, URLs and live recordings.
 *  @{ */

/** @defgroup api_players Players
 *
 *  Settings, creation and destruction of players.
 *  @{ */

/* Plays one file: fetches and decodes ahead of the current time. */
typedef struct stgs_player stgs_player;

/* Settings of a player. Seconds are finite and >= 0. */
typedef struct stgs_player_settings {
  size_t struct_size;
  uint64_t memory_budget;  /* fetched and decoded data, bytes, at least 1 MiB; default 4 GiB. The
                            * data needed latest is evicted first; data beyond the budget is
                            * not loaded */
  uint64_t max_file_bytes; /* larger files fail to open, before any of their data is read; default
                            * 2^63 - 1 */
  uint64_t max_primitives; /* files with more primitives fail to open; default 200 million */
  uint64_t max_memory;     /* for the file index, and for decoding a segment, bytes, at least 1 MiB;
                            * default 4 GiB. Opening as stgs_scene_settings.max_memory */
  double prefetch_seconds; /* data is fetched this long before it is needed, at the current rate;
                            * default 10 */
  double resume_seconds;   /* data available before playback resumes after a stall; default 0.3 */
  double layer_lead_seconds; /* each layer is fetched this much further ahead than the next layer;
                              * default 1 */
  double retry_seconds;      /* delay before a failed read is retried; doubles with each failure,
                              * up to 10 s; default 1 */
  uint32_t max_reads_in_flight; /* concurrent reads, 1 to 64; default 4 */
  uint32_t url_max_attempts;    /* URLs: consecutive attempts that bring less than 64 KiB, and less
                                 * than url_min_bytes_per_second, before a read fails, 1 to 1000;
                                 * default 5 */
  double url_connect_seconds;   /* URLs: an attempt fails if connecting takes longer; default 10 */
  double url_stall_seconds;     /* URLs: an attempt fails after this long without data, or below 100
                                 * bytes per second; at least 0.1, smaller values count as 0.1;
                                 * default 10 */
  stgs_log_fn log;              /* NULL (default): no log */
  void* log_user;               /* first argument of `log` */
  /* Runs decoding; copied. Reads stay on threads of the player because they block. NULL (default):
   * threads of the library. */
  const stgs_task_runner* task_runner;
  const stgs_allocator* allocator; /* copied; NULL (default): the heap */
  /* For a recording that is still growing, see stgs_player_get_live: */
  int32_t live_follow; /* 1 (default): follow it; 0: play what is recorded so far as a clip */
  double live_latency_seconds; /* target distance from the edge; more if the fragments of the
                                * recording require it; 0: the minimum; default 1 */
  double live_poll_seconds;    /* interval between checks for new data when data is due; at least
                                * 0.01, smaller values count as 0.01; default 0.05 */
  double live_stall_seconds;   /* without new data for this long: STGS_EVENT_STALLED; default 5 */
  double live_skip_seconds;    /* playback further than this behind its target skips ahead; default
                                * 3 */
  double url_timeout_seconds;  /* URLs: limit of a read, as in stgs_scene_settings; default 60 */
  double url_min_bytes_per_second; /* as in stgs_scene_settings; default 1000 */
  int32_t url_allow_private;       /* as in stgs_scene_settings; default 0 */
} stgs_player_settings;

/* Fills settings with the defaults. `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_player_settings_defaults(stgs_player_settings* settings,
                                                   size_t struct_size);

/* Creates a player without a file. NULL settings: the defaults. The log receives the message of an
 * error. */
STGS_API stgs_result stgs_player_create(const stgs_player_settings* settings, stgs_player** out);

/* Destroys a player and its scene, at any time. No other thread may be using either.
 *
 * Aborts opening and reads of a URL, but libcurl before 7.87 still waits for name resolution. Waits
 * for reads in flight of an stgs_io, which end sooner if it has `interrupt`. Does not wait for
 * reads of an stgs_async_io. */
STGS_API void stgs_player_destroy(stgs_player* player);

/* Returns the outcome of the last call on the player, other than calls of this function. */
STGS_API stgs_result stgs_player_error(const stgs_player* player, stgs_error* error);

/** @} */

/** @defgroup api_opening Opening
 *
 * These functions start to read the head of the file on a thread of the player and return. Opening
 * ends with STGS_EVENT_OPENED or STGS_EVENT_FAILED. A player opens one file (STGS_ERROR_STATE);
 * after STGS_EVENT_FAILED opening may be retried. Memory and sources are released as by the
 * stgs_scene_open functions, but when opening has failed, not when a call fails.
 *  @{ */

/* Opens a path, or an http or https URL if the build has libcurl; otherwise opening fails with
 * STGS_ERROR_NOT_BUILT. */
STGS_API stgs_result stgs_player_open(stgs_player* player, const char* location);

/* Opens a file in memory without copying it. The bytes must stay valid and unchanged until the
 * player is destroyed or opening has failed. */
STGS_API stgs_result stgs_player_open_memory(stgs_player* player, const void* data, size_t bytes);

/* Opens a copy of a file in memory. The bytes are not needed after the call. */
STGS_API stgs_result stgs_player_open_memory_copy(stgs_player* player, const void* data,
                                                  size_t bytes);

/* Opens a data source with blocking reads. The struct is copied.
 *
 * io->close is called when opening has failed or the player is destroyed; after
 * STGS_ERROR_ARGUMENT, _STRUCT_SIZE and _STATE it is not called. */
STGS_API stgs_result stgs_player_open_io(stgs_player* player, const stgs_io* io);

/* Opens a data source that completes reads later. The struct is copied. io->close is called as for
 * stgs_player_open_io, but not before the last read has been completed. */
STGS_API stgs_result stgs_player_open_async_io(stgs_player* player, const stgs_async_io* io);

/* Completes a read, which must not be used afterwards.
 *
 * `error` is 0 if all bytes are in `out`, otherwise the read failed. May be called on any thread,
 * also after the player is destroyed. NULL: does nothing. */
STGS_API void stgs_read_complete(stgs_read* read, int error);

/* Blocks until opening has ended and returns its result, also when called again. STGS_ERROR_STATE:
 * no file is being opened. */
STGS_API stgs_result stgs_player_wait_open(stgs_player* player);

/* Returns the scene of the player, always the same one; NULL for a NULL player.
 *
 * Use it for rendering and for the functions of stgs_scene.h, which fail with STGS_ERROR_STATE
 * until the file is open. Rendering shows the data available at the time and does not wait for
 * more. The player owns the scene. */
STGS_API stgs_scene* stgs_player_scene(stgs_player* player);

/** @} */

/** @defgroup api_status Status
 *
 *  What to render and how much of it is available.
 *  @{ */

/* State of a player. */
typedef int32_t stgs_player_state;
enum {
  STGS_PLAYER_CLOSED = 0,    /* no file is open, or opening failed */
  STGS_PLAYER_OPENING = 1,   /* the head of the file is being read */
  STGS_PLAYER_PAUSED = 2,    /* open and paused; all later states are open too */
  STGS_PLAYER_PLAYING = 3,   /* the time advances */
  STGS_PLAYER_BUFFERING = 4, /* playing, but stalled until data arrives */
  STGS_PLAYER_ENDED = 5      /* playback reached the end of the clip */
};

/* Status of a player. */
typedef struct stgs_player_status {
  size_t struct_size;
  stgs_player_state state; /* as of the call */
  double seconds;          /* time to render */
  int32_t layers;          /* layers available at this time, counted from the base layer */
  int32_t layer_count;     /* layers in the file; 0 before it is open */
  int32_t ready;           /* 1: the base layer is available, which covers the whole scene; 0: it is
                            * missing or could not be read, and the image has holes */
  int32_t is_complete;     /* 1: no more data of this time is in flight for now */
} stgs_player_status;

/* Returns the status without advancing the player.
 *
 * It includes the effect of the calls since the last update, such as a seek; only a move to the
 * live edge takes place in the next update. */
STGS_API stgs_result stgs_player_get_status(stgs_player* player, stgs_player_status* status);

/** @} */

/** @defgroup api_playback Playback
 *
 * Before the file is open, these functions set the initial state; seeking fails with
 * STGS_ERROR_STATE.
 *  @{ */

/* Plays from the current time, or from the start if the end is reached. Does nothing while the
 * player is playing or buffering. */
STGS_API stgs_result stgs_player_play(stgs_player* player);

/* Pauses at the current time. */
STGS_API stgs_result stgs_player_pause(stgs_player* player);

/* Moves to a time, clamped to the range from 0 to the start of the last frame, where playback ends.
 *
 * The next update reports the new time. A time at or beyond the live position of a growing file
 * follows it, like stgs_player_go_live. STGS_ERROR_ARGUMENT: `seconds` is not finite. */
STGS_API stgs_result stgs_player_seek(stgs_player* player, double seconds);

/* Moves to the start of a frame. Fails with STGS_ERROR_ARGUMENT if the clip has no such frame. */
STGS_API stgs_result stgs_player_seek_frame(stgs_player* player, uint32_t frame);

/* Pauses, moves to a time like stgs_player_seek, and blocks until no more data of it is in flight.
 *
 * For a single image, as in a screenshot. Returns STGS_OK once status.is_complete is 1: then only
 * damaged or unreadable layers and those that exceed the memory budget are missing. Waits at most
 * timeout_seconds, >= 0 (INFINITY: no limit), then fails with STGS_ERROR_TIMEOUT; the player stays
 * at the time and continues to load it. *status is written in this case too; NULL: not returned.
 * Events are queued as in stgs_player_update. STGS_ERROR_STATE: the file is not open. */
STGS_API stgs_result stgs_player_seek_and_wait(stgs_player* player, double seconds,
                                               double timeout_seconds, stgs_player_status* status);

/* Sets the playback rate: -2 to 4, not 0; negative rates play backwards. Initially 1. */
STGS_API stgs_result stgs_player_set_rate(stgs_player* player, double rate);

/* Sets whether playback continues at the other end of the clip (1) or ends there (0, initially). */
STGS_API stgs_result stgs_player_set_loop(stgs_player* player, int32_t loop);

/** @} */

/** @defgroup api_live Live recordings
 *
 * A file that is still being recorded opens near its edge, the end of the recorded data, and the
 * player follows it. Paths, URLs and sources with current_size can be followed.
 *
 *  - Playback keeps its latency: it runs up to 10 % faster or slower to regain it and skips if it
 *    is more than live_skip_seconds off (STGS_EVENT_SKIPPED). At the edge it buffers.
 *  - Pausing, seeking to an earlier time, and a rate other than 1 end following. Everything
 *    recorded can be played; playback that reaches the edge follows it again.
 *  - When the recording is closed (STGS_EVENT_FINISHED), it becomes an ordinary clip.
 *  @{ */

/* Position of playback in a recording. */
typedef struct stgs_player_live {
  size_t struct_size;
  int32_t growing;               /* 1: more data is expected; 0: all other members are 0 */
  int32_t following;             /* 1: playback follows the edge */
  double edge_seconds;           /* end of the recorded data, as far as known */
  double latency_seconds;        /* distance from the edge, which is taken to advance steadily
                                  * between fragments: the delay that a viewer sees */
  double target_latency_seconds; /* distance that the player aims for */
} stgs_player_live;

/* Returns the live position as of the last update; all 0 before the file is open. */
STGS_API stgs_result stgs_player_get_live(stgs_player* player, stgs_player_live* live);

/* Moves to the edge and follows it at rate 1. The next update reports the new time. Does nothing if
 * the file is not growing. STGS_ERROR_STATE: the file is not open. */
STGS_API stgs_result stgs_player_go_live(stgs_player* player);

/** @} */

/** @defgroup api_updates Updates
 *
 *  The call of every frame.
 *  @{ */

/* Advances the player to `now` and returns its status. Call it every frame, also while paused.
 *
 * `now` is in seconds of any clock that does not run backwards; steps of more than 0.25 s count as
 * 0.25 s. NULL status: not returned. STGS_ERROR_ARGUMENT: `now` is not finite; the player does not
 * advance. */
STGS_API stgs_result stgs_player_update(stgs_player* player, double now,
                                        stgs_player_status* status);

/** @} */

/** @defgroup api_events Events
 *
 *  Changes since the last update.
 *  @{ */

/* Kind of an event. Ignore unknown kinds; later versions may add some. */
typedef int32_t stgs_event_kind;
enum {
  STGS_EVENT_NONE = 0,        /* no event is queued */
  STGS_EVENT_OPENED = 1,      /* the file is open */
  STGS_EVENT_FAILED = 2,      /* the file could not be opened */
  STGS_EVENT_BUFFERING = 3,   /* playback waits for data, also at its start and after a seek; sent
                               * once, until _RESUMED */
  STGS_EVENT_RESUMED = 4,     /* playback continues after _BUFFERING; pausing delays this event */
  STGS_EVENT_LOOPED = 5,      /* playback continued at the other end of the clip */
  STGS_EVENT_ENDED = 6,       /* playback reached the end of the clip */
  STGS_EVENT_LAYERS = 7,      /* the number of available layers changed */
  STGS_EVENT_RETRY = 8,       /* a transfer from a URL failed and is retried */
  STGS_EVENT_READ_FAILED = 9, /* a layer of a segment could not be read and is retried later; sent
                               * for each layer and attempt, in bursts if a source is down */
  STGS_EVENT_DAMAGED = 10,    /* data is damaged and missing from the image. After _OPENED also sent
                               * for errors found while opening (stgs_scene_get_issue), at most
                               * STGS_MAX_OPENING_DAMAGE times */
  /* The file was replaced, overwritten or cut. Data not yet fetched stays unavailable while this
   * lasts; open the new file with a new player. Detected for a path by its size and time, for a URL
   * by its size and its ETag or time. Not detected for a file that was damaged when opened, or for
   * a finished file whose path now leads to another file, which keeps playing. */
  STGS_EVENT_REPLACED = 11,
  STGS_EVENT_STALLED = 12, /* a recording has not grown for live_stall_seconds; polling continues */
  STGS_EVENT_SKIPPED = 13, /* playback was too far behind the edge of a recording and skipped */
  STGS_EVENT_FINISHED = 14 /* a recording is closed; no more data will follow */
};

/* An event of a player. `result`, `offset` and `message` are set for _FAILED, _RETRY, _READ_FAILED,
 * _DAMAGED, _REPLACED and _STALLED. */
typedef struct stgs_player_event {
  size_t struct_size;
  stgs_event_kind kind; /* STGS_EVENT_NONE: no event */
  stgs_result result;   /* otherwise STGS_OK */
  double seconds;       /* playback time */
  uint64_t offset;      /* position in the file, bytes; STGS_NO_OFFSET: not known */
  int32_t layers;       /* available layers, for _LAYERS */
  const char* message;  /* otherwise empty; valid until the next call of stgs_player_next_event */
} stgs_player_event;

#define STGS_MAX_EVENTS 1024       /* events that a player queues; the oldest are dropped */
#define STGS_MAX_OPENING_DAMAGE 16 /* _DAMAGED events sent after _OPENED */

/* Removes the oldest event from the queue and returns it. STGS_EVENT_NONE: the queue is empty. */
STGS_API stgs_result stgs_player_next_event(stgs_player* player, stgs_player_event* event);

/** @} */

/** @defgroup api_statistics Statistics
 *
 *  Transfer, memory and buffered ranges.
 *  @{ */

/* Transfer and memory statistics of a player. */
typedef struct stgs_player_statistics {
  size_t struct_size;
  double bytes_per_second;    /* recent throughput of the source; 0: not known yet */
  uint64_t fetched_bytes;     /* since the file was opened */
  uint64_t memory_bytes;      /* in use, of memory_budget */
  uint64_t stored_primitives; /* decoded and retained */
} stgs_player_statistics;

/* Returns the statistics; all 0 before the file is open. */
STGS_API stgs_result stgs_player_get_statistics(stgs_player* player,
                                                stgs_player_statistics* statistics);

/* A range of clip time, seconds. */
typedef struct stgs_time_range {
  double begin; /* included */
  double end;   /* excluded */
} stgs_time_range;

/* Returns the ranges, ascending, in which playback does not stall: the base layer is available or
 * could not be read.
 *
 * *count is the number of ranges; `ranges` receives up to `capacity` of them and may be NULL if
 * that is 0. No ranges before the file is open. */
STGS_API stgs_result stgs_player_get_buffered(stgs_player* player, stgs_time_range* ranges,
                                              uint32_t capacity, uint32_t* count);

/** @} */
/** @} */

#ifdef __cplusplus
}
#endif

#endif
