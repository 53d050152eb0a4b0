// SPDX-License-Identifier: Apache-2.0
// The options of prepare, train and pack. encode accepts all of them.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "arguments.h"
#include "command.h"
#include "output_path.h"
#include "session.h"
#include "stgs/encoder/pack.h"
#include "stgs/encoder/prepare.h"
#include "stgs/encoder/train.h"
#include "stgs/format/status.h"

namespace stgs::tools {

class PrepareOptions {
 public:
  void declare(Arguments& app);
  // Defined only with STGS_HAS_PREPARE.
  Result<encoder::PrepareSettings> settings(const CommonOptions& common) const;
  bool overwrite() const { return overwrite_; }

 private:
  std::string layout_ = "auto", frames_, test_cameras_;
  double scale_ = 1, fps_ = 0;
  int max_dynamic_points_ = 0, max_static_points_ = 0;
  bool no_split_ = false, overwrite_ = false;
};

class TrainOptions {
 public:
  // The common options of a verb that trains.
  static Shared shared() {
    return {.progress = true,
            .log_level = true,
            .backend = "Training backend",
            .trains = true,
            .threads = true,
            .seed = true};
  }
  void declare(Arguments& app);
  // Returns the settings. kUsage if two paths are the same, of these options and of `outputs`, the
  // other outputs of the verb. The process that writes also checks that its files can be written.
  // Files may lie in `new_folder`, which the verb creates; "": it creates none.
  Result<encoder::TrainSettings> settings(const Session& session, std::vector<NamedPath> outputs,
                                          const std::string& new_folder) const;
  const std::string& preset() const { return preset_; }
  const std::string& report() const { return report_; }
  const std::string& title() const { return title_; }
  // Returns the report folder, or null.
  Json report_json() const { return report_.empty() ? Json(nullptr) : Json(report_); }
  bool has_log() const { return !log_.empty(); }

 private:
  Status check_paths(const std::string& log_path, std::vector<NamedPath> paths) const;
  Status check_writable(const std::string& new_folder) const;

  std::string preset_ = "default", frame_memory_, resume_, checkpoint_, log_, report_, title_;
  std::vector<std::string> ablate_;
  int iterations_ = 0, max_primitives_ = 0, checkpoint_interval_ = 500;
  std::string perceptual_weights_;
  int num_evals_ = encoder::TrainSettings{}.held_out_evaluations;
  double max_seconds_ = 0;
  std::vector<std::string> overrides_;
};

class PackOptions {
 public:
  void declare(Arguments& app);
  encoder::PackSettings settings() const;

 private:
  std::string profile_ = profile_name(encoder::PackSettings{}.profile);
  double quality_ = encoder::PackSettings{}.quality, target_kbps_ = 0, max_error_ = 0;
  int tiers_ = encoder::PackSettings{}.tiers;
  double chunk_seconds_ = encoder::PackSettings{}.chunk_seconds;
  double metres_per_unit_ = 0;  // 0: not given
  std::vector<float> up_, floor_;
  std::string audio_;
  double audio_seconds_ = 0;
};

// Prepares `capture` into `folder`. kNotBuilt without OpenCV. `accept`, if set, becomes
// PrepareSettings::accept.
Status prepare_stage(const std::string& capture, const std::string& folder,
                     const PrepareOptions& options, Session& session,
                     const std::function<Status(const encoder::PreparedCapture&)>& accept = {});

// Returns the report of a stage, as its verb prints it.
Json to_json(const encoder::TrainReport& report);
Json to_json(const encoder::PackReport& report);
// Returns one line of text: quality, bit rate, and the PSNR that packing cost.
std::string quality_text(const encoder::PackReport& report);

// Trains, writes the lossless scene with its title to `output`, and a report to `report_folder`
// unless it is "".
Status train_to_file(const encoder::PreparedCapture& capture, const std::string& output,
                     const std::string& title, const std::string& report_folder,
                     const encoder::TrainSettings& settings, Session& session,
                     encoder::TrainReport& report);

}  // namespace stgs::tools
