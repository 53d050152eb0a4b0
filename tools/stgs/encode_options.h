// SPDX-License-Identifier: Apache-2.0
// The options of prepare, train and pack, which encode takes all together.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "command.h"
#include "output_path.h"
#include "session.h"
#include "stgs/encoder/pack.h"
#include "stgs/encoder/prepare.h"
#include "stgs/encoder/train.h"
#include "stgs/format/status.h"

namespace CLI {
class App;
}

namespace stgs::tools {

class PrepareOptions {
 public:
  void declare(CLI::App& app);
  // Only in a build with STGS_HAS_PREPARE.
  Result<encoder::PrepareSettings> settings(const CommonOptions& common) const;
  bool overwrites() const { return overwrite_; }

 private:
  std::string layout_ = "auto", frames_, test_cameras_;
  double scale_ = 1, fps_ = 0;
  int max_dynamic_points_ = 0, max_static_points_ = 0;
  bool no_split_ = false, overwrite_ = false;
};

class TrainOptions {
 public:
  // What a verb that trains takes beside them.
  static Shared shared() {
    return {.progress = true,
            .log_level = true,
            .backend = "What trains",
            .trains = true,
            .threads = true,
            .seed = true};
  }
  void declare(CLI::App& app);
  // `written`: what the verb writes beside what these options name; kUsage where two are one.
  // Checks that files can be written where this process is the one that writes. `made`: a folder
  // that the verb makes where there is none, in which they may lie; "": none.
  Result<encoder::TrainSettings> settings(const Session& session, std::vector<NamedPath> written,
                                          const std::string& made) const;
  const std::string& preset() const { return preset_; }
  const std::string& report() const { return report_; }
  // The folder of the report, for JSON.
  Json report_json() const { return report_.empty() ? Json(nullptr) : Json(report_); }
  bool has_log() const { return !log_.empty(); }

 private:
  Status check_places(const std::string& log_path, std::vector<NamedPath> places) const;
  Status check_writable(const std::string& made) const;

  std::string preset_ = "default", frame_memory_, resume_, checkpoint_, log_, report_;
  std::vector<std::string> ablate_;
  int iterations_ = 0, max_primitives_ = 0, checkpoint_interval_ = 500;
  std::string perceptual_weights_;
  int held_out_ = encoder::TrainSettings{}.held_out_evaluations;
  double max_seconds_ = 0;
  std::vector<std::string> overrides_;
};

class PackOptions {
 public:
  void declare(CLI::App& app);
  encoder::PackSettings settings() const;

 private:
  std::string profile_ = profile_name(encoder::PackSettings{}.profile);
  double quality_ = encoder::PackSettings{}.quality, target_kbps_ = 0, max_error_ = 0;
  int tiers_ = encoder::PackSettings{}.tiers;
  double chunk_seconds_ = encoder::PackSettings{}.chunk_seconds;
  double metres_ = 0;  // a unit; 0: not given
  std::vector<float> up_, floor_;
  std::string sound_;
  double sound_seconds_ = 0;
};

// Prepares `capture` into `folder`; kNotBuilt in a build without OpenCV. `accept`, where given, is
// PrepareSettings::accept.
Status prepare_stage(const std::string& capture, const std::string& folder,
                     const PrepareOptions& options, Session& session,
                     const std::function<Status(const encoder::PreparedCapture&)>& accept = {});

// The report of a stage, as the verb of that stage prints it.
Json to_json(const encoder::TrainReport& report);
Json to_json(const encoder::PackReport& report);
// One line for a person: quality, bit rate and loss.
std::string loss_text(const encoder::PackReport& report);

// Trains and writes the lossless scene to `output`, and a report into a folder unless it is "".
Status train_to_file(const encoder::PreparedCapture& capture, const std::string& output,
                     const std::string& report_folder, const encoder::TrainSettings& settings,
                     Session& session, encoder::TrainReport& report);

}  // namespace stgs::tools
