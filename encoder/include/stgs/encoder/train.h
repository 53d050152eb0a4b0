// SPDX-License-Identifier: Apache-2.0
// Training of a SharpTimeGS scene from a prepared capture.
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
#include "stgs/format/scene_file.h"

namespace stgs::encoder {

struct TrainSettings {
  std::string preset = "default";  // fast, default or best
  int iterations = 0;              // views to learn from; 0: the preset's
  int max_primitives = 0;          // 0: the preset's
  double max_seconds = 0;          // 0: no limit; the schedule fits itself to it
  std::uint64_t seed = 1;
  std::string backend = "auto";  // "cpu", "cuda", or "auto": CUDA where there is a device
  std::string ablate;            // of ablation_names(), with commas; "": the whole method
  std::vector<std::pair<std::string, std::string>> overrides;  // --set key=value
  std::string resume;                                          // checkpoint to go on from
  // Where to write checkpoints; "": none. One that cannot be written is an error of a run that is
  // stopped, else a warning.
  std::string checkpoint;
  int checkpoint_interval = 500;  // iterations
  std::string log_path;           // training_log.h; "": none
  // Bytes of memory for decoded training frames; 0: a share of what is available. Those that do not
  // fit are decoded again when they are needed. The scene does not depend on it.
  std::uint64_t frame_memory = 0;
  // How often in a run, evenly, a few pictures of the test cameras are measured; 0: never. The
  // scene does not depend on it, and the time that it takes is not training time.
  int held_out_evaluations = 5;
  // Safetensors file with VGG16's weights, and LPIPS's linear layers where there are any, for the
  // perceptual loss; "": there is none. README.md says how to make one.
  std::string perceptual_weights;
  // Not owned; null: this process trains alone. Otherwise all ranks train with the same settings,
  // each on its own view of every step, and the first alone writes files, logs and measures.
  Ranks* ranks = nullptr;
};

// A perceptual loss that was on.
struct PerceptualReport {
  std::string weights;  // the file
  bool linear = false;  // LPIPS proper, with the linear layers of the file
  double weight = 0;    // of the term
  int patch = 0;        // pixels a side of what a step looks at; 0: the whole picture
};

// What became of the training frames.
struct FrameStatistics {
  std::uint64_t budget = 0;  // bytes of memory for decoded frames
  // Bytes of decoded frames at once. Over the budget by those that steps under way hold when others
  // have taken their place, and by full sizes from which half sizes are being made.
  std::uint64_t peak = 0;
  bool resident = false;      // all were decoded before training
  std::uint64_t decoded = 0;  // frames, each as often as it was decoded
  std::uint64_t waits = 0;    // steps whose picture was not there in time
  double wait_seconds = 0;
};

struct TrainReport {
  int iterations = 0;
  double seconds = 0;             // of the steps
  double importance_seconds = 0;  // of weighing the primitives after them, for pack
  std::size_t primitives = 0;
  double final_loss = 0;
  std::uint64_t peak_memory = 0;  // bytes, resident
  FrameStatistics frames;
  std::optional<HeldOutScore> held_out;                         // the last measure
  std::string backend;                                          // what trained
  std::optional<PerceptualReport> perceptual;                   // none: it was off
  int processes = 1;                                            // that trained together
  std::vector<std::pair<std::string, std::string>> parameters;  // all, as used
};

// Trains, and returns the lossless scene; of several processes the first alone has its importances.
// A cancelled run writes its checkpoint first.
Result<Scene> train(const PreparedCapture& capture, const TrainSettings& settings,
                    const ProgressSink& progress, const LogSink& log, TrainReport* report);

// The backends that this build can train with, whatever the machine has.
std::vector<std::string> train_backends();
// What train() would refuse, found before long work: settings, weights of the perceptual loss, the
// backend and its memory, and a checkpoint that is damaged or of other settings. `capture` may be
// null; its cameras say what memory the pictures take, and nothing but them is looked at.
Status check_training(const TrainSettings& settings, const PreparedCapture* capture);

// The parts of the paper's method that TrainSettings::ablate leaves out.
std::vector<std::string> ablation_names();

// Names and values of every hyper-parameter that --set takes, for a preset.
std::vector<std::pair<std::string, std::string>> hyper_parameters(const std::string& preset);

}  // namespace stgs::encoder
