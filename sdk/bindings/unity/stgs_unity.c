/* SPDX-License-Identifier: Apache-2.0 */
#include "stgs_unity.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "unity_camera.h"

/* The rendered image of a camera, bottom row first. Used by the render thread only. */
typedef struct unity_image {
  uint32_t width, height;
  uint32_t* planes[2]; /* index: STGS_UNITY_COLOUR or _DEPTH; 4 bytes per pixel each */
} unity_image;

/* The object behind a handle. */
typedef struct instance {
  int references; /* guarded by table.lock; held by the open handle and by events in flight */
  int32_t handle;
  stgs_player* player;     /* used by the main thread; its scene by the render thread */
  stgs_renderer* renderer; /* used by the render thread */
  unity_image images[STGS_MAX_VIEWS];
  pthread_mutex_t lock; /* guards the members below */
  uint32_t count;       /* cameras to render; 0: none requested yet */
  stgs_view views[STGS_MAX_VIEWS];
  float units[STGS_MAX_VIEWS];
  double seconds;
  stgs_result result;
  char message[512];
} instance;

static struct {
  pthread_mutex_t lock;
  instance* open[STGS_UNITY_MAX_HANDLES];
  int32_t last_handle; /* handles count up, so that a stale one is not soon valid again */
} table = {PTHREAD_MUTEX_INITIALIZER, {NULL}, 0};

/* The instance whose image Unity is reading. Used by the render thread only. */
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
    for (plane = 0; plane < 2; ++plane) free(ending->images[i].planes[plane]);
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

/* Assigns a handle to the instance and returns it; 0: no handle is free. */
static int32_t assign_handle(instance* created) {
  int tries;
  int32_t handle = 0;
  pthread_mutex_lock(&table.lock);
  for (tries = 0; tries < STGS_UNITY_MAX_HANDLES && handle == 0; ++tries) {
    /* Below 2^28: stgs_unity_texture adds three bits for camera and plane. */
    table.last_handle = table.last_handle % ((1 << 28) - 1) + 1;
    if (table.open[slot_of(table.last_handle)] == NULL) handle = table.last_handle;
  }
  if (handle != 0) {
    created->handle = handle;
    table.open[slot_of(handle)] = created;
  }
  pthread_mutex_unlock(&table.lock);
  return handle;
}

static stgs_result set_up(instance* created, const char* location, uint64_t memory_budget,
                          stgs_backend backend) {
  stgs_player_settings player;
  stgs_renderer_settings renderer;
  stgs_result result = stgs_player_settings_defaults(&player, sizeof player);
  if (memory_budget != 0) player.memory_budget = memory_budget;
  if (result == STGS_OK) result = stgs_renderer_settings_defaults(&renderer, sizeof renderer);
  if (result != STGS_OK) return result;
  renderer.backend = backend;
  result = stgs_renderer_create(&renderer, &created->renderer);
  if (result == STGS_OK) result = stgs_player_create(&player, &created->player);
  if (result == STGS_OK) result = stgs_player_open(created->player, location);
  return result;
}

int32_t stgs_unity_open(const char* location, uint64_t memory_budget, stgs_backend backend) {
  int32_t handle;
  stgs_result result;
  instance* created = calloc(1, sizeof *created);
  if (created == NULL) return -STGS_ERROR_OUT_OF_MEMORY;
  created->references = 1;
  pthread_mutex_init(&created->lock, NULL);
  result = set_up(created, location, memory_budget, backend);
  if (result != STGS_OK) {
    destroy(created);
    return -result;
  }
  handle = assign_handle(created);
  if (handle != 0) return handle;
  destroy(created);
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
  if (is_last) release(closing); /* the reference of the handle */
  release(closing);
}

stgs_player* stgs_unity_player(int32_t handle) {
  instance* one = acquire(handle);
  stgs_player* player = one != NULL ? one->player : NULL;
  release(one);
  return player;
}

