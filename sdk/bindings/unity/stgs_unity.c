/* SPDX-License-Identifier: Apache-2.0 */
#include "stgs_unity.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "unity_camera.h"

/* Pictures that were drawn, first row at the bottom. The render thread's. */
typedef struct drawing {
  uint32_t width, height;
  uint32_t* planes[2]; /* by STGS_UNITY_COLOUR and _DEPTH: 4 bytes a pixel of either */
} drawing;

/* What a handle stands for. */
typedef struct instance {
  int references; /* the table's lock; one is the open handle's, one an event's under way */
  int32_t handle;
  stgs_player* player;     /* the main thread's, but for its scene, which is the render thread's */
  stgs_renderer* renderer; /* the render thread's */
  drawing drawings[STGS_MAX_VIEWS];
  pthread_mutex_t lock; /* of what follows */
  uint32_t count;       /* cameras to draw; 0: nothing has been asked for */
  stgs_view views[STGS_MAX_VIEWS];
  float units[STGS_MAX_VIEWS];
  double seconds;
  stgs_result result;
  char message[512];
} instance;

static struct {
  pthread_mutex_t lock;
  instance* open[STGS_UNITY_MAX_HANDLES];
  int32_t opened; /* in all, so that a handle does not soon stand for another */
} table = {PTHREAD_MUTEX_INITIALIZER, {NULL}, 0};

/* Whose picture Unity is reading now. The render thread's. */
static instance* uploading = NULL;

static int slot_of(int32_t handle) {
  return (handle - 1) % STGS_UNITY_MAX_HANDLES;
}

static instance* acquire(int32_t handle) {
  instance* found = NULL;
  if (handle < 1) return NULL;
  pthread_mutex_lock(&table.lock);
  found = table.open[slot_of(handle)];
  if (found != NULL && found->handle != handle) found = NULL;
  if (found != NULL) ++found->references;
  pthread_mutex_unlock(&table.lock);
  return found;
}

static void destroy(instance* ending) {
  int i, plane;
  stgs_renderer_destroy(ending->renderer);
  stgs_player_destroy(ending->player);
  for (i = 0; i < STGS_MAX_VIEWS; ++i) {
    for (plane = 0; plane < 2; ++plane) free(ending->drawings[i].planes[plane]);
  }
  pthread_mutex_destroy(&ending->lock);
  free(ending);
}

static void release(instance* one) {
  int left;
  if (one == NULL) return;
  pthread_mutex_lock(&table.lock);
  left = --one->references;
  pthread_mutex_unlock(&table.lock);
  if (left == 0) destroy(one);
}

/* Gives the instance a handle; 0: there are too many. */
static int32_t enter(instance* made) {
  int tries;
  int32_t handle = 0;
  pthread_mutex_lock(&table.lock);
  for (tries = 0; tries < STGS_UNITY_MAX_HANDLES && handle == 0; ++tries) {
    /* Below 2^28: beside it a texture's number has three bits for camera and plane. */
    table.opened = table.opened % ((1 << 28) - 1) + 1;
    if (table.open[slot_of(table.opened)] == NULL) handle = table.opened;
  }
  if (handle != 0) {
    made->handle = handle;
    table.open[slot_of(handle)] = made;
  }
  pthread_mutex_unlock(&table.lock);
  return handle;
}

static stgs_result set_up(instance* made, const char* place, uint64_t memory_budget,
                          stgs_backend backend) {
  stgs_player_settings player;
  stgs_renderer_settings renderer;
  stgs_result result = stgs_player_settings_defaults(&player, sizeof player);
  if (memory_budget != 0) player.memory_budget = memory_budget;
  if (result == STGS_OK) result = stgs_renderer_settings_defaults(&renderer, sizeof renderer);
  if (result != STGS_OK) return result;
  renderer.backend = backend;
  result = stgs_renderer_create(&renderer, &made->renderer);
  if (result == STGS_OK) result = stgs_player_create(&player, &made->player);
  if (result == STGS_OK) result = stgs_player_open(made->player, place);
  return result;
}

int32_t stgs_unity_open(const char* place, uint64_t memory_budget, stgs_backend backend) {
  int32_t handle;
  stgs_result result;
  instance* made = calloc(1, sizeof *made);
  if (made == NULL) return -STGS_ERROR_OUT_OF_MEMORY;
  made->references = 1;
  pthread_mutex_init(&made->lock, NULL);
  result = set_up(made, place, memory_budget, backend);
  if (result != STGS_OK) {
    destroy(made);
    return -result;
  }
  handle = enter(made);
  if (handle != 0) return handle;
  destroy(made);
  return -STGS_ERROR_LIMIT;
}

