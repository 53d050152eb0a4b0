/* SPDX-License-Identifier: Apache-2.0 */
/* Renders a scene at one time and writes a PNG. The view is the start camera of the file or,
 * without one, shows the whole scene.
 *
 * usage: minimal SCENE.stgs SECONDS IMAGE.png */
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
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

/* Returns 0 after an error, which it has printed. */
static int render(stgs_scene* scene, stgs_renderer* renderer, double seconds, const char* path) {
  stgs_view view = {.struct_size = sizeof view};
  stgs_result result = stgs_scene_start_view(scene, &view);
  if (result == STGS_ERROR_UNSUPPORTED) result = stgs_scene_frame_view(scene, &view);
  if (result != STGS_OK) return scene_failed(scene);
  const size_t bytes = (size_t)4 * view.width * view.height;
  unsigned char* rgba = malloc(bytes);
  if (rgba == NULL) return failed("out of memory");
  stgs_image image;
  stgs_image_defaults(&image, sizeof image);
  image.rgba8.data = rgba;
  image.rgba8.bytes = bytes;
  int ok = stgs_render(renderer, scene, seconds, &view, &image, 1) == STGS_OK;
  if (ok) {
    for (size_t i = 3; i < bytes; i += 4) rgba[i] = 255; /* the background is blended in */
    ok = stbi_write_png(path, (int)view.width, (int)view.height, 4, rgba, 0);
    if (!ok) failed("cannot write the image");
  } else {
    stgs_error error = {.struct_size = sizeof error};
    stgs_renderer_error(renderer, &error);
    failed(error.message);
  }
  free(rgba);
  return ok;
}

int main(int argc, char** argv) {
  if (argc != 4) return !failed("usage: minimal SCENE.stgs SECONDS IMAGE.png");
  stgs_scene* scene = NULL;
  stgs_renderer* renderer = NULL;
  int ok = 0;
  if (stgs_scene_create(NULL, &scene) != STGS_OK ||
      stgs_renderer_create(NULL, &renderer) != STGS_OK) {
    failed("cannot create a scene or a renderer");
  } else if (stgs_scene_open(scene, argv[1]) != STGS_OK) {
    scene_failed(scene);
  } else {
    ok = render(scene, renderer, atof(argv[2]), argv[3]);
  }
  stgs_renderer_destroy(renderer);
  stgs_scene_destroy(scene);
  return ok ? 0 : 1;
}
