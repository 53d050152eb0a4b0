// SPDX-License-Identifier: Apache-2.0
// Trains a SharpTimeGS scene from a prepared capture.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "stgs/encoder/held_out.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/encoder/progress.h"
#include "stgs/encoder/ranks.h"
#include "stgs/encoder/rate_parameters.h"
#include "stgs/format/parameter.h"
#include "stgs/format/scene_file.h"

namespace stgs::encoder {

class PersistentSet;
class TrainBackend;

// TrainParameters describes the numbers.
struct TrainSettings {
  std::string preset = "default";  // fast, default or best
  int iterations = 0;
  int max_primitives = 0;
  double max_seconds = 0;
  double quality = 0;  // to train for; 0: the value of the preset
  // Limits of the packed file, of which at most one is set: the number of primitives that remain
  // follows from it.
  double target_kbps = 0;
  double target_size = 0;  // bytes
  // Instead: primitives are removed as long as the training images keep this PSNR, after the best
  // affine colour map of each, dB.
  double target_psnr = 0;
  std::uint64_t seed = 1;
  std::string backend = "auto";        // "cpu", "cuda", or "auto": CUDA if a device is available
  std::string method = "sharptimegs";  // one of method_names()
  // Comma-separated ablation_names(); "": the complete method. Only with the method sharptimegs.
  std::string ablate;
  std::vector<std::pair<std::string, std::string>> overrides;  // --set key=value
  std::string resume;                                          // checkpoint to resume from
  // Checkpoint path; "": none. A failed write is an error if the run is being stopped, else a
  // warning.
  std::string checkpoint;
  int checkpoint_interval = 500;
  std::string log_path;  // training_log.h; "": none
  // Memory for decoded training frames, bytes; 0: a fraction of the available memory. Frames that
  // do not fit are decoded again when needed. The scene does not depend on this value.
  std::uint64_t frame_memory = 0;
  // Evenly spaced over a run. The scene does not depend on them, and their time does not count as
  // training time.
  int held_out_evaluations = 5;
  // Safetensors file with the weights of SqueezeNet 1.1, VGG16 or AlexNet, and optionally LPIPS's
  // linear layers, for the perceptual loss; "": the loss is off. The guide describes how to make
  // one.
  std::string perceptual_weights;
  // Refine poses, focal lengths, distortion and vignetting of the training cameras together with
  // the scene.
  bool refine_cameras = false;
  // Refine the time offsets of the training cameras together with the scene.
  bool refine_timing = false;
  // Train only the content inside the masks of the capture, with its alpha, on a black background.
  bool foreground = false;
  // Of a process that trains alone; ranks know theirs.
  MachineShare share;
  // Not owned; null: this process trains alone. Otherwise all ranks train with the same settings,
  // each on its own view of every step, and only rank 0 writes files, logs and evaluates.
  Ranks* ranks = nullptr;
};

// The table (stgs/format/parameter.h) of TrainSettings and stgs_train_settings.
struct TrainParameters {
  template <typename Visit>
  static void for_each(Visit visit) {
    STGS_VISIT(visit, iterations, 1, 1e8, "Training views, one per step and process", "",
               "the value of the preset");
    STGS_VISIT(visit, max_primitives, 1, 2e8, "Maximum number of primitives", "",
               "the value of the preset");
    STGS_VISIT(visit, max_seconds, 1, 1e8, "Time limit, to which the schedule adapts", "seconds",
               "no limit");
    STGS_VISIT(visit, quality, 0.1, 100, "Quality to train for, 0.1 (smallest file) to 100", "",
               "the value of the preset");
    visit(kTargetKbps, STGS_MEMBER(target_kbps));
    visit(kTargetSize, STGS_MEMBER(target_size));
    visit(kTargetPsnr, STGS_MEMBER(target_psnr));
    STGS_VISIT(visit, checkpoint_interval, 1, 1e8, "Steps between checkpoints");
    STGS_VISIT(visit, held_out_evaluations, 0, 1e6,
               "Number of evaluations on a sample of the held-out cameras during training; 0: none",
               "", nullptr, "--num-evals");
  }
};

// Describes the perceptual loss of a run that used one.
struct PerceptualReport {
  std::string weights;  // path of the file
  std::string network;  // "squeeze", "vgg" or "alex"
  bool linear = false;  // true LPIPS, with the file's linear layers
  double weight = 0;    // of the loss term
  int patch = 0;        // side of the patch evaluated per step, pixels; 0: the complete image
};

// Statistics of the decoded training frames.
struct FrameStatistics {
  std::uint64_t budget = 0;  // memory for decoded frames, bytes
  // Peak memory of decoded frames, bytes. It exceeds the budget by frames that are evicted while
  // steps in flight still use them, and by full-size images from which half sizes are made.
  std::uint64_t peak = 0;
  bool resident = false;      // all frames were decoded before training
  std::uint64_t decoded = 0;  // decodes; a frame counts each time
  std::uint64_t waits = 0;    // steps whose image was not ready in time
  double wait_seconds = 0;
};

// A training camera as refined, and how far it is from the calibration and from its stated times.
struct RefinedCamera {
  Camera camera;
  double degrees = 0;  // angle between the orientations
  double shift = 0;    // distance between the positions, over that to the centre of the scene
  double zoom = 1;     // factor of the focal lengths
  double pixels = 0;   // displacement of content around the centre of the scene, rms
  // The lens: content at distance r from the axis, at depth 1, appears at r (1 + distortion r^2).
  double distortion = 0;         // -0.3 to 0.3
  double corner_pixels = 0;      // displacement by that in the corners of an image around its axis
  double corner_brightness = 1;  // there over that in the centre, by vignetting; 0.4 to 1.6
  double time_shift = 0;   // frames of the capture by which its images are taken later; -1 to 1
  double time_offset = 0;  // with that, seconds
};

struct TrainReport {
  int iterations = 0;
  double seconds = 0;             // of the steps
  double importance_seconds = 0;  // of computing the importances after the steps, for pack
  std::size_t primitives = 0;
  double final_loss = 0;
  // Of training images over the last quarter of the steps, at most 100, after the colour correction
  // of the loss, dB; 0: no step was trained. Images that training has not seen have less. Some
  // presets drop primitives in each step (drop_share), which costs some of it.
  double psnr = 0;
  std::uint64_t peak_memory = 0;  // resident set, bytes
  FrameStatistics frames;
  std::optional<HeldOutScore> held_out;                         // of the latest evaluation
  std::string backend;                                          // name, with the device
  std::optional<PerceptualReport> perceptual;                   // unset: the loss was off
  int processes = 1;                                            // that trained together
  std::vector<RefinedCamera> cameras;                           // empty: they were not refined
  std::vector<std::pair<std::string, std::string>> parameters;  // every hyper-parameter, as used
};

// The state that a window of a longer capture takes from the one before; null for a capture that is
// trained as a whole. Both are replaced by those of the window. After an error, the set may be
// either, and there is no backend.
struct WindowState {
  PersistentSet* persistent = nullptr;               // persistent_set.h
  std::shared_ptr<TrainBackend>* backend = nullptr;  // with its memory; may point to null
  // From the end of the recording that the set is of to the end of the window, seconds since the
  // start of the recording.
  double begin = 0, end = 0;
};

// Trains and returns the lossless scene. With several ranks, only rank 0's scene has importances.
// A cancelled run writes its checkpoint first and returns kRuntime.
//
// The scene of a window that has a persistent set omits the stored primitives, which it renders
// unchanged. It has two parts: the primitives that end with the window, and those that it adds to
// the stored ones.
Result<Scene> train(const PreparedCapture& capture, const TrainSettings& settings,
                    const ProgressSink& progress, const LogSink& log, TrainReport* report,
                    const WindowState& window = {});

// Lists the backends that this build can train with, whether or not the machine supports them.
std::vector<std::string> train_backends();
// Finds errors of train() before any long work: in the settings, the weights of the perceptual
// loss, the backend and its memory, and a checkpoint that is damaged or of other settings.
// `capture` may be null; only its cameras are read, to determine the size of the images.
Status check_training(const TrainSettings& settings, const PreparedCapture* capture);

// Lists the methods that can be trained: SharpTimeGS, and others as published, to compare with.
std::vector<std::string> method_names();
// Lists the parts of the paper's method that TrainSettings::ablate can disable.
std::vector<std::string> ablation_names();

// A number of the training schedule, with its value as --set takes it.
struct HyperParameter {
  Parameter parameter;
  std::string value;
};

// Lists the hyper-parameters of a preset with a method; empty if one of them is unknown.
std::vector<HyperParameter> hyper_parameters(const std::string& preset,
                                             const std::string& method = "sharptimegs");

}  // namespace stgs::encoder
