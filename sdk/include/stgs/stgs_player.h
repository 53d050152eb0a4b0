/* SPDX-License-Identifier: Apache-2.0 */
/* Playing a scene while it is still coming. C99; stgs.h includes it.
 *
 *   stgs_player_create(NULL, &player);
 *   stgs_player_open(player, "https://host/scene.stgs");
 *   stgs_player_play(player);
 *   each frame:
 *     stgs_player_update(player, seconds_of_a_clock, &status);
 *     while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE)
 *       react(&event);
 *     if (status.state >= STGS_PLAYER_PAUSED)
 *       stgs_render(renderer, stgs_player_scene(player), status.seconds, views, pictures, count);
 *   stgs_player_destroy(player);
 *
 * Threads: a player is used by one thread at a time, whichever, and so is its scene; but one thread
 * may use the player while another uses the scene, once an update has said that it is open.
 * Opening, fetching and decoding have threads of the player's own, which stgs_player_destroy ends.
 * No function waits for a source but stgs_player_wait_open, and stgs_player_destroy where it says
 * so. */
#ifndef STGS_STGS_PLAYER_H
#define STGS_STGS_PLAYER_H

#include "stgs/stgs.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct stgs_player stgs_player;

/* Seconds are finite and not below 0. */
typedef struct stgs_player_settings {
  size_t struct_size;
  uint64_t memory_budget;  /* bytes of what is fetched and decoded: what is needed last makes room,
                            * and what finds none is left out; default 4 GiB, at least 1 MiB */
  uint64_t max_file_bytes; /* of the file when it is opened: a larger one is refused before
                            * anything of it is read; default 2^63 - 1 */
  uint64_t max_primitives; /* of the whole file; default 200 million */
  uint64_t max_memory;     /* bytes of the file's index, and of decoding a segment; default 4 GiB,
                            * at least 1 MiB */
  double prefetch_seconds; /* fetched before they are needed, at the rate of play; default 10 */
  double resume_seconds;   /* there before play goes on after it has stood still; default 0.3 */
  double layer_lead_seconds; /* a layer is fetched so much further ahead than the next; default 1 */
  double retry_seconds; /* until what could not be read is tried again; after each failure twice
                         * as long, as far as 10; default 1 */
  uint32_t max_reads_in_flight; /* reads at once, 1 to 64; default 4 */
  uint32_t url_max_attempts; /* of a URL: in a row that bring nothing, then a read fails; 1 to 1000;
                              * default 5 */
  double url_connect_seconds; /* of a URL: to a connection, then a try fails; default 10 */
  double url_stall_seconds;   /* of a URL: without a byte, or at less than 100 a second, then a try
                               * fails; less than 0.1 counts as that; default 10 */
  stgs_log_fn log;            /* NULL (default): silent */
  void* log_user;
  /* For decoding; copied. Reads stay on threads of the player's, since they wait. NULL (default):
   * the library's threads. */
  const stgs_task_runner* task_runner;
  const stgs_allocator* allocator; /* copied; NULL (default): the heap */
  /* Of a recording that is still being made, see stgs_player_get_live(). */
  int32_t live_follow;         /* 1 (default): it is followed; 0: what is recorded is a clip */
  double live_latency_seconds; /* behind its edge, or further where its stretches ask for that; 0:
                                * as near as they let it be; default 1 */
  double live_poll_seconds;    /* between looks for more, when it is due; less than 0.01 counts as
                                * that; default 0.05 */
  double live_stall_seconds;   /* without more, then STGS_EVENT_STALLED; default 5 */
  double live_skip_seconds;    /* further behind than it is to be, the moment jumps; default 3 */
} stgs_player_settings;

/* `struct_size` is sizeof(*settings). */
STGS_API stgs_result stgs_player_settings_defaults(stgs_player_settings* settings,
                                                   size_t struct_size);

/* A player without a file. `settings` may be NULL: the defaults; they are copied. *out is NULL
 * after an error, which the log has in words, else the caller's. */