void stgs_unity_close(int32_t handle) {
  instance* closing = acquire(handle);
  int is_last = 0;
  if (closing == NULL) return;
  pthread_mutex_lock(&table.lock);
  is_last = table.open[slot_of(handle)] == closing;
  if (is_last) table.open[slot_of(handle)] = NULL;
  pthread_mutex_unlock(&table.lock);
  if (is_last) release(closing); /* the handle's own */
  release(closing);
}

stgs_player* stgs_unity_player(int32_t handle) {
  instance* one = acquire(handle);
  stgs_player* player = one != NULL ? one->player : NULL;
  release(one);
  return player;
}

/* Keeps what to draw; `views` and `units` are `count` long. */
static void ask(instance* one, double seconds, const stgs_view* views, const float* units,
                uint32_t count) {
  pthread_mutex_lock(&one->lock);
  one->seconds = seconds;
  one->count = count;
  memcpy(one->views, views, count * sizeof *views);
  memcpy(one->units, units, count * sizeof *units);
  pthread_mutex_unlock(&one->lock);
}

static int32_t frame(instance* one, double clock, const stgs_unity_camera* cameras,
                     uint32_t count) {
  stgs_view views[STGS_MAX_VIEWS];
  float units[STGS_MAX_VIEWS];
  stgs_player_status status;
  stgs_result result;
  uint32_t i;
  if (cameras == NULL || count < 1 || count > STGS_MAX_VIEWS) return -STGS_ERROR_ARGUMENT;
  for (i = 0; i < count; ++i) {
    if (!stgs_unity_view(&cameras[i], &views[i], &units[i])) return -STGS_ERROR_ARGUMENT;
  }
  status.struct_size = sizeof status;
  result = stgs_player_update(one->player, clock, &status);
  if (result != STGS_OK) return -result;
  /* The render thread may use the scene from now on. */
  if (status.state >= STGS_PLAYER_PAUSED) ask(one, status.seconds, views, units, count);
  return status.state;
}

int32_t stgs_unity_frame(int32_t handle, double clock, const stgs_unity_camera* cameras,
                         uint32_t count) {
  instance* one = acquire(handle);
  const int32_t state = one != NULL ? frame(one, clock, cameras, count) : -STGS_ERROR_ARGUMENT;
  release(one);
  return state;
}

/* Memory for pictures of that size; 0: there is none. */
static int make_room(drawing* to, uint32_t width, uint32_t height) {
  const size_t pixels = (size_t)width * height;
  int plane;
  if (to->planes[0] != NULL && to->width == width && to->height == height) return 1;
  to->width = to->height = 0;
  for (plane = 0; plane < 2; ++plane) {
    free(to->planes[plane]);
    to->planes[plane] = pixels != 0 ? malloc(4 * pixels) : NULL;
  }
  if (to->planes[0] == NULL || to->planes[1] == NULL) return 0;
  to->width = width;
  to->height = height;
  return 1;
}

/* Turns rows upside down. */
static void flip(uint32_t* pixels, uint32_t width, uint32_t height) {
  uint32_t y, x;
  for (y = 0; y < height / 2; ++y) {
    uint32_t* above = pixels + (size_t)width * y;
    uint32_t* below = pixels + (size_t)width * (height - 1 - y);
    for (x = 0; x < width; ++x) {
      const uint32_t kept = above[x];
      above[x] = below[x];
      below[x] = kept;
    }
  }
}

/* From the library's rows and units to Unity's. */
static void turn(drawing* drawn, float unit) {
  float* depth = (float*)drawn->planes[STGS_UNITY_DEPTH];
  size_t i;
  for (i = 0; i < (size_t)drawn->width * drawn->height; ++i) depth[i] *= unit;
  flip(drawn->planes[STGS_UNITY_COLOUR], drawn->width, drawn->height);
  flip(drawn->planes[STGS_UNITY_DEPTH], drawn->width, drawn->height);
}

