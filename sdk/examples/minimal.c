/* SPDX-License-Identifier: Apache-2.0 */
/* Draws a moment of a scene, from the file's start camera or else all of it, and writes a PNG.
 *
 * usage: minimal SCENE.stgs SECONDS PICTURE.png */
#include <stb_image_write.h>
#include <stdio.h>
#include <stdlib.h>

#include "stgs/stgs.h"

static int failed(const char* message) {
  fprintf(stderr, "minimal: %s\n", message);
  return 0;
}

static int scene_failed(const stgs_scene* scene) {
  stgs_error error = {.struct_size = sizeof error};
  stgs_scene_error(scene, &error);
  return failed(error.message);
}

/* Draws and writes; 0 after an error, which it has told. */
static int draw(stgs_scene* scene, stgs_renderer* renderer, double seconds, const char* path) {
  stgs_view view = {.struct_size = sizeof view};
  stgs_result result = stgs_scene_start_view(scene, &view);
  if (result == STGS_ERROR_UNSUPPORTED) result = stgs_scene_frame_view(scene, &view);
  if (result != STGS_OK) return scene_failed(scene);
  const size_t bytes = (size_t)4 * view.width * view.height;
  unsigned char* rgba = malloc(bytes);
  if (rgba == NULL) return failed("no memory for the picture");
  stgs_image picture;
  stgs_image_defaults(&picture, sizeof picture);
  picture.rgba8.data = rgba;
  picture.rgba8.bytes = bytes;
  int ok = stgs_render(renderer, scene, seconds, &view, &picture, 1) == STGS_OK;
  if (ok) {
    for (size_t i = 3; i < bytes; i += 4) rgba[i] = 255; /* the colour is over its background */
    ok = stbi_write_png(path, (int)view.width, (int)view.height, 4, rgba, 0);
    if (!ok) failed("the picture cannot be written");
  } else {
    stgs_error error = {.struct_size = sizeof error};
    stgs_renderer_error(renderer, &error);
    failed(error.message);
  }
  free(rgba);
  return ok;
}

int main(int argc, char** argv) {
  if (argc != 4) return !failed("usage: minimal SCENE.stgs SECONDS PICTURE.png");
  stgs_scene* scene = NULL;
  stgs_renderer* renderer = NULL;
  int ok = 0;
  if (stgs_scene_create(NULL, &scene) != STGS_OK ||
      stgs_renderer_create(NULL, &renderer) != STGS_OK) {
    failed("no scene or no renderer could be made");
  } else if (stgs_scene_open(scene, argv[1]) != STGS_OK) {
    scene_failed(scene);
  } else {
    ok = draw(scene, renderer, atof(argv[2]), argv[3]);
  }
  stgs_renderer_destroy(renderer);
  stgs_scene_destroy(scene);
  return ok ? 0 : 1;
}