STGS_API stgs_result stgs_player_create(const stgs_player_settings* settings, stgs_player** out);
/* Ends the player at any moment, and its scene: neither may be in use. Opening and reads of a URL
 * are broken off, but libcurl before 7.87 still waits for a server's name; of an stgs_io it waits
 * for the reads that are under way, which end sooner where it has `interrupt`; of an stgs_async_io
 * it waits for none. */
STGS_API void stgs_player_destroy(stgs_player* player);
/* Of the last call on the player but this one. error->struct_size is set by the caller. */
STGS_API stgs_result stgs_player_error(const stgs_player* player, stgs_error* error);

/* --- Opening: reads the head of the file, by a thread of the player's, and ends with the event
 * STGS_EVENT_OPENED or _FAILED. A player opens one file (STGS_ERROR_STATE); after _FAILED it may be
 * tried again. Sources and bytes belong to the player as stgs_scene_open... say, `until the player
 * is destroyed` and `after an error` meaning the end of opening too. --- */

/* A path, or a URL of http or https where the build has libcurl (_FAILED with
 * STGS_ERROR_NOT_BUILT). */
STGS_API stgs_result stgs_player_open(stgs_player* player, const char* place);
/* Borrowed: the bytes must stay, unchanged, until the player is destroyed or opening has failed. */
STGS_API stgs_result stgs_player_open_memory(stgs_player* player, const void* data, size_t bytes);
/* Copied: the bytes are not needed after the call. */
STGS_API stgs_result stgs_player_open_memory_copy(stgs_player* player, const void* data,
                                                  size_t bytes);
/* A source that answers by returning. The struct is copied. io->close is called when opening has
 * failed, else when the player is destroyed; STGS_ERROR_ARGUMENT, _STRUCT_SIZE and _STATE leave the
 * source alone. */
STGS_API stgs_result stgs_player_open_io(stgs_player* player, const stgs_io* io);

/* A read that a source has been asked for: the source's, until it completes it. */
typedef struct stgs_read stgs_read;

/* A source that answers later. */
typedef struct stgs_async_io {
  size_t struct_size;
  void* user;
  uint64_t size; /* bytes; where there is current_size, as many as that says */
  /* Begins to fill `out` with the bytes [offset, offset + bytes), which lie within `size`, and
   * returns. Then stgs_read_complete is called once, by any thread, also before `begin` returns;
   * until then `out` may be written to. Called by several threads at once, which are the player's.
   * A read that is not needed where the viewer has jumped to is given up after half a second: it is
   * completed as others, and is not one of the `max_reads_in_flight` any more. */
  void (*begin)(void* user, stgs_read* read, uint64_t offset, void* out, size_t bytes);
  /* No answer is waited for any more: reads may be completed with an error. Called once at most, by
   * stgs_player_destroy; NULL: nothing to do. */
  void (*interrupt)(void* user);
  /* Called once when nothing is read any more, after the last read has been completed, which may be
   * after stgs_player_destroy, and then by the thread that completes it. NULL: nothing to do. */
  void (*close)(void* user);
  /* As stgs_io's: it answers at once. */
  uint64_t (*current_size)(void* user);
} stgs_async_io;

/* The struct is copied; io->close is called as of stgs_player_open_io, but see there. */
STGS_API stgs_result stgs_player_open_async_io(stgs_player* player, const stgs_async_io* io);
/* Ends a read, which must not be used any more. `error`: 0 where all bytes are in `out`, else they
 * could not be had. Any thread; the player may be destroyed already. NULL: nothing happens. */
STGS_API void stgs_read_complete(stgs_read* read, int error);

/* Waits until opening has ended, and tells how: the result of STGS_EVENT_FAILED, also when it is
 * asked again. STGS_ERROR_STATE: nothing is being opened. */
STGS_API stgs_result stgs_player_wait_open(stgs_player* player);

/* The player's scene, the same as long as it lives: for stgs_scene_get_info and its like and for
 * drawing, STGS_ERROR_STATE before it is open. Drawing takes what has come of a moment, and does
 * not wait for the rest. stgs_scene_destroy leaves it alone. NULL: no player. */