static stgs_result draw(instance* one, double seconds, const stgs_view* views, const float* units,
                        uint32_t count) {
  stgs_image pictures[STGS_MAX_VIEWS];
  stgs_result result;
  uint32_t i;
  for (i = 0; i < count; ++i) {
    drawing* to = &one->drawings[i];
    const size_t bytes = (size_t)4 * views[i].width * views[i].height;
    if (views[i].width > STGS_MAX_SIDE || views[i].height > STGS_MAX_SIDE) {
      return STGS_ERROR_ARGUMENT;
    }
    if (!make_room(to, views[i].width, views[i].height)) return STGS_ERROR_OUT_OF_MEMORY;
    stgs_image_defaults(&pictures[i], sizeof pictures[i]);
    pictures[i].rgba8.data = to->planes[STGS_UNITY_COLOUR];
    pictures[i].depth.data = to->planes[STGS_UNITY_DEPTH];
    pictures[i].rgba8.bytes = pictures[i].depth.bytes = bytes;
  }
  result =
      stgs_render(one->renderer, stgs_player_scene(one->player), seconds, views, pictures, count);
  for (i = 0; i < count; ++i) {
    if (result == STGS_OK) {
      turn(&one->drawings[i], units[i]);
    } else {
      one->drawings[i].width = 0; /* no picture: textures stay as they are */
    }
  }
  return result;
}

static void keep_result(instance* one, stgs_result result) {
  stgs_error error;
  const char* message = "";
  error.struct_size = sizeof error;
  if (result != STGS_OK) {
    const int told =
        stgs_renderer_error(one->renderer, &error) == STGS_OK && error.result == result;
    message = told ? error.message : stgs_result_name(result);
  }
  pthread_mutex_lock(&one->lock);
  one->result = result;
  strncpy(one->message, message, sizeof one->message - 1);
  pthread_mutex_unlock(&one->lock);
}

static void on_render(int event) {
  instance* one = acquire(event);
  stgs_view views[STGS_MAX_VIEWS];
  float units[STGS_MAX_VIEWS];
  double seconds;
  uint32_t count;
  if (one == NULL) return;
  pthread_mutex_lock(&one->lock);
  seconds = one->seconds;
  count = one->count;
  memcpy(views, one->views, sizeof views);
  memcpy(units, one->units, sizeof units);
  pthread_mutex_unlock(&one->lock);
  if (count > 0) keep_result(one, draw(one, seconds, views, units, count));
  release(one);
}

/* The pixels for a texture; NULL where none fit. */
static void* pixels_for(instance* one, const unity_texture_update* update) {
  const uint32_t plane = update->user & 1, camera = (update->user >> 1) & 3;
  const drawing* drawn = &one->drawings[camera];
  const int is_colour =
      update->format == UNITY_R8G8B8A8_SRGB || update->format == UNITY_R8G8B8A8_UNORM;
  const int fits = plane == STGS_UNITY_COLOUR ? is_colour : update->format == UNITY_R32_SFLOAT;
  if (!fits || update->bytes_per_pixel != 4 || drawn->width == 0 || drawn->width != update->width ||
      drawn->height != update->height) {
    return NULL;
  }
  return drawn->planes[plane];
}

static void on_texture(int event, void* data) {
  unity_texture_update* update = data;
  if (event == UNITY_UPDATE_TEXTURE_BEGIN && update != NULL) {
    release(uploading);
    uploading = acquire((int32_t)(update->user >> 3));
    update->pixels = uploading != NULL ? pixels_for(uploading, update) : NULL;
  } else if (event == UNITY_UPDATE_TEXTURE_END) {
    release(uploading);
    uploading = NULL;
  }
}

unity_event_fn stgs_unity_render_event(void) {
  return on_render;
}

unity_event_and_data_fn stgs_unity_texture_event(void) {
  return on_texture;
}

uint32_t stgs_unity_texture(int32_t handle, uint32_t camera, uint32_t plane) {
  return (uint32_t)handle << 3 | (camera & 3) << 1 | (plane & 1);
}

stgs_result stgs_unity_error(int32_t handle, char* message, size_t bytes) {
  instance* one = acquire(handle);
  stgs_result result = STGS_ERROR_ARGUMENT;
  if (one == NULL) return result;
  pthread_mutex_lock(&one->lock);
  result = one->result;
  if (message != NULL && bytes > 0) {
    strncpy(message, one->message, bytes - 1);
    message[bytes - 1] = '\0';
  }
  pthread_mutex_unlock(&one->lock);
  release(one);
  return result;
}

void UnityPluginUnload(void) {
  int i;
  for (i = 0; i < STGS_UNITY_MAX_HANDLES; ++i) {
    int32_t handle = 0;
    pthread_mutex_lock(&table.lock);
    if (table.open[i] != NULL) handle = table.open[i]->handle;
    pthread_mutex_unlock(&table.lock);
    stgs_unity_close(handle);
  }
  release(uploading);
  uploading = NULL;
}
