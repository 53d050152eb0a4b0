/* SPDX-License-Identifier: Apache-2.0 */
/* Makes a scene from a capture: prepares OUTPUT.prepared, trains OUTPUT.trained, packs OUTPUT.
 * Ctrl-C cancels it; the next run resumes training from OUTPUT.checkpoint.
 *
 * usage: encode CAPTURE OUTPUT.stgs [draft]      draft: two small frames, briefly trained */
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "stgs/stgs_encoder.h"

enum { NAME = 1024 };

static stgs_encoder* encoder;

static void stop(int signal) {
  (void)signal;
  stgs_encoder_cancel(encoder);
}

static int32_t show(void* user, const stgs_encoder_progress* progress) {
  (void)user;
  fprintf(stderr, "\r\033[K%-14s %3.0f %%  %s", progress->stage, 100 * progress->done,
          progress->detail);
  return 0;
}

static int exists(const char* path) {
  FILE* file = fopen(path, "rb");
  if (file != NULL) fclose(file);
  return file != NULL;
}

static stgs_result prepare(const char* capture, const char* prepared, int draft) {
  stgs_prepare_settings settings;
  stgs_prepare_settings_defaults(&settings, sizeof settings);
  if (draft) {
    settings.end_frame = 2;
    settings.scale = 0.125;
    settings.max_static_points = 1000;
    settings.max_dynamic_points = 100;
  }
  return stgs_encoder_prepare(encoder, capture, prepared, &settings, NULL);
}

static stgs_result train(const char* prepared, const char* trained, const char* checkpoint,
                         int draft) {
  stgs_train_settings settings;
  stgs_train_settings_defaults(&settings, sizeof settings);
  if (draft) settings.iterations = 20;
  settings.checkpoint = checkpoint;
  if (exists(checkpoint)) settings.resume = checkpoint;
  return stgs_encoder_train(encoder, prepared, trained, &settings, NULL);
}

static stgs_result encode(const char* capture, const char* output, int draft) {
  char prepared[NAME], cameras[NAME], trained[NAME], checkpoint[NAME];
  stgs_pack_report report;
  stgs_result result = STGS_OK;
  snprintf(prepared, NAME, "%s.prepared", output);
  snprintf(cameras, NAME, "%s.prepared/capture.json", output);
  snprintf(trained, NAME, "%s.trained", output);
  snprintf(checkpoint, NAME, "%s.checkpoint", output);
  if (!exists(cameras)) result = prepare(capture, prepared, draft);
  if (result == STGS_OK) result = train(prepared, trained, checkpoint, draft);
  if (result != STGS_OK) return result;
  report.struct_size = sizeof report;
  result = stgs_encoder_pack(encoder, trained, output, NULL, &report);
  if (result == STGS_OK) {
    fprintf(stderr, "\n");
    printf("%llu primitives, %llu bytes, PSNR %.1f dB against the trained scene\n",
           (unsigned long long)report.primitives, (unsigned long long)report.bytes_out,
           report.images_psnr);
  }
  return result;
}

int main(int argc, char** argv) {
  stgs_encoder_settings settings;
  stgs_error error;
  const int draft = argc == 4 && strcmp(argv[3], "draft") == 0;
  if ((argc != 3 && !draft) || strlen(argv[2]) > NAME - 32) {
    fprintf(stderr, "usage: encode CAPTURE OUTPUT.stgs [draft]\n");
    return 1;
  }
  stgs_encoder_settings_defaults(&settings, sizeof settings);
  settings.progress = show;
  if (stgs_encoder_create(&settings, &encoder) != STGS_OK) return 1;
  signal(SIGINT, stop);
  error.struct_size = sizeof error;
  error.result = encode(argv[1], argv[2], draft);
  if (error.result != STGS_OK) {
    stgs_encoder_error(encoder, &error);
    fprintf(stderr, "\n%s: %s\n", stgs_result_name(error.result), error.message);
  }
  signal(SIGINT, SIG_DFL);
  stgs_encoder_destroy(encoder);
  return error.result == STGS_OK ? 0 : 1;
}