STGS_API stgs_scene* stgs_player_scene(stgs_player* player);

/* --- Playing. Before the file is open, these are kept for then, but for seeks
 * (STGS_ERROR_STATE). --- */

/* Goes on from the moment; from the end, from the beginning. Nothing happens while it plays or
 * buffers. */
STGS_API stgs_result stgs_player_play(stgs_player* player);
STGS_API stgs_result stgs_player_pause(stgs_player* player);
/* To a moment, 0 at least and the beginning of the clip's last frame at most, which is where play
 * ends; or to the beginning of a frame, which the clip must have (STGS_ERROR_ARGUMENT). The next
 * update is there. */
STGS_API stgs_result stgs_player_seek(stgs_player* player, double seconds);
STGS_API stgs_result stgs_player_seek_frame(stgs_player* player, uint32_t frame);
/* -2 to 4, not 0; below 0: backwards. 1 until it is set. */
STGS_API stgs_result stgs_player_set_rate(stgs_player* player, double rate);
/* 1: after the end the beginning follows. 0 until it is set. */
STGS_API stgs_result stgs_player_set_loop(stgs_player* player, int32_t loop);

/* --- Live: a file that is still being recorded, of a path, a URL, or a source with current_size.
 * It is opened near its edge, the end of what is recorded, and followed: play keeps its distance,
 * up to a tenth faster or slower where it has lost it, and jumps where it has lost more than
 * live_skip_seconds (STGS_EVENT_SKIPPED). Where there is no more to show, it stands still as for
 * what has not come. To pause, to seek to an earlier moment, and another rate than 1 end that, and
 * all that is recorded can be played; play that reaches the edge follows it again. When the
 * recording is closed (STGS_EVENT_FINISHED), it is a clip like any other. --- */

typedef struct stgs_player_live {
  size_t struct_size;
  int32_t growing;               /* 1: more is expected. 0: there is an end, and the rest is 0 */
  int32_t following;             /* 1: play keeps to the edge */
  double edge_seconds;           /* the end of what is recorded, as far as is known */
  double latency_seconds;        /* how far the moment is behind the edge, which is taken to move on
                                  * steadily between what comes: what a viewer is late by */
  double target_latency_seconds; /* how far it is to be */
} stgs_player_live;

/* As of the last update; all 0 before the file is open. live->struct_size is set by the caller. */
STGS_API stgs_result stgs_player_get_live(stgs_player* player, stgs_player_live* live);
/* To the edge, at rate 1; the next update is there, and play follows it. Nothing happens where
 * nothing more is expected. STGS_ERROR_STATE before the file is open. */
STGS_API stgs_result stgs_player_go_live(stgs_player* player);

typedef int32_t stgs_player_state;
enum {
  STGS_PLAYER_CLOSED = 0, /* nothing is open, or opening has failed */
  STGS_PLAYER_OPENING = 1,
  STGS_PLAYER_PAUSED = 2, /* from here on the file is open */
  STGS_PLAYER_PLAYING = 3,
  STGS_PLAYER_BUFFERING = 4, /* the moment stands still, because what is next has not come */
  STGS_PLAYER_ENDED = 5
};

typedef struct stgs_player_status {
  size_t struct_size;
  stgs_player_state state;
  double seconds;      /* the moment to draw */
  int32_t layers;      /* that are there of the moment, from the base of the picture on */
  int32_t layer_count; /* all; 0 before the file is open */
  int32_t ready;       /* 1: the base is there, a picture of all the space. 0: it has not come,
                        * or could not be had, and the picture has holes */
  int32_t is_complete; /* 1: nothing more of the moment is coming, for now */
} stgs_player_status;

/* Where the player is at `now`, seconds of any clock that never goes back; a step of more than 0.25
 * s counts as 0.25. `status` may be NULL; status->struct_size is set by the caller. STGS_ERROR_
 * ARGUMENT: `now` is not finite, and nothing has moved. Takes note of what the player's threads
 * have done: call it also while nothing plays. */
