// SPDX-License-Identifier: Apache-2.0
// The options of prepare, train and pack. encode accepts all of them.
#pragma once

#include <functional>
#include <map>
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
  Result<encoder::PrepareSettings> settings(const CommonOptions& common) const;
  bool overwrite() const { return settings_.overwrite; }

 private:
  encoder::PrepareSettings settings_;
  std::string layout_ = "auto", frames_, test_cameras_, protocol_;
  Argument* scale_ = nullptr;
  bool no_split_ = false;
};

// The common options of a verb that prepares or trains. `backend`: the label of --backend.
inline Shared encoder_shared(const char* backend) {
  return {.progress = true,
          .log_level = true,
          .backend = backend,
          .trains = true,
          .threads = true,
          .seed = true};
}

class TrainOptions {
 public:
  // `with_packing`: the verb declares PackOptions, too, whose quality and limits it passes to
  // train_for().
  void declare(Arguments& app, bool with_packing = false);
  void train_for(const encoder::PackSettings& packing);
  // Returns the settings. kUsage if two paths are the same, of these options and of `outputs`, the
  // other outputs of the verb. The process that writes also checks that its files can be written.
  // Files may lie in `new_folder`, which the verb creates; "": it creates none.
  Result<encoder::TrainSettings> settings(Session& session, std::vector<NamedPath> outputs,
                                          const std::string& new_folder) const;
  const std::string& preset() const { return settings_.preset; }
  const std::string& method() const { return settings_.method; }
  const std::string& report() const { return report_; }
  const std::string& title() const { return title_; }
  // Returns the report folder, or null.
  Json report_json() const { return report_.empty() ? Json(nullptr) : Json(report_); }
  bool has_log() const { return !settings_.log_path.empty(); }

 private:
  Status add_overrides(encoder::TrainSettings& settings) const;
  Status check_paths(const std::string& log_path, std::vector<NamedPath> paths) const;
  Status claim_outputs(const std::string& new_folder, Session& session) const;

  encoder::TrainSettings settings_;
  std::string frame_memory_, report_, title_;
  std::vector<std::string> ablate_, overrides_;
};

class PackOptions {
 public:
  void declare(Arguments& app);
  encoder::PackSettings settings() const;

 private:
  encoder::PackSettings settings_;
  std::string profile_ = profile_name(settings_.profile);
  std::vector<float> up_, floor_;
  std::string audio_;
};

// Makes the quality and the limits of a file exclude each other.
void exclude_limits(const std::map<std::string, Argument*>& options);

// Prepares `capture` into `folder`. kNotBuilt without OpenCV. `accept`, if set, becomes
// PrepareSettings::accept.
Status prepare_stage(const std::string& capture, const std::string& folder,
                     const PrepareOptions& options, Session& session,
                     const std::function<Status(const encoder::PreparedCapture&)>& accept = {});

// Opens the windows of `capture`, as WindowPreparer::open() does.
Result<std::unique_ptr<encoder::WindowPreparer>> open_stage(
    const std::string& capture, int window, const PrepareOptions& options, Session& session,
    const std::function<Status(const encoder::PreparedCapture&)>& accept);

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