/* Stores `count` views and units for the next render event. */
static void store_request(instance* one, double seconds, const stgs_view* views, const float* units,
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
  /* From an open state on, the render thread may use the scene. */
  if (status.state >= STGS_PLAYER_PAUSED) store_request(one, status.seconds, views, units, count);
  return status.state;
}

int32_t stgs_unity_frame(int32_t handle, double clock, const stgs_unity_camera* cameras,
                         uint32_t count) {
  instance* one = acquire(handle);
  const int32_t state = one != NULL ? frame(one, clock, cameras, count) : -STGS_ERROR_ARGUMENT;
  release(one);
  return state;
}

/* Allocates the planes of an image of this size. Returns 0 if memory is exhausted. */
static int allocate(unity_image* to, uint32_t width, uint32_t height) {
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

/* Reverses the order of the rows. */
static void flip(uint32_t* pixels, uint32_t width, uint32_t height) {
  uint32_t y, x;
  for (y = 0; y < height / 2; ++y) {
    uint32_t* above = pixels + (size_t)width * y;
    uint32_t* below = pixels + (size_t)width * (height - 1 - y);
    for (x = 0; x < width; ++x) {
      const uint32_t upper = above[x];
      above[x] = below[x];
      below[x] = upper;
    }
  }
}

/* Converts an image to the row order and units of Unity. */
static void convert(unity_image* image, float unit) {
  float* depth = (float*)image->planes[STGS_UNITY_DEPTH];
  size_t i;
  for (i = 0; i < (size_t)image->width * image->height; ++i) depth[i] *= unit;
  flip(image->planes[STGS_UNITY_COLOUR], image->width, image->height);
  flip(image->planes[STGS_UNITY_DEPTH], image->width, image->height);
}

static stgs_result render(instance* one, double seconds, const stgs_view* views, const float* units,
                          uint32_t count) {
  stgs_image images[STGS_MAX_VIEWS];
  stgs_result result;
  uint32_t i;
  for (i = 0; i < count; ++i) {
    unity_image* to = &one->images[i];
    const size_t bytes = (size_t)4 * views[i].width * views[i].height;
    if (views[i].width > STGS_MAX_SIDE || views[i].height > STGS_MAX_SIDE) {
      return STGS_ERROR_ARGUMENT;
    }
    if (!allocate(to, views[i].width, views[i].height)) return STGS_ERROR_OUT_OF_MEMORY;
    stgs_image_defaults(&images[i], sizeof images[i]);
    images[i].rgba8.data = to->planes[STGS_UNITY_COLOUR];
    images[i].depth.data = to->planes[STGS_UNITY_DEPTH];
    images[i].rgba8.bytes = images[i].depth.bytes = bytes;
  }
  result =
      stgs_render(one->renderer, stgs_player_scene(one->player), seconds, views, images, count);
  for (i = 0; i < count; ++i) {
    if (result == STGS_OK) {
      convert(&one->images[i], units[i]);
    } else {
      one->images[i].width = 0; /* no image: textures stay unchanged */
    }
  }
  return result;
}

static void store_result(instance* one, stgs_result result) {
  stgs_error error;
  const char* message = "";
  error.struct_size = sizeof error;
  if (result != STGS_OK) {
    const int has_message =
        stgs_renderer_error(one->renderer, &error) == STGS_OK && error.result == result;
    message = has_message ? error.message : stgs_result_name(result);
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
  if (count > 0) store_result(one, render(one, seconds, views, units, count));
  release(one);
}

/* Returns the pixels for a texture; NULL if no image matches it. */
static void* pixels_for(instance* one, const unity_texture_update* update) {
  const uint32_t plane = update->user & 1, camera = (update->user >> 1) & 3;
  const unity_image* image = &one->images[camera];
  const int is_colour =
      update->format == UNITY_R8G8B8A8_SRGB || update->format == UNITY_R8G8B8A8_UNORM;
  const int fits = plane == STGS_UNITY_COLOUR ? is_colour : update->format == UNITY_R32_SFLOAT;
  if (!fits || update->bytes_per_pixel != 4 || image->width == 0 || image->width != update->width ||
      image->height != update->height) {
    return NULL;
  }
  return image->planes[plane];
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
