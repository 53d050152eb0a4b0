/* SPDX-License-Identifier: Apache-2.0 */
/* Draws one moment of a scene from its start camera, or from before it, and writes a PPM picture.
 *
 * usage: minimal SCENE.stgs SECONDS PICTURE.ppm */
#include <stdio.h>
#include <stdlib.h>

#include "stgs/stgs.h"

static int write_ppm(const char* path, const unsigned char* rgba, unsigned width, unsigned height) {
  const size_t pixels = (size_t)width * height;
  size_t i;
  FILE* file = fopen(path, "wb");
  if (file == NULL) return 0;
  fprintf(file, "P6\n%u %u\n255\n", width, height);
  for (i = 0; i < pixels; ++i) fwrite(rgba + 4 * i, 1, 3, file);
  return fclose(file) == 0;
}

/* The file's start camera. Where it has none, as one that was converted from splats, the defaults,
 * which look along z, from so far away that all that lies within the bounds is seen. */
static stgs_result place_camera(stgs_scene* scene, stgs_view* view) {
  stgs_scene_info info;
  float size = 0;
  int i;
  stgs_result result = stgs_scene_start_view(scene, view);
  if (result != STGS_ERROR_UNSUPPORTED) return result;
  info.struct_size = sizeof info;
  result = stgs_scene_get_info(scene, &info);
  for (i = 0; i < 3 && result == STGS_OK; ++i) {
    const float edge = info.bounds_max[i] - info.bounds_min[i];
    if (edge > size) size = edge;
    view->translation[i] = -(info.bounds_min[i] + info.bounds_max[i]) / 2;
  }
  view->translation[2] += size > 0 ? 1.5f * size : 1;
  return result;
}

/* Draws and writes; says what went wrong. */
static int draw(stgs_scene* scene, stgs_renderer* renderer, double seconds, const char* path) {
  stgs_error error;
  stgs_view view;
  stgs_picture picture;
  int ok = 0;
  error.struct_size = sizeof error;
  view.struct_size = sizeof view;
  stgs_picture_defaults(&picture, sizeof picture);
  if (place_camera(scene, &view) != STGS_OK) {
    stgs_scene_error(scene, &error);
    fprintf(stderr, "%s\n", error.message);
    return 0;
  }
  picture.rgba8.bytes = (size_t)4 * view.width * view.height;
  picture.rgba8.data = malloc(picture.rgba8.bytes);
  if (picture.rgba8.data != NULL) {
    if (stgs_render(renderer, scene, seconds, &view, &picture, 1) != STGS_OK) {
      stgs_renderer_error(renderer, &error);
      fprintf(stderr, "%s\n", error.message);
    } else {
      ok = write_ppm(path, picture.rgba8.data, view.width, view.height);
      if (!ok) perror(path);
    }
  }
  free(picture.rgba8.data);
  return ok;
}

int main(int argc, char** argv) {
  stgs_scene* scene = NULL;
  stgs_renderer* renderer = NULL;
  stgs_error error;
  int ok = 0;
  if (argc != 4) {
    fprintf(stderr, "usage: minimal SCENE.stgs SECONDS PICTURE.ppm\n");
    return 1;
  }
  error.struct_size = sizeof error;
  if (stgs_scene_create(NULL, &scene) == STGS_OK &&
      stgs_renderer_create(NULL, &renderer) == STGS_OK) {
    if (stgs_scene_open(scene, argv[1]) == STGS_OK) {
      ok = draw(scene, renderer, atof(argv[2]), argv[3]);
    } else {
      stgs_scene_error(scene, &error);
      fprintf(stderr, "%s\n", error.message);
    }
  }
  stgs_renderer_destroy(renderer);
  stgs_scene_destroy(scene);
  return ok ? 0 : 1;
}