STGS_API stgs_result stgs_player_update(stgs_player* player, double now,
                                        stgs_player_status* status);

typedef int32_t stgs_event_kind;
enum {
  STGS_EVENT_NONE = 0,
  STGS_EVENT_OPENED = 1,
  STGS_EVENT_FAILED = 2, /* the file could not be opened */
  /* Playing, the moment stands still, because what is next has not come: also where play begins and
   * after a seek. Once, until _RESUMED. */
  STGS_EVENT_BUFFERING = 3,
  STGS_EVENT_RESUMED = 4, /* it goes on after _BUFFERING; who pauses meanwhile puts that off */
  STGS_EVENT_LOOPED = 5,
  STGS_EVENT_ENDED = 6,
  STGS_EVENT_LAYERS = 7,      /* the number of layers at the moment has changed */
  STGS_EVENT_RETRY = 8,       /* a transfer from a URL failed and is tried again */
  STGS_EVENT_READ_FAILED = 9, /* a piece of the file could not be read; it is tried again later.
                               * Once for each piece and try: many at once where a source is down */
  STGS_EVENT_DAMAGED = 10, /* a piece is not what was written; the picture lacks it. Behind _OPENED:
                            * what was wrong with the file then (stgs_scene_get_issue), of that the
                            * first STGS_MAX_OPENING_DAMAGE */
  /* The file is another one now, was overwritten, or has lost what it had: what has not come will
   * not as long as it is so. To see what it is, destroy the player and open it with another. Told
   * where it can be known: of a path by its size and time, of a URL by its size, and its ETag or
   * time; not of a file that was damaged when it was opened, nor of a finished one at whose path
   * another has been put: that goes on as it was. */
  STGS_EVENT_REPLACED = 11,
  STGS_EVENT_STALLED = 12, /* nothing has been added to a recording for live_stall_seconds; it is
                            * looked for further */
  STGS_EVENT_SKIPPED = 13, /* the moment was too far behind a recording's edge, and has jumped */
  STGS_EVENT_FINISHED = 14 /* a recording is closed: nothing more comes */
};

typedef struct stgs_player_event {
  size_t struct_size;
  stgs_event_kind kind;
  stgs_result result;  /* of _FAILED, _RETRY, _LOST, _DAMAGED, _REPLACED, _STALLED, else STGS_OK */
  double seconds;      /* the moment of the clip */
  uint64_t offset;     /* of those: byte of the file; STGS_NO_OFFSET: not known */
  int32_t layers;      /* of _LAYERS */
  const char* message; /* of those, else empty; until the next call of this function */
} stgs_player_event;

#define STGS_MAX_EVENTS 1024
#define STGS_MAX_OPENING_DAMAGE 16

/* The next of what has happened, in order, and forgets it; STGS_EVENT_NONE: there is none. Of
 * events that nobody takes the last STGS_MAX_EVENTS are kept. event->struct_size is set by the
 * caller. */
STGS_API stgs_result stgs_player_next_event(stgs_player* player, stgs_player_event* event);

typedef struct stgs_player_statistics {
  size_t struct_size;
  double bytes_per_second; /* that the source has given of late; 0: not known yet */
  uint64_t fetched_bytes;
  uint64_t memory_bytes;      /* of the budget */
  uint64_t stored_primitives; /* decoded and held */
} stgs_player_statistics;

/* All 0 before the file is open. statistics->struct_size is set by the caller. */
STGS_API stgs_result stgs_player_get_statistics(stgs_player* player,
                                                stgs_player_statistics* statistics);

/* Moments of the clip, seconds. */
typedef struct stgs_time_range {
  double begin, end;
} stgs_time_range;

/* Where play does not have to wait, as the base is there or could not be had, ascending: *count is
 * how many ranges there are, and as many of them as fit are in `ranges`, which has room for
 * `capacity`, and may be NULL where that is 0. None before the file is open. */
STGS_API stgs_result stgs_player_get_buffered(stgs_player* player, stgs_time_range* ranges,
                                              uint32_t capacity, uint32_t* count);

#ifdef __cplusplus
}
#endif

#endif
